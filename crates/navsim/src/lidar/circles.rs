//! Circles in the depth buffer of ranges.
//!
//! The form with the distance across the beam loses no precision where a beam grazes.

use super::draw::{Draws, LaneRuns, lane_and_block};
use super::fan::Fan;
use super::view::View;
use crate::world::{BLOCK, Block, Lanes, smaller};
use std::f32::consts::FRAC_PI_2;

/// Draws the circles of a block.
#[inline(always)]
pub(super) fn draw(circles: &Block<3, BLOCK>, view: View, fan: &Fan, draws: &mut Draws, ranges: &mut [Lanes]) {
    let (center, runs) = set_up(circles, view, fan);
    for pair in draws.list(&runs, BLOCK) {
        let (lane, beams) = lane_and_block(*pair);
        let center = [center[0].0[lane], center[1].0[lane]];
        draw_circle(center, circles.0[2][lane], &fan.directions[beams], &mut ranges[beams]);
    }
}

/// Centres in the lidar's frame and the beams that may meet each circle.
#[inline(always)]
fn set_up(circles: &Block<3, BLOCK>, view: View, fan: &Fan) -> ([Lanes; 2], LaneRuns) {
    let Block([xs, ys, radii]) = circles;
    let mut center = [Lanes::all(0.0); 2];
    let mut runs = LaneRuns::default();
    for i in 0..BLOCK {
        let (x, y) = view.turn(xs[i] - view.x, ys[i] - view.y);
        (center[0].0[i], center[1].0[i]) = (x, y);
        let (distance, radius) = ((x * x + y * y).sqrt(), radii[i]);
        runs.set(i, fan.around(x, y, half_width(radius, distance)), radius > 0.0);
    }
    (center, runs)
}

/// Half the angle (rad) under which a disc is seen, or a little more; from inside a half turn's half.
#[inline(always)]
pub(super) fn half_width(radius: f32, distance: f32) -> f32 {
    let q = if radius < distance { radius / distance } else { 1.0 };
    // asin(q) <= q + (pi/2 - 1) q^3, equal at both ends.
    q * (1.0 + (FRAC_PI_2 - 1.0) * q * q) * 1.0001
}

/// Draws one circle over one block of beams.
#[inline(always)]
fn draw_circle(center: [f32; 2], radius: f32, [cos, sin]: &[Lanes; 2], ranges: &mut Lanes) {
    let [x, y] = center;
    for i in 0..BLOCK {
        let (cos, sin) = (cos.0[i], sin.0[i]);
        let along = cos * x + sin * y;
        let across = (cos * y - sin * x).abs();
        let half_chord_squared = (radius - across) * (radius + across);
        let chord = if half_chord_squared > 0.0 { half_chord_squared } else { 0.0 };
        let hit = along - chord.sqrt();
        let hit = if hit > 0.0 { hit } else { 0.0 };
        let covered = (half_chord_squared >= 0.0) & (along > 0.0);
        ranges.0[i] = smaller(ranges.0[i], if covered { hit } else { f32::INFINITY });
    }
}
