//! Sizes and options of an update.

use crate::batch::{ACTIONS, Mirror, width};
use crate::error::{Result, expect, expect_size};
use crate::kernels::SUMS;
use crate::layer::Layer;
use crate::packed::Shares;
use std::iter;
use std::ops::Range;

/// What the update depends on besides parameters and draws.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Layers of the actor in its packed vector: hidden ones, at least one, and the output.
    pub actor: Vec<Layer>,
    /// Layers of the first critic in the critics' packed vector: observation, combined, further ones, output.
    pub critic: Vec<Layer>,
    /// Place of W_a of equation 7 there.
    pub action_weight: usize,
    /// 2 for TD3, 1 for DDPG.
    pub critics: usize,
    /// Rows of an update.
    pub batch: usize,
    /// Numbers in the packed vectors of the actor and the critics.
    pub sizes: [usize; 2],
    /// Updates of the critics per update of the actor and the targets (equation 10).
    pub policy_delay: u64,
    /// Share of the online weights in a soft update (equation 10).
    pub tau: f64,
    /// Weight in the actor's loss of the mean squared input of its tanh.
    pub pretanh_penalty: f64,
    /// Bounds of the targets; infinite where they are free.
    pub bounds: [f64; 2],
    /// Whether the combined layer stays untrained.
    pub frozen_combined: bool,
    /// The mirror of a row, where rows are mirrored.
    pub mirror: Option<Mirror>,
}

/// Largest number of rows of a batch, by common sense.
const BATCH_MAX: usize = 1 << 20;
/// Largest number of units of a layer, by common sense.
const UNITS_MAX: usize = 1 << 20;

impl Settings {
    /// Numbers in an observation.
    pub fn inputs(&self) -> usize {
        self.actor[0].inputs
    }

    /// Rows of a batch that are summed first: half of them, rounded up to whole vectors.
    pub fn cut(&self) -> usize {
        self.batch.div_ceil(2).next_multiple_of(SUMS).min(self.batch)
    }

    /// Layers of a critic.
    pub fn critic_layers(&self, critic: usize) -> Vec<Layer> {
        self.critic.iter().map(|layer| layer.of_critic(critic)).collect()
    }

    /// Place of W_a of a critic.
    pub fn action_weights(&self, critic: usize) -> Range<usize> {
        let size = ACTIONS * self.critic[1].outputs;
        self.action_weight + critic * size..self.action_weight + (critic + 1) * size
    }

    /// Where the parameters of a critic lie: its weights and biases, in order.
    pub fn critic_ranges(&self, critic: usize) -> Vec<Range<usize>> {
        let layers = self.critic_layers(critic);
        let mut ranges: Vec<_> = layers.iter().flat_map(|layer| [layer.weights(), layer.biases()]).collect();
        ranges.push(self.action_weights(critic));
        ranges.sort_unstable_by_key(|range| range.start);
        ranges
    }

    /// The parameters of all critics in order, each with the number of its critic.
    fn ranges_of_critics(&self) -> Vec<(Range<usize>, usize)> {
        let of_critic = |critic| self.critic_ranges(critic).into_iter().map(move |range| (range, critic));
        let mut ranges: Vec<_> = (0..self.critics).flat_map(of_critic).collect();
        ranges.sort_unstable_by_key(|(range, _)| range.start);
        ranges
    }

    /// The critics' packed vector by critics: what lies between two ranges belongs to the one before.
    pub fn shares_by_critic(&self) -> Shares {
        let (ranges, mut shares) = (self.ranges_of_critics(), Shares::default());
        let starts = iter::once(0).chain(ranges[1..].iter().map(|(range, _)| range.start));
        let ends = ranges[1..].iter().map(|(range, _)| range.start).chain(iter::once(self.sizes[1]));
        for (start, (end, (_, critic))) in starts.zip(ends.zip(&ranges)) {
            shares[*critic].push(start..end);
        }
        shares
    }

    /// Refuses what cannot be: sizes that do not follow each other, places beyond a vector.
    ///
    /// # Errors
    /// Names what does not fit.
    pub fn check(&self) -> Result<()> {
        expect("layers of the actor", self.actor.len(), self.actor.len() >= 2, || "at least 2".into())?;
        expect("layers of a critic", self.critic.len(), self.critic.len() >= 3, || "at least 3".into())?;
        expect("critics", self.critics, (1..=2).contains(&self.critics), || "1 or 2".into())?;
        expect("rows of a batch", self.batch, (1..=BATCH_MAX).contains(&self.batch), || format!("1 to {BATCH_MAX}"))?;
        expect("tau", self.tau, (0.0..=1.0).contains(&self.tau), || "in [0, 1]".into())?;
        let penalty = self.pretanh_penalty;
        expect("pretanh_penalty", penalty, penalty >= 0.0 && penalty.is_finite(), || "at least 0".into())?;
        let [low, high] = self.bounds;
        expect("the lower bound", low, low <= high, || format!("at most the upper one, {high}"))?;
        expect("policy_delay", self.policy_delay as usize, self.policy_delay >= 1, || "at least 1".into())?;
        let networks = [
            ("actor", &self.actor, self.sizes[0], 1, ACTIONS),
            ("critic", &self.critic, self.sizes[1], self.critics, 1),
        ];
        for (name, layers, size, count, outputs) in networks {
            check_layers(name, layers, size, count, outputs)?;
        }
        expect_size("inputs of the critic", self.critic[0].inputs, self.inputs())?;
        let place = self.action_weight;
        expect("place of W_a", place, place < self.sizes[1], || format!("less than {}", self.sizes[1]))?;
        let end = self.action_weights(self.critics - 1).end;
        expect("end of W_a", end, end <= self.sizes[1], || format!("at most {}", self.sizes[1]))?;
        check_apart("critics", self.ranges_of_critics().into_iter().map(|(range, _)| range).collect())?;
        self.mirror.as_ref().map_or(Ok(()), |mirror| mirror.check(width(self.inputs())))
    }
}

/// Refuses parameters that share places with others.
fn check_apart(name: &str, mut ranges: Vec<Range<usize>>) -> Result<()> {
    ranges.sort_unstable_by_key(|range| range.start);
    for pair in ranges.windows(2) {
        let (end, next) = (pair[0].end, pair[1].start);
        expect(format!("place of some of the {name}'s parameters"), next, next >= end, || format!("at least {end}"))?;
    }
    Ok(())
}

/// Refuses layers that do not follow each other, share places, end in another number of `outputs`, or lie beyond the `size` numbers of
/// their vector, in which `count` networks of them lie.
///
/// # Errors
/// Names what does not fit.
pub fn check_layers(name: &str, layers: &[Layer], size: usize, count: usize, outputs: usize) -> Result<()> {
    expect_size(format!("outputs of the {name}"), layers.last().map_or(0, |layer| layer.outputs), outputs)?;
    for pair in layers.windows(2) {
        expect_size(format!("inputs of a layer of the {name}"), pair[1].inputs, pair[0].outputs)?;
    }
    for layer in layers {
        for units in [layer.inputs, layer.outputs] {
            let fits = (1..=UNITS_MAX).contains(&units);
            expect(format!("units of the {name}"), units, fits, || format!("1 to {UNITS_MAX}"))?;
        }
        let place = layer.weight.max(layer.bias);
        expect(format!("place of a layer of the {name}"), place, place < size, || format!("less than {size}"))?;
        let last = layer.of_critic(count - 1);
        let end = last.weights().end.max(last.biases().end);
        expect(format!("end of a layer of the {name}"), end, end <= size, || format!("at most {size}"))?;
    }
    let of_network = |number| layers.iter().map(move |layer| layer.of_critic(number));
    let all = (0..count).flat_map(of_network).flat_map(|layer| [layer.weights(), layer.biases()]);
    check_apart(name, all.collect())
}
