//! A part of a batch, or all of it: memory for its rows, and what is computed from them.
//!
//! Whatever is summed over the rows of a batch is summed over its first rows, up to a fixed place in the middle, and
//! over the others, and then added: so that two parts give the same bits as the whole.

use crate::aligned::Aligned;
use crate::batch::{ACTIONS, Batch};
use crate::kernels::{Isa, all_bounded};
use crate::network::{Actor, Critic};
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

/// Some rows of a batch, and what the actor makes of them.
#[derive(Debug)]
pub struct Part<T> {
    isa: Isa,
    /// Which rows of the batch.
    rows: Range<usize>,
    cut: Cut,
    batch: Batch<T>,
    actor: Actor<T>,
    /// (2, rows) actions of the actor or its target, and dL/d of what they come from.
    actions: Vec<T>,
    action_upper: Vec<T>,
    /// Gradient of the actor's packed vector, without the other rows' share.
    pub gradient: Aligned<T>,
    /// What it tells, in two parts.
    pub sums: [ActorSums; 2],
    /// Whether it is so small that its sum with another one is finite.
    pub bounded: bool,
}

/// What a critic makes of the rows of a part.
#[derive(Debug)]
pub struct Judgement<T> {
    isa: Isa,
    cut: Cut,
    critic: Critic<T>,
    /// Where its parameters lie.
    ranges: Vec<Range<usize>>,
    /// (rows) dL/dQ.
    upper: Vec<T>,
    /// Gradient of the critics' packed vector in the places of this one, without the other rows' share.
    pub gradient: Aligned<T>,
    /// What it tells, in two parts.
    pub sums: [CriticSums; 2],
    /// Whether it is so small that its sum with another one is finite.
    pub bounded: bool,
}

/// The rows of a part, counted from its first one, in the two parts of every sum; the second may be empty.
type Cut = [Range<usize>; 2];

fn cut(settings: &Settings, rows: &Range<usize>) -> Cut {
    let place = settings.cut().clamp(rows.start, rows.end) - rows.start;
    // All rows belong to the first sum where they do not lie on both sides of the cut.
    let place = if place == 0 { rows.len() } else { place };
    [0..place, place..rows.len()]
}

impl<T: Real> Part<T> {
    /// Memory for some rows of the batch of `settings`, which are checked.
    ///
    /// # Panics
    /// If there are no rows.
    pub fn new(settings: &Settings, rows: Range<usize>, isa: Isa) -> Self {
        assert!(!rows.is_empty(), "a part without rows");
        let (size, cut) = (rows.len(), cut(settings, &rows));
        Self {
            isa,
            batch: Batch::new(settings.inputs(), size),
            actor: Actor::new(&settings.actor, [size, cut[0].end], isa),
            rows,
            cut,
            actions: vec![T::ZERO; ACTIONS * size],
            action_upper: vec![T::ZERO; ACTIONS * size],
            gradient: Aligned::zeros(settings.sizes[0]),
            sums: [ActorSums::NONE; 2],
            bounded: false,
        }
    }

    /// Takes in its rows of a batch, and the actions of the target `actor` after them.
    pub fn take_in(&mut self, settings: &Settings, draws: Draws<'_>, actor: Packed<'_, T>) {
        let (rows, size) = (self.rows.clone(), self.rows.len());
        let (indices, mirrored) = (&draws.indices[rows.clone()], &draws.mirrored[rows.clone()]);
        self.batch.gather(draws.replay, indices, mirrored, settings.mirror.as_ref());
        self.actor.forward(actor, self.batch.successors());
        let noise = &draws.noise[ACTIONS * rows.start..ACTIONS * rows.end];
        let outputs = self.actor.outputs.chunks_exact(size);
        for (k, (actions, outputs)) in self.actions.chunks_exact_mut(size).zip(outputs).enumerate() {
            for ((action, output), noise) in actions.iter_mut().zip(outputs).zip(noise.chunks_exact(ACTIONS)) {
                *action = (output.tanh() + T::of(f64::from(noise[k]))).within(-T::ONE, T::ONE);
            }
        }
    }

    /// Sets the actor's gradient for the rows that were taken in, and what it tells; the first critic judges.
    pub fn actor_backward(
        &mut self,
        settings: &Settings,
        actor: Packed<'_, T>,
        critics: Packed<'_, T>,
        Judgement { critic, upper, gradient: overwritten, .. }: &mut Judgement<T>,
    ) {
        self.actor.forward(actor, self.batch.observations());
        for (action, output) in self.actions.iter_mut().zip(&self.actor.outputs) {
            *action = output.tanh();
        }
        critic.forward(critics, self.batch.observations(), &self.actions);
        // L = mean of -Q1(s, mu(s)) + penalty * mean of z^2 with mu = tanh(z), where the penalty keeps tanh from
        // saturating; so dL/dz = -dQ1/da (1 - mu^2) / B + penalty * z / B, with two outputs z a row
        let share = 1.0 / settings.batch as f64;
        upper.fill(T::of(-share));
        critic.action_gradient(critics, upper, overwritten, &mut self.action_upper);
        let penalty = T::of(settings.pretanh_penalty * share);
        for ((upper, &action), &z) in self.action_upper.iter_mut().zip(&self.actions).zip(&self.actor.outputs) {
            *upper = *upper * (T::ONE - action * action) + penalty * z;
        }
        for (sums, part) in self.sums.iter_mut().zip(&self.cut) {
            *sums = ActorSums::NONE;
            for z in self.actor.outputs.chunks_exact(self.rows.len()).flat_map(|outputs| &outputs[part.clone()]) {
                sums.squares += z.wide() * z.wide();
                sums.saturated += f64::from(z.wide().abs() > SATURATED);
            }
            sums.values = critic.outputs[part.clone()].iter().map(|q| q.wide()).sum();
        }
        self.actor.backward(actor, self.batch.observation_rows(), &self.action_upper, &mut self.gradient);
        let finite = self.sums.iter().all(|sums| sums.values.is_finite());
        self.bounded = finite && all_bounded(self.isa, &self.action_upper) && all_bounded(self.isa, &self.gradient);
    }
}

impl<T: Real> Judgement<T> {
    /// Memory for a critic and some rows of the batch of `settings`, which are checked.
    pub fn new(settings: &Settings, critic: usize, rows: &Range<usize>, isa: Isa) -> Self {
        let (size, cut) = (rows.len(), cut(settings, rows));
        let (layers, action_weights) = (settings.critic_layers(critic), settings.action_weights(critic));
        Self {
            isa,
            critic: Critic::new(layers, action_weights, settings.frozen_combined, [size, cut[0].end], isa),
            cut,
            ranges: settings.critic_ranges(critic),
            upper: vec![T::ZERO; size],
            gradient: Aligned::zeros(settings.sizes[1]),
            sums: [CriticSums::NONE; 2],
            bounded: false,
        }
    }

    /// Sets `values` to Q'(s', a') of the target critic for what a part has taken in.
    pub fn judge_successors(&mut self, critic: Packed<'_, T>, part: &Part<T>, values: &mut [T]) {
        self.critic.forward(critic, part.batch.successors(), &part.actions);
        values.copy_from_slice(&self.critic.outputs);
    }

    /// Sets the critic's gradient for what a part has taken in, and what it tells; `values` are those of the target
    /// critics, of which both may be the same.
    pub fn backward(&mut self, settings: &Settings, critic: Packed<'_, T>, part: &Part<T>, values: [&[T]; 2]) {
        let batch = &part.batch;
        self.critic.forward(critic, batch.observations(), batch.actions());
        let [low, high] = settings.bounds.map(T::of);
        // L = sum over the critics of the mean over the batch of (Q - y)^2, so dL/dQ = 2 (Q - y) / B
        let factor = T::of(2.0 / settings.batch as f64);
        for (sums, rows) in self.sums.iter_mut().zip(&self.cut) {
            *sums = CriticSums::NONE;
            for row in rows.clone() {
                // Eq. 9: y = R + gamma^m (1 - terminated) min(Q1', Q2')(s', clip(mu'(s') + clip(N(0, sigma), +-c), +-1))
                let least = least(values[0][row], values[1][row]);
                let y = (batch.returns()[row] + batch.bootstrap()[row] * least).within(low, high);
                let q = self.critic.outputs[row];
                let error = q - y;
                self.upper[row] = error * factor;
                sums.squares += error.wide() * error.wide();
                sums.values += q.wide();
                sums.maximum = q.wide().max(sums.maximum);
            }
        }
        let gradient = &mut self.gradient;
        self.critic.backward(critic, batch.observation_rows(), batch.actions(), &self.upper, gradient);
        self.bounded = all_bounded(self.isa, &self.upper)
            && self.ranges.iter().all(|range| all_bounded(self.isa, &gradient[range.clone()]));
    }
}

/// The smaller one of two values; NaN if one of them is.
fn least<T: Real>(a: T, b: T) -> T {
    if a < b {
        a
    } else if b <= a {
        b
    } else {
        a + b
    }
}
