//! The list of what is drawn over which beams.

use super::fan::Runs;
use crate::world::BLOCK;

/// The runs of sixteen lanes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LaneRuns {
    start: [[i32; BLOCK]; 2],
    count: [[i32; BLOCK]; 2],
}

impl LaneRuns {
    /// Sets the runs of a lane; none unless `wanted`.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, runs: Runs, wanted: bool) {
        for k in 0..2 {
            self.start[k][lane] = runs.start[k];
            self.count[k][lane] = if wanted { runs.count[k] } else { 0 };
        }
    }

    /// The runs of a lane.
    #[inline(always)]
    pub fn of(&self, lane: usize) -> Runs {
        Runs { start: [self.start[0][lane], self.start[1][lane]], count: [self.count[0][lane], self.count[1][lane]] }
    }
}

/// A list of pairs (lane, block of beams). One loop over the list has no branch that depends on how many blocks each
/// lane covers: a processor guesses those wrong once for each edge.
#[derive(Debug, Clone)]
pub(super) struct Draws {
    pairs: Vec<u16>,
}

/// Pairs written at once.
const CHUNK: usize = 8;
const RAMP: [u16; CHUNK] = [0, 1, 2, 3, 4, 5, 6, 7];

impl Draws {
    /// A list long enough for sixteen lanes over `blocks` blocks of beams, at most 256. The two runs of a lane may
    /// share a block at each end.
    pub fn new(blocks: usize) -> Self {
        Self { pairs: vec![0; BLOCK * (blocks + 2) + CHUNK] }
    }

    /// The pairs of the first `lanes` lanes: see `lane_and_block`.
    #[inline(always)]
    pub fn list(&mut self, runs: &LaneRuns, lanes: usize) -> &[u16] {
        let mut len = 0;
        for lane in 0..lanes.min(BLOCK) {
            len = self.add(lane, runs.start[0][lane], runs.count[0][lane], len);
        }
        // An edge goes round the turn once in a while.
        if runs.count[1].iter().fold(0, |all, count| all | count) != 0 {
            for lane in 0..lanes.min(BLOCK) {
                len = self.add(lane, runs.start[1][lane], runs.count[1][lane], len);
            }
        }
        &self.pairs[..len]
    }

    /// Writes the pairs of a run from place `len` on and returns the place after them.
    #[inline(always)]
    fn add(&mut self, lane: usize, start: i32, count: i32, len: usize) -> usize {
        let first = (lane << 8) as u16 + start as u16;
        let count = count as usize;
        let mut done = 0;
        loop {
            let chunk = &mut self.pairs[len + done..len + done + CHUNK];
            let base = first.wrapping_add(done as u16);
            for (pair, offset) in chunk.iter_mut().zip(RAMP) {
                *pair = base.wrapping_add(offset);
            }
            done += CHUNK;
            if done >= count {
                return len + count;
            }
        }
    }
}

/// What a pair of `Draws` stands for.
#[inline(always)]
pub(super) fn lane_and_block(pair: u16) -> (usize, usize) {
    (usize::from(pair >> 8) % BLOCK, usize::from(pair & 0xff))
}

#[cfg(test)]
mod tests {
    use super::super::fan::Fan;
    use super::*;
    use crate::config::{LidarConfig, SimConfig};

    #[test]
    fn sixteen_lanes_all_round_find_room() {
        let lidar = SimConfig::from_json(include_str!("../../tests/defaults.json")).expect("valid").lidar;
        for beams in [1, 16, 180, 4096] {
            let fan = Fan::new(&LidarConfig { beams, fov: 2.0 * std::f64::consts::PI, ..lidar });
            let blocks = fan.directions.len();
            let mut most = 0;
            for beam in 0..beams {
                let right = beam as f32 + 0.5;
                // As far round as rounding can take an edge that is seen edge-on.
                let runs = fan.between(right, f32::from_bits(right.to_bits() - 1));
                let mut all = LaneRuns::default();
                (0..BLOCK).for_each(|lane| all.set(lane, runs, true));
                let len = Draws::new(blocks).list(&all, BLOCK).len();
                assert_eq!(len, BLOCK * (runs.count[0] + runs.count[1]) as usize);
                most = most.max(len);
            }
            assert!(most <= BLOCK * (blocks + 2), "{beams}: {most}");
        }
    }
}
