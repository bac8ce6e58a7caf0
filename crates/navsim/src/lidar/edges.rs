//! Edges in the depth buffer of inverse ranges.
//!
//! Sixteen edges are brought into the lidar's frame at once; those that face it wait until sixteen of them have come
//! together, are set up at once, and are drawn over the blocks of beams that they may cover.

use super::draw::{Draws, LaneRuns, lane_and_block};
use super::fan::Fan;
use super::view::View;
use crate::world::{BLOCK, BOXES, Block, Lanes, larger};

/// Edges that face the lidar and are not drawn yet, in its frame.
#[derive(Debug, Clone)]
pub(super) struct Facing {
    /// Up to two blocks.
    values: [Turned; 2],
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
        Self { values: [Turned::EMPTY, Turned::EMPTY], len: 0 }
    }
}

/// Sixteen edges in the lidar's frame: from x, y, to x, y and along x, y, m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turned([Lanes; 6]);

/// Those of them that face the lidar and are not behind it, a bit for each.
pub(super) type Seen = u32;

impl Facing {
    /// Draws what of a block the lidar may see, now or with the next block; `finish` draws what is left.
    #[inline(always)]
    pub fn add(&mut self, block: &impl EdgeBlock, view: View, fan: &Fan, draws: &mut Draws, depth: &mut [Lanes]) {
        let (turned, seen) = block.turned(view, fan);
        self.wait(&turned, seen);
        if self.len >= BLOCK {
            self.draw(BLOCK, fan, draws, depth);
            self.values[0] = self.values[1];
            self.len -= BLOCK;
        }
    }

    /// Takes the edges whose bits are set in; fewer than sixteen are waiting.
    #[inline(always)]
    fn wait(&mut self, turned: &Turned, mut seen: Seen) {
        while seen != 0 {
            let lane = seen.trailing_zeros() as usize % BLOCK;
            let block = &mut self.values[self.len / BLOCK % 2];
            for (waiting, turned) in block.0.iter_mut().zip(&turned.0) {
                waiting.0[self.len % BLOCK] = turned.0[lane];
            }
            self.len += 1;
            seen &= seen - 1;
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
        let ready = Ready::new(&self.values[0]);
        let runs = ready.runs(fan);
        let pairs = draws.list(&runs, count);
        if edge_on(&self.values[0]) & ((1 << count) - 1) != 0 {
            return ready.draw_ahead(pairs, fan, depth);
        }
        for pair in pairs {
            let (lane, block) = lane_and_block(*pair);
            draw_edge(&ready, lane, &fan.directions[block], &mut depth[block]);
        }
    }
}

/// 2^i: a load, where a shift by a lane's own count takes the baseline several instructions.
const BIT: [u32; BLOCK] = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768];

/// A block of what has edges, as `Outline` keeps it.
pub(super) trait EdgeBlock {
    /// Its edges, and which of them the lidar sees.
    fn turned(&self, view: View, fan: &Fan) -> (Turned, Seen);
}

/// `Outline::edges`.
impl EdgeBlock for Block<7, BLOCK> {
    #[inline(always)]
    fn turned(&self, view: View, fan: &Fan) -> (Turned, Seen) {
        let Self([from_x, from_y, to_x, to_y, along_x, along_y, back]) = self;
        let mut turned = Turned::EMPTY;
        let mut seen = [0_u32; BLOCK];
        for i in 0..BLOCK {
            let (ax, ay) = view.turn(from_x[i] - view.x, from_y[i] - view.y);
            let (bx, by) = view.turn(to_x[i] - view.x, to_y[i] - view.y);
            let (ex, ey) = view.turn(along_x[i], along_y[i]);
            let cross = ax * ey - ay * ex;
            let behind = fan.is_behind(ax, ay) & fan.is_behind(bx, by);
            let faces = (cross < 0.0) | (cross > back[i]);
            seen[i] = if faces & !behind { BIT[i] } else { 0 };
            for (row, value) in turned.0.iter_mut().zip([ax, ay, bx, by, ex, ey]) {
                row.0[i] = value;
            }
        }
        (turned, seen.iter().fold(0, |bits, bit| bits | bit))
    }
}

/// `Outline::boxes`: of two opposite faces at most one is seen, the nearer one, if the lidar is not between their
/// lines. The first half of the edges are the faces along the boxes, the second half those across.
impl EdgeBlock for Block<6, BOXES> {
    #[inline(always)]
    fn turned(&self, view: View, fan: &Fan) -> (Turned, Seen) {
        let Self([center_x, center_y, along_x, along_y, across_x, across_y]) = self;
        let mut turned = Turned::EMPTY;
        let mut seen = [0_u32; BLOCK];
        for i in 0..BOXES {
            let center = view.turn(center_x[i] - view.x, center_y[i] - view.y);
            let along = view.turn(along_x[i], along_y[i]);
            let across = view.turn(across_x[i], across_y[i]);
            for (lane, half, out) in [(i, along, across), (i + BOXES, across, along)] {
                let ([ax, ay], [bx, by], outside) = nearer_face(center, half, out);
                let behind = fan.is_behind(ax, ay) & fan.is_behind(bx, by);
                seen[lane] = if outside & !behind { BIT[lane] } else { 0 };
                for (row, value) in turned.0.iter_mut().zip([ax, ay, bx, by, 2.0 * half.0, 2.0 * half.1]) {
                    row.0[lane] = value;
                }
            }
        }
        (turned, seen.iter().fold(0, |bits, bit| bits | bit))
    }
}

/// Of the two faces of a box that run along `half` (from the middle of a face to its end) and lie `out` and minus `out`
/// from the centre, the one on the lidar's side: its ends, m, and whether the lidar is beyond its line.
#[inline(always)]
fn nearer_face((cx, cy): (f32, f32), (ux, uy): (f32, f32), (wx, wy): (f32, f32)) -> ([f32; 2], [f32; 2], bool) {
    // The corners are the centre and plus or minus these two, for either pair of faces: neighbours share bit-equal
    // corners.
    let (px, py, qx, qy) = (ux + wx, uy + wy, ux - wx, uy - wy);
    let (center, half) = (cx * uy - cy * ux, ux * wy - uy * wx);
    let nearer = (center > 0.0) == (half > 0.0);
    let a = if nearer { [cx - qx, cy - qy] } else { [cx - px, cy - py] };
    let b = if nearer { [cx + px, cy + py] } else { [cx + qx, cy + qy] };
    (a, b, center.abs() > half.abs())
}

impl Turned {
    const EMPTY: Self = Self([Lanes::all(0.0); 6]);
}

impl Ready {
    #[inline(always)]
    fn new(turned: &Turned) -> Self {
        const NONE: [Lanes; 2] = [Lanes::all(0.0); 2];
        let mut ready = Self { right: NONE, left: NONE, slope: NONE, limits: NONE };
        let Turned([from_x, from_y, to_x, to_y, along_x, along_y]) = turned;
        for i in 0..BLOCK {
            let (ax, ay, bx, by) = (from_x.0[i], from_y.0[i], to_x.0[i], to_y.0[i]);
            let (ex, ey) = (along_x.0[i], along_y.0[i]);
            let cross = ax * ey - ay * ex;
            let (right, left) = if cross < 0.0 { ([bx, by], [ax, ay]) } else { ([ax, ay], [bx, by]) };
            let inverse = 1.0 / cross;
            let limits = inverse_limits([ax, ay], [bx, by], [ex, ey]);
            for axis in 0..2 {
                ready.right[axis].0[i] = right[axis];
                ready.left[axis].0[i] = left[axis];
                ready.limits[axis].0[i] = limits[axis];
            }
            ready.slope[0].0[i] = ey * inverse;
            ready.slope[1].0[i] = -ex * inverse;
        }
        ready
    }

    /// The blocks of beams that each edge may cover.
    #[inline(always)]
    fn runs(&self, fan: &Fan) -> LaneRuns {
        let mut runs = LaneRuns::default();
        for i in 0..BLOCK {
            let right = fan.beam_at(self.right[0].0[i], self.right[1].0[i]);
            let left = fan.beam_at(self.left[0].0[i], self.left[1].0[i]);
            runs.set(i, fan.between(right, left), true);
        }
        runs
    }

    /// Draws `pairs` of which some are edges seen edge-on: on its line the beams that point away from such an edge pass
    /// the test of its ends too, and rounding decides which end is the right one. They keep the depth they had.
    #[cold]
    fn draw_ahead(&self, pairs: &[u16], fan: &Fan, depth: &mut [Lanes]) {
        for pair in pairs {
            let (lane, block) = lane_and_block(*pair);
            let ([cos, sin], before) = (&fan.directions[block], depth[block]);
            draw_edge(self, lane, &fan.directions[block], &mut depth[block]);
            let (right, left) =
                ([self.right[0].0[lane], self.right[1].0[lane]], [self.left[0].0[lane], self.left[1].0[lane]]);
            if right[0] * left[0] + right[1] * left[1] > 0.0 {
                for i in 0..BLOCK {
                    let ahead = cos.0[i] * (right[0] + left[0]) + sin.0[i] * (right[1] + left[1]);
                    depth[block].0[i] = if ahead < 0.0 { before.0[i] } else { depth[block].0[i] };
                }
            }
        }
    }
}

/// The array method, for a fan of `N` blocks: every beam against every edge that faces the lidar. The same operations
/// as by intervals, so the same bits, but no intervals, and the depth stays in registers.
#[inline(always)]
pub(super) fn draw_all<const N: usize>(
    blocks: &[impl EdgeBlock],
    view: View,
    fan: &Fan,
    facing: &mut Facing,
    draws: &mut Draws,
    depth: &mut [Lanes],
) {
    debug_assert_eq!((fan.directions.len(), depth.len()), (N, N));
    let (Some(beams), Some(depth)) = (fan.directions.first_chunk::<N>(), depth.first_chunk_mut::<N>()) else { return };
    let mut nearest = *depth;
    for block in blocks {
        let (turned, seen) = block.turned(view, fan);
        let edge_on = seen & edge_on(&turned);
        let ready = Ready::new(&turned);
        let mut rest = seen & !edge_on;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % BLOCK;
            for block in 0..N {
                draw_edge(&ready, lane, &beams[block], &mut nearest[block]);
            }
            rest &= rest - 1;
        }
        if edge_on != 0 {
            facing.wait(&turned, edge_on);
            *depth = nearest;
            facing.finish(fan, draws, depth);
            nearest = *depth;
        }
    }
    *depth = nearest;
}

/// A bit for each edge whose ends are in the same direction or in opposite ones, within 1e-4 rad.
#[inline(always)]
fn edge_on(turned: &Turned) -> Seen {
    let Turned([ax, ay, bx, by, ..]) = turned;
    let mut bits = [0; BLOCK];
    for i in 0..BLOCK {
        let (ax, ay, bx, by) = (ax.0[i], ay.0[i], bx.0[i], by.0[i]);
        let sine = ax * by - ay * bx;
        let distinct = sine * sine > 1e-8 * ((ax * ax + ay * ay) * (bx * bx + by * by));
        bits[i] = if distinct { 0 } else { BIT[i] };
    }
    bits.iter().fold(0, |all, bit| all | bit)
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
fn draw_edge(ready: &Ready, lane: usize, [cos, sin]: &[Lanes; 2], depth: &mut Lanes) {
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
