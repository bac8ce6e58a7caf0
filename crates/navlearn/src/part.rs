//! A part of a batch, or all of it: memory for its rows, and what is computed from them.
//!
//! Whatever is summed over the rows of a batch is summed over its first rows, up to a fixed place in the middle, and
//! over the others, and then added: so that two parts give the same bits as the whole.

use crate::batch::{ACTIONS, Batch};
use crate::kernels::{Isa, all_bounded};
use crate::network::{Actor, Critics};
use crate::packed::Packed;
use crate::real::Real;
use crate::settings::Settings;
use crate::update::Draws;
use std::ops::Range;

/// |input of the actor's tanh| beyond which an output counts as saturated: |output| > 0.99, gradient under 0.02.
pub const SATURATED: f64 = 2.646_652_4;

/// What the critics tell of some rows.
#[derive(Debug, Clone, Copy)]
pub struct CriticSums {
    /// Of squared errors.
    pub squares: f64,
    /// Of values.
    pub values: f64,
    /// The largest value.
    pub maximum: f64,
}

/// What the actor tells of some rows.
#[derive(Debug, Clone, Copy)]
pub struct ActorSums {
    /// Of the first critic's values of its actions.
    pub values: f64,
    /// Of the squared inputs of its tanh.
    pub squares: f64,
    /// Of its saturated outputs.
    pub saturated: f64,
}

impl CriticSums {
    /// Of no rows.
    pub const NONE: Self = Self { squares: 0.0, values: 0.0, maximum: f64::NEG_INFINITY };

    /// Of these rows and others.
    pub fn and(self, other: Self) -> Self {
        let (squares, values) = (self.squares + other.squares, self.values + other.values);
        Self { squares, values, maximum: self.maximum.max(other.maximum) }
    }
}

impl ActorSums {
    /// Of no rows.
    pub const NONE: Self = Self { values: 0.0, squares: 0.0, saturated: 0.0 };

    /// Of these rows and others.
    pub fn and(self, other: Self) -> Self {
        let (values, squares) = (self.values + other.values, self.squares + other.squares);
        Self { values, squares, saturated: self.saturated + other.saturated }
    }
}

/// Some rows of a batch.
#[derive(Debug)]
pub struct Part<T> {
    isa: Isa,
    /// Which rows of the batch.
    rows: Range<usize>,
    /// The same, counted from the first, in the two parts of every sum; the second may be empty.
    parts: [Range<usize>; 2],
    batch: Batch<T>,
    actor: Actor<T>,
    critics: Critics<T>,
    /// (2, rows) actions of the actor or its target, and dL/d of what they come from.
    actions: Vec<T>,
    action_upper: Vec<T>,
    /// (rows) y of equation 9.
    targets: Vec<T>,
    /// (critics, rows) dL/dQ.
    value_upper: Vec<T>,
    /// Gradients of the packed vectors, without the other rows' share.
    pub actor_gradient: Vec<T>,
    /// As for the actor.
    pub critic_gradient: Vec<T>,
    /// Where the actor's update leaves what it does not need.
    spare_gradient: Vec<T>,
    /// What the last gradients tell, in two parts.
    pub critic_sums: [CriticSums; 2],
    /// As for the critics.
    pub actor_sums: [ActorSums; 2],
    /// Whether the last gradient is so small that its sum with another one is finite.
    pub bounded: bool,
}

impl<T: Real> Part<T> {
    /// Memory for some rows of the batch of `settings`, which are checked.
    ///
    /// # Panics
    /// If there are no rows.
    pub fn new(settings: &Settings, rows: Range<usize>, isa: Isa) -> Self {
        assert!(!rows.is_empty(), "a part without rows");
        let (size, cut) = (rows.len(), settings.cut().clamp(rows.start, rows.end) - rows.start);
        // All rows belong to the first sum where they do not lie on both sides of the cut.
        let cut = if cut == 0 { size } else { cut };
        let Settings { actor, critic, action_weight, frozen_combined, critics: count, .. } = settings.clone();
        Self {
            isa,
            rows,
            parts: [0..cut, cut..size],
            batch: Batch::new(settings.inputs(), size),
            actor: Actor::new(&actor, [size, cut], isa),
            critics: Critics::new(critic, action_weight, frozen_combined, count, [size, cut], isa),
            actions: vec![T::ZERO; ACTIONS * size],
            action_upper: vec![T::ZERO; ACTIONS * size],
            targets: vec![T::ZERO; size],
            value_upper: vec![T::ZERO; count * size],
            actor_gradient: vec![T::ZERO; settings.sizes[0]],
            critic_gradient: vec![T::ZERO; settings.sizes[1]],
            spare_gradient: vec![T::ZERO; settings.sizes[1]],
            critic_sums: [CriticSums::NONE; 2],
            actor_sums: [ActorSums::NONE; 2],
            bounded: false,
        }
    }

    /// Takes in its rows of a batch and sets y of equation 9, with the target networks of `actor` and `critics`.
    pub fn set_targets(&mut self, settings: &Settings, draws: Draws<'_>, actor: Packed<'_, T>, critics: Packed<'_, T>) {
        let (rows, size) = (self.rows.clone(), self.rows.len());
        let (indices, mirrored) = (&draws.indices[rows.clone()], &draws.mirrored[rows.clone()]);
        self.batch.gather(draws.replay, indices, mirrored, settings.mirror.as_ref());
        // Eq. 9: y = R + gamma^m (1 - terminated) min(Q1', Q2')(s', clip(mu'(s') + clip(N(0, sigma), +-c), +-1))
        self.actor.forward(actor, self.batch.successors());
        let noise = &draws.noise[ACTIONS * rows.start..ACTIONS * rows.end];
        let outputs = self.actor.outputs.chunks_exact(size);
        for (k, (actions, outputs)) in self.actions.chunks_exact_mut(size).zip(outputs).enumerate() {
            for ((action, output), noise) in actions.iter_mut().zip(outputs).zip(noise.chunks_exact(ACTIONS)) {
                *action = (output.tanh() + T::of(f64::from(noise[k]))).within(-T::ONE, T::ONE);
            }
        }
        self.critics.forward(critics, self.batch.successors(), &self.actions, settings.critics);
        let [low, high] = settings.bounds.map(T::of);
        let (first, second) = self.critics.outputs.split_at(size);
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

    /// Sets the critics' gradient for the rows that were taken in, and what they tell.
    pub fn critics_backward(&mut self, settings: &Settings, critics: Packed<'_, T>) {
        let size = self.rows.len();
        self.critics.forward(critics, self.batch.observations(), self.batch.actions(), settings.critics);
        // L = sum over the critics of the mean over the batch of (Q - y)^2, so dL/dQ = 2 (Q - y) / B
        let factor = T::of(2.0 / settings.batch as f64);
        for (sums, part) in self.critic_sums.iter_mut().zip(&self.parts) {
            *sums = CriticSums::NONE;
            let outputs = self.critics.outputs.chunks_exact(size);
            for (upper, outputs) in self.value_upper.chunks_exact_mut(size).zip(outputs) {
                let values = outputs[part.clone()].iter().zip(&self.targets[part.clone()]);
                for (upper, (&q, &y)) in upper[part.clone()].iter_mut().zip(values) {
                    let error = q - y;
                    *upper = error * factor;
                    sums.squares += error.wide() * error.wide();
                    sums.values += q.wide();
                    sums.maximum = q.wide().max(sums.maximum);
                }
            }
        }
        let (observations, actions) = (self.batch.observation_rows(), self.batch.actions());
        let gradient = &mut self.critic_gradient;
        self.critics.backward(critics, observations, actions, &self.value_upper, gradient);
        self.bounded = all_bounded(self.isa, &self.value_upper) && all_bounded(self.isa, gradient);
    }

    /// Sets the actor's gradient for the rows that were taken in, and what they tell.
    pub fn actor_backward(&mut self, settings: &Settings, actor: Packed<'_, T>, critics: Packed<'_, T>) {
        let size = self.rows.len();
        self.actor.forward(actor, self.batch.observations());
        for (action, output) in self.actions.iter_mut().zip(&self.actor.outputs) {
            *action = output.tanh();
        }
        self.critics.forward(critics, self.batch.observations(), &self.actions, 1);
        // L = mean of -Q1(s, mu(s)) + penalty * mean of z^2 with mu = tanh(z), where the penalty keeps tanh from
        // saturating; so dL/dz = -dQ1/da (1 - mu^2) / B + penalty * z / B, with two outputs z a row
        let share = 1.0 / settings.batch as f64;
        let upper = &mut self.value_upper[..size];
        upper.fill(T::of(-share));
        self.critics.action_gradient(critics, upper, &mut self.spare_gradient, &mut self.action_upper);
        let penalty = T::of(settings.pretanh_penalty * share);
        for ((upper, &action), &z) in self.action_upper.iter_mut().zip(&self.actions).zip(&self.actor.outputs) {
            *upper = *upper * (T::ONE - action * action) + penalty * z;
        }
        for (sums, part) in self.actor_sums.iter_mut().zip(&self.parts) {
            *sums = ActorSums::NONE;
            for z in self.actor.outputs.chunks_exact(size).flat_map(|outputs| &outputs[part.clone()]) {
                sums.squares += z.wide() * z.wide();
                sums.saturated += f64::from(z.wide().abs() > SATURATED);
            }
            sums.values = self.critics.outputs[part.clone()].iter().map(|q| q.wide()).sum();
        }
        let (observations, gradient) = (self.batch.observation_rows(), &mut self.actor_gradient);
        self.actor.backward(actor, observations, &self.action_upper, gradient);
        let finite = self.actor_sums.iter().all(|sums| sums.values.is_finite());
        self.bounded = finite && all_bounded(self.isa, &self.action_upper) && all_bounded(self.isa, gradient);
    }
}
