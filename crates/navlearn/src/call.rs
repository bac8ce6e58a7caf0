//! One call's updates, in phases that one thread or two go through.
//!
//! Each phase has two halves, for two threads. Rows of a batch, and what the actor makes of them, are halved by rows. Of
//! two critics each half has one, for all rows, so that a thread keeps to the parameters of its own critic; a single
//! critic is halved by rows, too. Where there is never a second thread, there is one part of all rows.

use crate::adam::{Step, Vectors};
use crate::batch::ACTIONS;
use crate::error::{Error, Result};
use crate::kernels::{Isa, adam};
use crate::packed::{Packed, Shares};
use crate::part::{ActorSums, CriticSums, Judgement, Part};
use crate::real::Real;
use crate::settings::Settings;
use crate::update::{Draws, Record, Trained};
use std::ops::Range;
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// A phase of an update.
#[derive(Debug, Clone, Copy)]
enum Phase {
    Rows,
    TargetValues,
    CriticGradients,
    CriticStep,
    ActorGradients,
    ActorStep,
}

const PHASES: [Phase; 6] = [
    Phase::Rows,
    Phase::TargetValues,
    Phase::CriticGradients,
    Phase::CriticStep,
    Phase::ActorGradients,
    Phase::ActorStep,
];

// A phase has the place of its number.
const _: () = {
    let mut place = 0;
    while place < PHASES.len() {
        assert!(PHASES[place] as usize == place);
        place += 1;
    }
};

/// Memory for a batch: whatever one thread may write while the other one reads something else.
#[derive(Debug)]
pub struct Memory<T> {
    /// All rows, or their halves.
    parts: Vec<RwLock<Part<T>>>,
    /// What each critic makes of each part.
    judgements: Vec<Vec<RwLock<Judgement<T>>>>,
    /// (rows) values of each target critic for each part.
    values: Vec<Vec<RwLock<Vec<T>>>>,
}

impl<T: Real> Memory<T> {
    /// For the parts of a batch of `settings`, which are checked.
    pub fn new(settings: &Settings, parts: &[Range<usize>], isa: Isa) -> Self {
        let critics = 0..settings.critics;
        let judgement = |critic| {
            let of_part = |rows| RwLock::new(Judgement::new(settings, critic, rows, isa));
            parts.iter().map(of_part).collect()
        };
        Self {
            judgements: critics.clone().map(judgement).collect(),
            values: critics
                .map(|_| parts.iter().map(|rows| RwLock::new(vec![T::ZERO; rows.len()])).collect())
                .collect(),
            parts: parts.iter().map(|rows| RwLock::new(Part::new(settings, rows.clone(), isa))).collect(),
        }
    }

    fn judgements(&self) -> impl Iterator<Item = RwLockReadGuard<'_, Judgement<T>>> {
        self.judgements.iter().flatten().map(read)
    }
}

/// Pieces of a network's vectors, with their places.
type Share<'a, T> = Vec<(usize, Vectors<'a, T>)>;

/// A network in two shares, each for one thread at a time to write.
struct Network<'a, T> {
    shares: [RwLock<Share<'a, T>>; 2],
    rate: f64,
    /// Adam's steps before this call.
    steps: u64,
}

/// What the threads of a call share.
pub struct Call<'a, T> {
    settings: &'a Settings,
    isa: Isa,
    draws: Draws<'a>,
    actor: Network<'a, T>,
    critics: Network<'a, T>,
    memory: &'a Memory<T>,
}

// A lock is poisoned where another thread panicked; its panic goes on when the call ends, and no result is used.
fn read<T>(lock: &RwLock<T>) -> RwLockReadGuard<'_, T> {
    lock.read().unwrap_or_else(PoisonError::into_inner)
}

fn write<T>(lock: &RwLock<T>) -> RwLockWriteGuard<'_, T> {
    lock.write().unwrap_or_else(PoisonError::into_inner)
}

impl<'a, T: Real> Network<'a, T> {
    /// In shares that have each number once.
    fn new(trained: Trained<'a, T>, shares: &Shares) -> Self {
        let Trained { vectors, rate, steps } = trained;
        let mut ranges: Vec<_> = shares
            .iter()
            .enumerate()
            .flat_map(|(owner, ranges)| ranges.iter().map(move |range| (range, owner)))
            .collect();
        ranges.sort_unstable_by_key(|(range, _)| range.start);
        let (mut pieces, mut rest) = ([Vec::new(), Vec::new()], vectors);
        for (range, owner) in ranges {
            let [piece, further] = rest.split_at(range.len());
            pieces[owner].push((range.start, piece));
            rest = further;
        }
        Self { shares: pieces.map(RwLock::new), rate, steps }
    }

    fn read(&self) -> [RwLockReadGuard<'_, Share<'a, T>>; 2] {
        self.shares.each_ref().map(read)
    }

    /// Makes step number `steps` of one share with the sum of some gradients; with `tau` the targets follow.
    fn step(&self, isa: Isa, share: usize, gradients: &[&[T]], steps: u64, tau: Option<T>) {
        let step = Step::new(self.rate, steps);
        for (place, vectors) in write(&self.shares[share]).iter_mut() {
            let range = *place..*place + vectors.parameters.len();
            let second = gradients.get(1).map_or(&[][..], |gradient| &gradient[range.clone()]);
            adam(isa, step, [&gradients[0][range], second], vectors.borrow(), tau);
        }
    }
}

type Pieces<'a, T> = Vec<(usize, &'a [T])>;

/// Of both shares the vectors that `which` picks, piece by piece.
fn pieces<'a, T>(
    shares: &'a [RwLockReadGuard<'_, Share<'_, T>>; 2],
    which: impl Fn(&'a Vectors<'_, T>) -> &'a [T],
) -> Pieces<'a, T> {
    shares.iter().flat_map(|share| share.iter()).map(|(place, vectors)| (*place, which(vectors))).collect()
}

fn parameters<'a, T>(shares: &'a [RwLockReadGuard<'_, Share<'_, T>>; 2]) -> Pieces<'a, T> {
    pieces(shares, |vectors| vectors.parameters)
}

fn targets<'a, T>(shares: &'a [RwLockReadGuard<'_, Share<'_, T>>; 2]) -> Pieces<'a, T> {
    pieces(shares, |vectors| vectors.targets)
}

impl<'a, T: Real> Call<'a, T> {
    /// Of what has been checked. `shares` are those of the packed vectors of actor and critics.
    pub fn new(
        settings: &'a Settings,
        isa: Isa,
        draws: Draws<'a>,
        [actor, critics]: [Trained<'a, T>; 2],
        shares: &[Shares; 2],
        memory: &'a Memory<T>,
    ) -> Self {
        let (actor, critics) = (Network::new(actor, &shares[0]), Network::new(critics, &shares[1]));
        Self { settings, isa, draws, actor, critics, memory }
    }

    /// Makes one update; `both` does both halves of the phase of a number, for which it is given the work by half.
    ///
    /// # Errors
    /// Something overflowed.
    pub fn lead(&self, update: usize, mut both: impl FnMut(usize, &dyn Fn(usize))) -> Result<Record> {
        let mut go_through =
            |phase: Phase| both(update * PHASES.len() + phase as usize + 1, &|half| self.work(update, phase, half));
        let number = self.critics.steps + update as u64 + 1;
        go_through(Phase::Rows);
        go_through(Phase::TargetValues);
        go_through(Phase::CriticGradients);
        if !self.memory.judgements().all(|judgement| judgement.bounded) {
            return Err(Error::Critics { update: number });
        }
        go_through(Phase::CriticStep);
        let mut record = self.critic_record();
        if self.moves_targets(update) {
            go_through(Phase::ActorGradients);
            if !self.memory.parts.iter().all(|part| read(part).bounded) {
                return Err(Error::Actor { update: number });
            }
            go_through(Phase::ActorStep);
            record.actor = Some(self.actor_record());
        }
        Ok(record)
    }

    /// The second half of the phase of that number.
    pub fn help(&self, number: usize) {
        let (update, phase) = ((number - 1) / PHASES.len(), (number - 1) % PHASES.len());
        self.work(update, PHASES[phase], 1);
    }

    /// Eq. 10: the actor and the targets move once in policy_delay updates.
    fn moves_targets(&self, update: usize) -> bool {
        (self.critics.steps + update as u64 + 1).is_multiple_of(self.settings.policy_delay)
    }

    /// The critics, each with a part of the rows, which fall to one half.
    fn judged(&self, half: usize) -> Vec<(usize, usize)> {
        let parts = 0..self.memory.parts.len();
        if self.settings.critics == 2 {
            parts.map(|part| (half, part)).collect()
        } else {
            parts.filter(|&part| part == half).map(|part| (0, part)).collect()
        }
    }

    /// Does one half of a phase.
    fn work(&self, update: usize, phase: Phase, half: usize) {
        let (settings, Memory { parts, judgements, values }) = (self.settings, self.memory);
        let steps = self.critics.steps + update as u64 + 1;
        let tau = self.moves_targets(update).then(|| T::of(settings.tau));
        match phase {
            Phase::Rows => {
                let (actor, draws) = (self.actor.read(), self.draws.of_update(update, settings.batch));
                if let Some(part) = parts.get(half) {
                    write(part).take_in(settings, draws, Packed::new(&targets(&actor)));
                }
            }
            Phase::TargetValues => {
                let critics = self.critics.read();
                let critics = targets(&critics);
                for (critic, part) in self.judged(half) {
                    let (mut judgement, mut values) = (write(&judgements[critic][part]), write(&values[critic][part]));
                    judgement.judge_successors(Packed::new(&critics), &read(&parts[part]), &mut values);
                }
            }
            Phase::CriticGradients => {
                let critics = self.critics.read();
                let critics = parameters(&critics);
                for (critic, part) in self.judged(half) {
                    let values: Vec<_> = values.iter().map(|of_critic| read(&of_critic[part])).collect();
                    let both = [&values[0][..], &values[settings.critics - 1][..]];
                    let mut judgement = write(&judgements[critic][part]);
                    judgement.backward(settings, Packed::new(&critics), &read(&parts[part]), both);
                }
            }
            Phase::CriticStep => {
                let judgements: Vec<_> = judgements[half.min(settings.critics - 1)].iter().map(read).collect();
                let gradients: Vec<_> = judgements.iter().map(|judgement| &*judgement.gradient).collect();
                self.critics.step(self.isa, half, &gradients, steps, tau);
            }
            Phase::ActorGradients => {
                let (actor, critics) = (self.actor.read(), self.critics.read());
                let (actor, critics) = (parameters(&actor), parameters(&critics));
                if let Some(part) = parts.get(half) {
                    let mut judgement = write(&judgements[0][half]);
                    let (actor, critics) = (Packed::new(&actor), Packed::new(&critics));
                    write(part).actor_backward(settings, actor, critics, &mut judgement);
                }
            }
            Phase::ActorStep => {
                let parts: Vec<_> = parts.iter().map(read).collect();
                let gradients: Vec<_> = parts.iter().map(|part| &*part.gradient).collect();
                let delay = settings.policy_delay;
                let steps = self.actor.steps + steps / delay - self.critics.steps / delay;
                self.actor.step(self.isa, half, &gradients, steps, tau);
            }
        }
    }

    fn critic_record(&self) -> Record {
        let sums = self.memory.judgements().flat_map(|judgement| judgement.sums);
        let total = sums.fold(CriticSums::NONE, CriticSums::and);
        let (rows, count) = (self.settings.batch as f64, self.settings.critics as f64);
        Record {
            critic_loss: total.squares / rows,
            average_q: total.values / (count * rows),
            maximum_q: total.maximum,
            actor: None,
        }
    }

    /// The actor's loss, and the share of its outputs that are saturated.
    fn actor_record(&self) -> [f64; 2] {
        let sums = self.memory.parts.iter().flat_map(|part| read(part).sums);
        let total = sums.fold(ActorSums::NONE, ActorSums::and);
        let rows = self.settings.batch as f64;
        let outputs = ACTIONS as f64 * rows;
        [self.settings.pretanh_penalty * total.squares / outputs - total.values / rows, total.saturated / outputs]
    }
}
