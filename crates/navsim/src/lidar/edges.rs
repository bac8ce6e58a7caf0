//! Edges in the depth buffer of inverse ranges.
//!
//! Sixteen edges are brought into the lidar's frame at once; those that face it wait until sixteen of them have come
//! together, are set up at once, and are drawn over the blocks of beams that they may cover.

use super::draw::{Draws, LaneRuns, View, lane_and_block, larger};
use super::fan::Fan;
use crate::world::{BLOCK, EdgeBlock, Lanes};

/// Edges that face the lidar and are not drawn yet, in its frame.
#[derive(Debug, Clone)]
pub(super) struct Facing {
    /// From, to and along, each x and y, m.
    values: [[f32; 2 * BLOCK]; 6],
    len: usize,
}

/// Sixteen edges ready for the beams.
struct Ready {
    /// Right end as seen from the lidar, m.
    right: [Lanes; 2],
    /// Left end, m.
    left: [Lanes; 2],
    /// 1/t = cos slope[0] + sin slope[1].
    slope: [Lanes; 2],
    /// Smallest and largest inverse range on the edge: keeps beams along the edge between its ends.
    limits: [Lanes; 2],
}

impl Default for Facing {
    fn default() -> Self {
        Self { values: [[0.0; 2 * BLOCK]; 6], len: 0 }
    }
}

impl Facing {
    /// Draws what of `block` the lidar may see, now or with the next edges; `finish` draws what is left.
    #[inline(always)]
    pub fn add(&mut self, block: &EdgeBlock, view: View, fan: &Fan, draws: &mut Draws, depth: &mut [Lanes]) {
        let (values, mut seen) = turn(block, view, fan);
        while seen != 0 {
            let lane = seen.trailing_zeros() as usize;
            for (waiting, turned) in self.values.iter_mut().zip(&values) {
                waiting[self.len % (2 * BLOCK)] = turned.0[lane % BLOCK];
            }
            self.len += 1;
            seen &= seen - 1;
        }
        if self.len >= BLOCK {
            self.draw(BLOCK, fan, draws, depth);
            for row in &mut self.values {
                let (first, second) = row.split_at_mut(BLOCK);
                first.copy_from_slice(second);
            }
            self.len -= BLOCK;
        }
    }

    /// Draws what is left.
    #[inline(always)]
    pub fn finish(&mut self, fan: &Fan, draws: &mut Draws, depth: &mut [Lanes]) {
        self.draw(self.len, fan, draws, depth);
        self.len = 0;
    }

    #[inline(always)]
    fn draw(&self, count: usize, fan: &Fan, draws: &mut Draws, depth: &mut [Lanes]) {
        let (ready, runs) = set_up(&self.values, fan);
        for pair in draws.list(&runs, count) {
            let (lane, block) = lane_and_block(*pair);
            draw_edge(&ready, lane, &fan.cos[block], &fan.sin[block], &mut depth[block]);
        }
    }
}

/// 2^i.
const BIT: [u32; BLOCK] = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768];

/// The edges of a block in the lidar's frame, and a bit for each that faces it and is not behind it.
#[inline(always)]
fn turn(block: &EdgeBlock, view: View, fan: &Fan) -> ([Lanes; 6], u32) {
    let mut turned = [Lanes::all(0.0); 6];
    let mut seen = [0_u32; BLOCK];
    for i in 0..BLOCK {
        let (ax, ay) = view.turn(block.from[0].0[i] - view.x, block.from[1].0[i] - view.y);
        let (bx, by) = view.turn(block.to[0].0[i] - view.x, block.to[1].0[i] - view.y);
        let (ex, ey) = view.turn(block.along[0].0[i], block.along[1].0[i]);
        let cross = ax * ey - ay * ex;
        let behind = fan.is_behind(ax, ay) & fan.is_behind(bx, by);
        let faces = (cross < 0.0) | (cross > block.back.0[i]);
        seen[i] = if faces & !behind { BIT[i] } else { 0 };
        for (row, value) in turned.iter_mut().zip([ax, ay, bx, by, ex, ey]) {
            row.0[i] = value;
        }
    }
    (turned, seen.iter().fold(0, |bits, bit| bits | bit))
}

/// Sets up the first sixteen edges of `values`.
#[inline(always)]
fn set_up(values: &[[f32; 2 * BLOCK]; 6], fan: &Fan) -> (Ready, LaneRuns) {
    const NONE: [Lanes; 2] = [Lanes::all(0.0); 2];
    let mut ready = Ready { right: NONE, left: NONE, slope: NONE, limits: NONE };
    let mut runs = LaneRuns::default();
    for i in 0..BLOCK {
        let [ax, ay, bx, by, ex, ey] =
            [values[0][i], values[1][i], values[2][i], values[3][i], values[4][i], values[5][i]];
        let cross = ax * ey - ay * ex;
        let front = cross < 0.0;
        let (right, left) = if front { ([bx, by], [ax, ay]) } else { ([ax, ay], [bx, by]) };
        let inverse = 1.0 / cross;
        let limits = inverse_limits([ax, ay], [bx, by], [ex, ey]);
        for axis in 0..2 {
            ready.right[axis].0[i] = right[axis];
            ready.left[axis].0[i] = left[axis];
            ready.limits[axis].0[i] = limits[axis];
        }
        ready.slope[0].0[i] = ey * inverse;
        ready.slope[1].0[i] = -ex * inverse;
        let covered = fan.between(fan.beam_at(right[0], right[1]), fan.beam_at(left[0], left[1]));
        runs.set(i, covered, true);
    }
    (ready, runs)
}

/// Smallest and largest inverse range on the edge from `a` to `b` along `e`.
#[inline(always)]
fn inverse_limits(a: [f32; 2], b: [f32; 2], e: [f32; 2]) -> [f32; 2] {
    let (a2, b2) = (a[0] * a[0] + a[1] * a[1], b[0] * b[0] + b[1] * b[1]);
    let (near2, far2) = if a2 < b2 { (a2, b2) } else { (b2, a2) };
    // The nearest point is an end when the foot of the perpendicular lies outside the edge.
    let outside = (a[0] * e[0] + a[1] * e[1] > 0.0) | (b[0] * e[0] + b[1] * e[1] < 0.0);
    let near = 1.0 / near2.sqrt();
    [1.0 / far2.sqrt(), if outside { near } else { f32::INFINITY }]
}

/// Draws edge `lane` over one block of beams.
#[inline(always)]
fn draw_edge(ready: &Ready, lane: usize, cos: &Lanes, sin: &Lanes, depth: &mut Lanes) {
    let right = [ready.right[0].0[lane], ready.right[1].0[lane]];
    let left = [ready.left[0].0[lane], ready.left[1].0[lane]];
    let slope = [ready.slope[0].0[lane], ready.slope[1].0[lane]];
    let limits = [ready.limits[0].0[lane], ready.limits[1].0[lane]];
    for i in 0..BLOCK {
        let (cos, sin) = (cos.0[i], sin.0[i]);
        let inverse = cos * slope[0] + sin * slope[1];
        let inverse = if inverse > limits[0] { inverse } else { limits[0] };
        let inverse = if inverse < limits[1] { inverse } else { limits[1] };
        // right x beam and beam x left: neighbours compute the same two products of a shared corner, so one of them
        // takes a beam that meets it.
        let from_right = right[0] * sin - right[1] * cos;
        let to_left = cos * left[1] - sin * left[0];
        let covered = (from_right >= 0.0) & (to_left >= 0.0);
        depth.0[i] = larger(depth.0[i], if covered { inverse } else { 0.0 });
    }
}
