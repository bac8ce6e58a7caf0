//! One call's updates, in phases that one thread or two go through.
//!
//! The phases of an update: gradients of the critics, their step; and where the actor moves, its gradients and its step.
//! Each has two halves, for two threads: gradients are computed from two parts of the batch, and a step is made in two
//! pieces of the packed vectors. Where there is never a second thread, the first half is all there is.

use crate::adam::{Step, Vectors};
use crate::batch::ACTIONS;
use crate::error::{Error, Result};
use crate::kernels::{Isa, adam};
use crate::packed::Packed;
use crate::part::{ActorSums, CriticSums, Part};
use crate::real::Real;
use crate::settings::Settings;
use crate::update::{Draws, Record, Trained};
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// A phase of an update.
#[derive(Debug, Clone, Copy)]
enum Phase {
    CriticGradients,
    CriticStep,
    ActorGradients,
    ActorStep,
}

const PHASES: [Phase; 4] = [Phase::CriticGradients, Phase::CriticStep, Phase::ActorGradients, Phase::ActorStep];

/// A network in two pieces, each for one thread at a time to write.
struct Network<'a, T> {
    pieces: [RwLock<Vectors<'a, T>>; 2],
    /// Where the second piece begins, and where it ends.
    cut: usize,
    end: usize,
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
    /// The whole batch, or its halves.
    parts: &'a [RwLock<Part<T>>],
}

// A lock is poisoned where another thread panicked; its panic goes on when the call ends, and no result is used.
fn read<T>(lock: &RwLock<T>) -> RwLockReadGuard<'_, T> {
    lock.read().unwrap_or_else(PoisonError::into_inner)
}

fn write<T>(lock: &RwLock<T>) -> RwLockWriteGuard<'_, T> {
    lock.write().unwrap_or_else(PoisonError::into_inner)
}

impl<'a, T: Real> Network<'a, T> {
    fn new(trained: Trained<'a, T>, cut: usize) -> Self {
        let Trained { vectors, rate, steps } = trained;
        let end = vectors.parameters.len();
        Self { pieces: vectors.split_at(cut).map(RwLock::new), cut, end, rate, steps }
    }

    fn read(&self) -> [RwLockReadGuard<'_, Vectors<'a, T>>; 2] {
        self.pieces.each_ref().map(read)
    }

    /// Makes step number `steps` of one piece with the sum of the parts' gradients; with `tau` the targets follow.
    fn step(
        &self,
        isa: Isa,
        piece: usize,
        parts: &[RwLock<Part<T>>],
        gradient: impl Fn(&Part<T>) -> &[T],
        steps: u64,
        tau: Option<T>,
    ) {
        let range = [0..self.cut, self.cut..self.end][piece].clone();
        let step = Step::new(self.rate, steps);
        let mut vectors = write(&self.pieces[piece]);
        let first = read(&parts[0]);
        let second = parts.get(1).map(read);
        let second = second.as_ref().map_or(&[][..], |part| &gradient(part)[range.clone()]);
        adam(isa, step, [&gradient(&first)[range], second], vectors.borrow(), tau);
    }
}

fn parameters<'a, T>(pieces: &'a [RwLockReadGuard<'_, Vectors<'_, T>>; 2]) -> Packed<'a, T> {
    Packed::new(pieces.each_ref().map(|piece| &*piece.parameters))
}

fn targets<'a, T>(pieces: &'a [RwLockReadGuard<'_, Vectors<'_, T>>; 2]) -> Packed<'a, T> {
    Packed::new(pieces.each_ref().map(|piece| &*piece.targets))
}

impl<'a, T: Real> Call<'a, T> {
    /// Of what has been checked. `cuts` are where the second pieces of actor and critics begin, `parts` the whole batch
    /// or its halves.
    pub fn new(
        settings: &'a Settings,
        isa: Isa,
        draws: Draws<'a>,
        [actor, critics]: [Trained<'a, T>; 2],
        cuts: [usize; 2],
        parts: &'a [RwLock<Part<T>>],
    ) -> Self {
        let (actor, critics) = (Network::new(actor, cuts[0]), Network::new(critics, cuts[1]));
        Self { settings, isa, draws, actor, critics, parts }
    }

    /// Makes one update; `both` does both halves of the phase of a number, for which it is given the work by half.
    ///
    /// # Errors
    /// Something overflowed.
    pub fn lead(&self, update: usize, mut both: impl FnMut(usize, &dyn Fn(usize))) -> Result<Record> {
        let mut go_through =
            |phase: Phase| both(update * PHASES.len() + phase as usize + 1, &|half| self.work(update, phase, half));
        let number = self.critics.steps + update as u64 + 1;
        let bounded = || self.parts.iter().all(|part| read(part).bounded);
        go_through(Phase::CriticGradients);
        if !bounded() {
            return Err(Error::Critics { update: number });
        }
        go_through(Phase::CriticStep);
        let mut record = self.critic_record();
        if self.moves_targets(update) {
            go_through(Phase::ActorGradients);
            if !bounded() {
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

    /// Computes the gradients of one part, if there is that one, or makes the step of one piece with the sum of their
    /// gradients.
    fn work(&self, update: usize, phase: Phase, half: usize) {
        let (settings, delay) = (self.settings, self.settings.policy_delay);
        let own_part = || self.parts.get(half).map(write);
        let tau = self.moves_targets(update).then(|| T::of(settings.tau));
        match phase {
            Phase::CriticGradients => {
                let (Some(mut part), actor, critics) = (own_part(), self.actor.read(), self.critics.read()) else {
                    return;
                };
                let draws = self.draws.of_update(update, settings.batch);
                part.set_targets(settings, draws, targets(&actor), targets(&critics));
                part.critics_backward(settings, parameters(&critics));
            }
            Phase::CriticStep => {
                let steps = self.critics.steps + update as u64 + 1;
                self.critics.step(self.isa, half, self.parts, |part| &part.critic_gradient, steps, tau);
            }
            Phase::ActorGradients => {
                let (Some(mut part), actor, critics) = (own_part(), self.actor.read(), self.critics.read()) else {
                    return;
                };
                part.actor_backward(settings, parameters(&actor), parameters(&critics));
            }
            Phase::ActorStep => {
                let before = self.critics.steps / delay;
                let steps = self.actor.steps + (self.critics.steps + update as u64 + 1) / delay - before;
                self.actor.step(self.isa, half, self.parts, |part| &part.actor_gradient, steps, tau);
            }
        }
    }

    fn critic_record(&self) -> Record {
        let sums = self.parts.iter().flat_map(|part| read(part).critic_sums);
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
        let sums = self.parts.iter().flat_map(|part| read(part).actor_sums);
        let total = sums.fold(ActorSums::NONE, ActorSums::and);
        let rows = self.settings.batch as f64;
        let outputs = ACTIONS as f64 * rows;
        [self.settings.pretanh_penalty * total.squares / outputs - total.values / rows, total.saturated / outputs]
    }
}
