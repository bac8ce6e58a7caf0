//! The update of TD3, with DDPG as its one-critic case (equations 9 and 10).

use crate::act::Acting;
use crate::adam::{Moments, Step};
use crate::batch::{ACTIONS, Batch, width};
use crate::error::{Error, Result, expect, expect_size};
use crate::kernels::{Isa, adam, adam_and_follow, all_finite, rows_finite};
use crate::network::{Actor, Critics};
use crate::real::Real;
use crate::settings::Settings;

/// |input of the actor's tanh| beyond which an output counts as saturated: |output| > 0.99.
const SATURATED: f64 = 2.646_652_4;

/// The vectors of a network and its target, which an update changes.
#[derive(Debug)]
pub struct Trained<'a, T> {
    /// The parameters.
    pub parameters: &'a mut [T],
    /// Parameters of the target network.
    pub targets: &'a mut [T],
    /// Adam's moments.
    pub moments: Moments<'a, T>,
    /// Adam's step size.
    pub rate: f64,
    /// Adam's steps so far.
    pub steps: u64,
}

/// What the updates of one call draw: rows of replay, and noise on the target's actions.
#[derive(Debug, Clone, Copy)]
pub struct Draws<'a> {
    /// (rows, width) replay.
    pub replay: &'a [f32],
    /// Columns of replay.
    pub width: usize,
    /// (updates, batch) places in replay.
    pub indices: &'a [i64],
    /// (updates, batch) which rows are mirrored.
    pub mirrored: &'a [bool],
    /// (updates, batch, 2) clip(N(0, policy_noise), +-noise_clip).
    pub noise: &'a [f32],
}

/// What one update tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// Mean squared error of the critics' values, summed over the critics.
    pub critic_loss: f64,
    /// Mean value over batch and critics.
    pub average_q: f64,
    /// Largest value.
    pub maximum_q: f64,
    /// The actor's loss and the share of its outputs that are saturated, if it stepped.
    pub actor: Option<[f64; 2]>,
}

/// Makes updates: sizes, settings and memory of one batch.
#[derive(Debug)]
pub struct Learner<T> {
    settings: Settings,
    isa: Isa,
    batch: Batch<T>,
    actor: Actor<T>,
    critics: Critics<T>,
    /// (2, batch) actions of the actor or its target, and dL/d of what they come from.
    actions: Vec<T>,
    action_upper: Vec<T>,
    /// (batch) y of equation 9.
    targets: Vec<T>,
    /// (critics, batch) dL/dQ.
    value_upper: Vec<T>,
    actor_gradient: Vec<T>,
    critic_gradient: Vec<T>,
    /// Where the actor's update leaves what it does not need.
    spare_gradient: Vec<T>,
    acting: Acting<T>,
}

impl<T: Real> Learner<T> {
    /// Takes memory for one batch.
    ///
    /// # Errors
    /// Those of [`Settings::check`].
    pub fn new(settings: Settings, isa: Isa) -> Result<Self> {
        settings.check()?;
        let (batch, inputs) = (settings.batch, settings.inputs());
        let Settings { actor, critic, action_weight, frozen_combined, critics: count, .. } = settings.clone();
        Ok(Self {
            batch: Batch::new(inputs, batch),
            actor: Actor::new(&actor, batch, isa),
            critics: Critics::new(critic, action_weight, frozen_combined, count, batch, isa),
            actions: vec![T::ZERO; ACTIONS * batch],
            action_upper: vec![T::ZERO; ACTIONS * batch],
            targets: vec![T::ZERO; batch],
            value_upper: vec![T::ZERO; count * batch],
            actor_gradient: vec![T::ZERO; settings.sizes[0]],
            critic_gradient: vec![T::ZERO; settings.sizes[1]],
            spare_gradient: vec![T::ZERO; settings.sizes[1]],
            acting: Acting::new(&settings, isa),
            settings,
            isa,
        })
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What acts, with the settings' actor.
    pub fn acting(&mut self) -> &mut Acting<T> {
        &mut self.acting
    }

    /// Makes one update for each row of `draws.indices`.
    ///
    /// # Errors
    /// A number is not finite, a slice has another length than the settings imply, a row to mirror has no mirror, or an
    /// index is beyond replay; see [`Error`] for what has changed then.
    pub fn update(
        &mut self,
        actor: &mut Trained<'_, T>,
        critics: &mut Trained<'_, T>,
        draws: Draws<'_>,
    ) -> Result<Vec<Record>> {
        self.check(actor, critics, draws)?;
        let batch = self.settings.batch;
        let draws_of_updates = draws
            .indices
            .chunks_exact(batch)
            .zip(draws.mirrored.chunks_exact(batch))
            .zip(draws.noise.chunks_exact(ACTIONS * batch));
        draws_of_updates
            .map(|((indices, mirrored), noise)| {
                self.batch.gather(draws.replay, indices, mirrored, self.settings.mirror.as_ref());
                self.set_targets(actor.targets, critics.targets, noise);
                // Eq. 10: the actor and the targets move once in policy_delay updates.
                let moves_targets = (critics.steps + 1).is_multiple_of(self.settings.policy_delay);
                let mut record = self.update_critics(critics, moves_targets)?;
                if moves_targets {
                    record.actor = Some(self.update_actor(actor, critics)?);
                }
                Ok(record)
            })
            .collect()
    }

    /// y of equation 9.
    fn set_targets(&mut self, actor: &[T], critics: &[T], noise: &[f32]) {
        // Eq. 9: y = R + gamma^m (1 - terminated) min(Q1', Q2')(s', clip(mu'(s') + clip(N(0, sigma), +-c), +-1))
        let batch = self.settings.batch;
        self.actor.forward(actor, self.batch.successors());
        for (k, (actions, outputs)) in
            self.actions.chunks_exact_mut(batch).zip(self.actor.outputs.chunks_exact(batch)).enumerate()
        {
            for ((action, output), noise) in actions.iter_mut().zip(outputs).zip(noise.chunks_exact(ACTIONS)) {
                *action = (output.tanh() + T::of(f64::from(noise[k]))).within(-T::ONE, T::ONE);
            }
        }
        self.critics.forward(critics, self.batch.successors(), &self.actions, self.settings.critics);
        let [low, high] = self.settings.bounds.map(T::of);
        let (first, second) = self.critics.outputs.split_at(batch);
        let second = if second.is_empty() { first } else { second };
        let rows = self.batch.returns().iter().zip(self.batch.bootstrap());
        for ((target, (&reward, &bootstrap)), (&a, &b)) in
            self.targets.iter_mut().zip(rows).zip(first.iter().zip(second))
        {
            // Of two values of which one is NaN, the sum is NaN too.
            let least = if a < b {
                a
            } else if b <= a {
                b
            } else {
                a + b
            };
            *target = (reward + bootstrap * least).within(low, high);
        }
    }

    /// One step of the critics, and of their targets where it is time.
    fn update_critics(&mut self, critics: &mut Trained<'_, T>, moves_targets: bool) -> Result<Record> {
        let Settings { batch, critics: count, tau, .. } = self.settings;
        let overflow = Error::Critics { update: critics.steps + 1 };
        self.critics.forward(critics.parameters, self.batch.observations(), self.batch.actions(), count);
        let (mut loss, mut sum, mut maximum) = (0.0, 0.0, f64::NEG_INFINITY);
        // L = sum over the critics of the mean over the batch of (Q - y)^2, so dL/dQ = 2 (Q - y) / B
        let factor = T::of(2.0 / batch as f64);
        let targets = self.targets.iter().cycle();
        for ((upper, &q), &y) in self.value_upper.iter_mut().zip(&self.critics.outputs).zip(targets) {
            let error = q - y;
            *upper = error * factor;
            loss += error.wide() * error.wide();
            sum += q.wide();
            maximum = q.wide().max(maximum);
        }
        if !all_finite(self.isa, &self.value_upper) {
            return Err(overflow);
        }
        let gradient = &mut self.critic_gradient;
        let (observations, actions) = (self.batch.observation_rows(), self.batch.actions());
        self.critics.backward(critics.parameters, observations, actions, &self.value_upper, gradient);
        if !all_finite(self.isa, gradient) {
            return Err(overflow);
        }
        critics.step(self.isa, gradient, moves_targets.then(|| T::of(tau)));
        let record = Record {
            critic_loss: loss / batch as f64,
            average_q: sum / (count * batch) as f64,
            maximum_q: maximum,
            actor: None,
        };
        Ok(record)
    }

    /// One step of the actor and its target; returns its loss and the share of saturated outputs before it.
    fn update_actor(&mut self, actor: &mut Trained<'_, T>, critics: &Trained<'_, T>) -> Result<[f64; 2]> {
        let Settings { batch, tau, pretanh_penalty, .. } = self.settings;
        let overflow = Error::Actor { update: critics.steps };
        self.actor.forward(actor.parameters, self.batch.observations());
        for (action, output) in self.actions.iter_mut().zip(&self.actor.outputs) {
            *action = output.tanh();
        }
        self.critics.forward(critics.parameters, self.batch.observations(), &self.actions, 1);
        // L = mean of -Q1(s, mu(s)) + penalty * mean of z^2 with mu = tanh(z), where the penalty keeps tanh from
        // saturating; so dL/dz = -dQ1/da (1 - mu^2) / B + penalty * z / B, with two outputs z a row
        let share = 1.0 / batch as f64;
        let upper = &mut self.value_upper[..batch];
        upper.fill(T::of(-share));
        self.critics.action_gradient(critics.parameters, upper, &mut self.spare_gradient, &mut self.action_upper);
        let penalty = T::of(pretanh_penalty * share);
        let (mut squares, mut saturated) = (0.0, 0.0);
        for ((upper, &action), &z) in self.action_upper.iter_mut().zip(&self.actions).zip(&self.actor.outputs) {
            *upper = *upper * (T::ONE - action * action) + penalty * z;
            squares += z.wide() * z.wide();
            saturated += f64::from(z.wide().abs() > SATURATED);
        }
        let value: f64 = self.critics.outputs[..batch].iter().map(|q| q.wide()).sum();
        let gradient = &mut self.actor_gradient;
        self.actor.backward(actor.parameters, self.batch.observation_rows(), &self.action_upper, gradient);
        if !value.is_finite() || !all_finite(self.isa, &self.action_upper) || !all_finite(self.isa, gradient) {
            return Err(overflow);
        }
        actor.step(self.isa, gradient, Some(T::of(tau)));
        let outputs = (ACTIONS * batch) as f64;
        Ok([pretanh_penalty * squares / outputs - value * share, saturated / outputs])
    }

    /// Refuses sizes that do not fit, and names the first number that is not finite.
    fn check(&self, actor: &Trained<'_, T>, critics: &Trained<'_, T>, draws: Draws<'_>) -> Result<()> {
        let (batch, width, count) = (self.settings.batch, width(self.settings.inputs()), draws.indices.len());
        for (network, trained, size) in
            [("actor", actor, self.settings.sizes[0]), ("critic", critics, self.settings.sizes[1])]
        {
            let rate = trained.rate;
            expect(format!("the {network}'s rate"), rate, rate >= 0.0 && rate.is_finite(), || "at least 0".into())?;
            for (vector, numbers) in trained.vectors() {
                expect_size(format!("the {network}'s {vector}"), numbers.len(), size)?;
                if !all_finite(self.isa, numbers) {
                    let place = numbers.iter().position(|x| !x.finite()).unwrap_or_default();
                    return Err(Error::Parameter { network, vector, place });
                }
            }
        }
        expect_size("columns of replay", draws.width, width)?;
        expect("indices", count, count.is_multiple_of(batch), || format!("a multiple of {batch}"))?;
        expect_size("mirrored", draws.mirrored.len(), count)?;
        expect_size("noise", draws.noise.len(), ACTIONS * count)?;
        let flips = draws.mirrored.iter().filter(|&&flip| flip).count();
        expect("rows to mirror", flips, flips == 0 || self.settings.mirror.is_some(), || "0 without a mirror".into())?;
        if let Some(place) = draws.noise.iter().position(|noise| !noise.is_finite()) {
            return Err(Error::Noise { place });
        }
        let rows = draws.replay.len() / width;
        let (lowest, highest) = draws.indices.iter().fold((0, 0), |(low, high), &i| (low.min(i), high.max(i)));
        expect("an index", lowest, lowest >= 0, || "at least 0".into())?;
        expect("an index", highest, (highest as usize) < rows, || format!("less than {rows}"))?;
        if rows_finite(self.isa, draws.replay, width, draws.indices) {
            return Ok(());
        }
        let columns = |&index: &i64| draws.replay[index as usize * width..][..width].iter();
        let bad = |index| columns(index).position(|x| !x.is_finite()).map(|column| (*index as usize, column));
        let (row, column) = draws.indices.iter().find_map(bad).unwrap_or_default();
        Err(Error::Row { row, column })
    }
}

impl<T: Real> Trained<'_, T> {
    /// One step of Adam, and with `tau` the soft update of the targets.
    fn step(&mut self, isa: Isa, gradient: &[T], tau: Option<T>) {
        self.steps += 1;
        let step = Step::new(self.rate, self.steps);
        let moments = Moments { first: self.moments.first, second: self.moments.second };
        match tau {
            Some(tau) => adam_and_follow(isa, step, gradient, moments, self.parameters, self.targets, tau),
            None => adam(isa, step, gradient, moments, self.parameters),
        }
    }

    fn vectors(&self) -> [(&'static str, &[T]); 4] {
        [
            ("parameters", self.parameters),
            ("targets", self.targets),
            ("first moments", self.moments.first),
            ("second moments", self.moments.second),
        ]
    }
}
