//! Two threads that do the two halves of one phase of work after the other.
//!
//! The leader posts a phase and does its first half. Whoever comes first takes the second one, so that no phase waits for
//! a helper that the machine does not run; the end of a call does, for it has to come and go. Between phases both spin: they are microseconds
//! apart.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Turns of a waiting loop after which the processor is offered to others: some tens of microseconds.
const SPINS: usize = 4_000;
/// The phase after the last one.
const END: usize = usize::MAX;

/// Where leader and helper meet: numbers of phases, which only grow and begin at 1.
#[derive(Debug, Default)]
pub struct Team {
    posted: AtomicUsize,
    /// The last phase of which the second half is in somebody's hands.
    taken: AtomicUsize,
    /// The last phase of which the helper has done the second half.
    done: AtomicUsize,
}

impl Team {
    /// The leader's part of a phase, `work` with the numbers of the halves that fall to it; returns how long it waited
    /// for the helper.
    pub fn lead(&self, phase: usize, work: impl Fn(usize)) -> Duration {
        self.posted.store(phase, Ordering::Release);
        work(0);
        if self.take(phase) {
            work(1);
            return Duration::ZERO;
        }
        let start = Instant::now();
        wait(|| self.done.load(Ordering::Acquire) == phase);
        start.elapsed()
    }

    /// The helper's part of all phases, `work` with their numbers, until the end.
    pub fn help(&self, work: impl Fn(usize)) {
        let mut last = 0;
        loop {
            wait(|| self.posted.load(Ordering::Acquire) != last);
            last = self.posted.load(Ordering::Acquire);
            if last == END {
                return;
            }
            if self.take(last) {
                let _done = Done { team: self, phase: last };
                work(last);
            }
        }
    }

    /// Sends the helper away when what is returned is dropped.
    pub fn until_dropped(&self) -> impl Drop + '_ {
        struct Ends<'a>(&'a Team);
        impl Drop for Ends<'_> {
            fn drop(&mut self) {
                self.0.posted.store(END, Ordering::Release);
            }
        }
        Ends(self)
    }

    fn take(&self, phase: usize) -> bool {
        self.taken.fetch_max(phase, Ordering::AcqRel) < phase
    }
}

/// Tells that a phase is done, even if it ended in a panic: nobody waits for ever.
struct Done<'a> {
    team: &'a Team,
    phase: usize,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.team.done.store(self.phase, Ordering::Release);
    }
}

fn wait(until: impl Fn() -> bool) {
    let mut turns = 0;
    while !until() {
        if turns < SPINS {
            turns += 1;
            std::hint::spin_loop();
        } else {
            std::thread::yield_now();
        }
    }
}

/// Decides from the time that the leader waited whether a helper is of use.
#[derive(Debug, Default)]
pub struct Patience {
    waited: Duration,
    worked: Duration,
    /// Updates with a helper since it was last decided.
    helped: u64,
    /// Updates to make alone.
    alone: u64,
}

impl Patience {
    /// Updates with a helper after which it is decided.
    pub const WINDOW: u64 = 300;
    /// Updates that are then made alone, before a helper is tried again: other programs come and go, and trying costs
    /// a tenth of the pause at most.
    pub const PAUSE: u64 = 3_000;

    /// Whether the next updates are to be made alone.
    pub fn exhausted(&self) -> bool {
        self.alone > 0
    }

    /// Takes note of some updates that took `worked` together, of which the leader `waited` so long.
    pub fn note(&mut self, updates: u64, worked: Duration, waited: Duration) {
        if self.exhausted() {
            self.alone = self.alone.saturating_sub(updates);
            return;
        }
        self.helped += updates;
        self.worked += worked;
        self.waited += waited;
        if self.helped >= Self::WINDOW {
            // Beyond half of the time one thread would be as fast. Less is asked for: where the helper has to share its
            // processor the leader has to, too, and the time that this takes counts as worked.
            let alone = if 4 * self.waited > self.worked { Self::PAUSE } else { 0 };
            *self = Self { alone, ..Self::default() };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[test]
    fn each_half_of_each_phase_is_done_once_before_the_next() {
        let (team, log) = (Team::default(), Mutex::new(Vec::new()));
        let enter = |phase, half| log.lock().map(|mut log| log.push((phase, half))).unwrap_or_default();
        std::thread::scope(|scope| {
            let _end = team.until_dropped();
            for phase in 1..=200 {
                if phase == 20 {
                    scope.spawn(|| team.help(|phase| enter(phase, 1)));
                }
                team.lead(phase, |half| enter(phase, half));
            }
        });
        let mut log = log.into_inner().unwrap_or_default();
        assert!(log.is_sorted_by_key(|(phase, _)| *phase));
        log.sort_unstable();
        assert_eq!(log, (1..=200).flat_map(|phase| [(phase, 0), (phase, 1)]).collect::<Vec<_>>());
    }

    #[test]
    fn a_helper_that_panics_is_not_waited_for() {
        let team = Team::default();
        let ended = std::thread::scope(|scope| {
            let _end = team.until_dropped();
            let helper = scope.spawn(|| team.help(|_| panic!("as the test wants")));
            // Until the helper has it.
            team.lead(1, |_| wait(|| team.taken.load(Ordering::Relaxed) == 1));
            helper.join()
        });
        assert!(ended.is_err());
    }

    #[test]
    fn patience_ends_with_long_waits_and_comes_back() {
        let mut patience = Patience::default();
        let second = Duration::from_secs(1);
        patience.note(Patience::WINDOW, 8 * second, 2 * second);
        assert!(!patience.exhausted());
        patience.note(Patience::WINDOW - 1, 8 * second, 3 * second);
        assert!(!patience.exhausted());
        patience.note(1, second, Duration::ZERO);
        assert!(patience.exhausted());
        patience.note(Patience::PAUSE - 1, second, second);
        assert!(patience.exhausted());
        patience.note(1, second, second);
        assert!(!patience.exhausted());
    }
}
