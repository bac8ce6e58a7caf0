//! The way through a tree of boxes: nearest first, past what is hidden.

use super::circles::half_width;
use super::draw::LaneRuns;
use super::fan::{Fan, Runs};
use super::view::View;
use crate::world::{BLOCK, Lanes, Tree, larger, smaller};
use std::f32::consts::PI;

/// What the depth buffer holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Depth {
    /// Inverse ranges.
    Inverse,
    /// Ranges.
    Range,
}

/// A box on the way.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    /// A little less than the distance of its nearest point, m.
    nearest: f32,
    /// Level of what it holds in the tree; 0 for a leaf.
    level: u32,
    /// Its place in the level.
    index: u32,
    /// Blocks of beams that may meet it.
    runs: Runs,
}

/// A walk through a tree; memory that is kept from scan to scan.
#[derive(Debug, Clone)]
pub(super) struct Walk {
    waiting: Vec<Waiting>,
    /// For each block of beams a range beyond which nothing changes it, m.
    horizon: Vec<f32>,
}

/// Distances are lowered by this part: more than their rounding error.
const NEARER: f32 = 1.0 - 1e-5;

impl Walk {
    /// Memory for walks over `blocks` blocks of beams.
    pub fn new(blocks: usize) -> Self {
        Self { waiting: Vec::new(), horizon: vec![0.0; blocks] }
    }

    /// Starts at the root of `tree`; nothing is seen beyond the reach of the beams.
    #[inline(always)]
    pub fn start(&mut self, tree: &Tree, view: View, fan: &Fan) {
        self.horizon.fill(fan.range_max);
        self.waiting.clear();
        self.open(tree, tree.height(), 0, view, fan);
    }

    /// The next leaf that may change `depth`.
    #[inline(always)]
    pub fn next(&mut self, tree: &Tree, view: View, fan: &Fan, depth: &[Lanes], kind: Depth) -> Option<usize> {
        while let Some(next) = self.waiting.pop() {
            if self.is_hidden(&next, depth, kind) {
                continue;
            }
            if next.level == 0 {
                return Some(next.index as usize);
            }
            self.open(tree, next.level as usize, next.index as usize, view, fan);
        }
        None
    }

    /// Puts the boxes below a box on the way, the nearest last.
    #[inline(always)]
    fn open(&mut self, tree: &Tree, level: usize, index: usize, view: View, fan: &Fan) {
        let first = self.waiting.len();
        let boxes = tree.below(level, index);
        let [low_x, low_y] = &boxes.low;
        let [high_x, high_y] = &boxes.high;
        let mut nearest = Lanes::all(0.0);
        let mut runs = LaneRuns::default();
        for i in 0..BLOCK {
            let (x0, y0, x1, y1) =
                (low_x.0[i] - view.x, low_y.0[i] - view.y, high_x.0[i] - view.x, high_y.0[i] - view.y);
            let (gap_x, gap_y) = (outside(x0, x1), outside(y0, y1));
            nearest.0[i] = (gap_x * gap_x + gap_y * gap_y).sqrt() * NEARER;
            let (x, y) = view.turn(0.5 * (x0 + x1), 0.5 * (y0 + y1));
            let (width, height) = (x1 - x0, y1 - y0);
            let radius = 0.5 * (width * width + height * height).sqrt();
            let distance = (x * x + y * y).sqrt() * NEARER;
            let angle = if radius < distance { half_width(radius, distance) } else { PI };
            runs.set(i, fan.around(x, y, angle), x0 <= x1);
        }
        for lane in 0..BLOCK {
            let runs = runs.of(lane);
            if runs.count[0] + runs.count[1] > 0 {
                let index = (index * BLOCK + lane) as u32;
                self.waiting.push(Waiting { nearest: nearest.0[lane], level: level as u32 - 1, index, runs });
            }
        }
        self.waiting[first..].sort_unstable_by(|a, b| b.nearest.total_cmp(&a.nearest));
    }

    /// Whether every beam that may meet the box has met something nearer.
    #[inline(always)]
    fn is_hidden(&mut self, next: &Waiting, depth: &[Lanes], kind: Depth) -> bool {
        for (start, count) in next.runs.start.iter().zip(&next.runs.count) {
            // An empty run may start beyond the last block.
            let blocks = self.horizon.iter_mut().zip(depth).skip(*start as usize).take(*count as usize);
            for (horizon, depth) in blocks {
                if next.nearest < *horizon {
                    *horizon = farthest(depth, kind);
                    if next.nearest < *horizon {
                        return false;
                    }
                }
            }
        }
        true
    }
}

/// How far zero lies outside of the interval from `low` to `high`.
#[inline(always)]
fn outside(low: f32, high: f32) -> f32 {
    let below = if low > 0.0 { low } else { 0.0 };
    if high < 0.0 { -high } else { below }
}

/// The largest range of a block, m.
#[inline(always)]
fn farthest(depth: &Lanes, kind: Depth) -> f32 {
    match kind {
        Depth::Inverse => 1.0 / depth.0.iter().fold(f32::INFINITY, |least, inverse| smaller(least, *inverse)),
        Depth::Range => depth.0.iter().fold(0.0, |most, range| larger(most, *range)),
    }
}
