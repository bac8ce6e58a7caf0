//! The scan kernel: a rasteriser with a one-dimensional depth buffer.
//!
//! Every edge that the lidar can see covers an interval of beams. For those beams the inverse range is linear in the
//! beam's direction, 1/t = (c e_y - s e_x) / (a x e) for an edge from a along e, so the nearest edge of a beam is the
//! largest of a few multiplications: no division and no branch in the inner loop. Circles follow in the
//! perpendicular-distance form, which loses no precision at grazing beams.
//!
//! One source serves every instruction set (see `isa`): plain loops over blocks of 16, no fused multiply-add, and only
//! operations that are rounded exactly, so that all of them give the same bits.

use super::fan::{BLOCK, Fan};
use crate::world::{Edge, Outline};
use std::f32::consts::{FRAC_PI_2, PI};

/// Where the lidar is: position (m) and heading as cosine and sine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub x: f32,
    pub y: f32,
    pub cos: f32,
    pub sin: f32,
}

/// Working memory of a scan, one for each thread; grows to the largest outline it has met.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scratch {
    x: Vec<f32>,
    y: Vec<f32>,
    beam: Vec<f32>,
    edges: Vec<RasterEdge>,
}

/// An edge in the lidar's frame, ready for the inner loop.
#[derive(Debug, Clone, Copy, Default)]
struct RasterEdge {
    /// Right end as seen from the lidar, m.
    right: [f32; 2],
    /// Left end, m.
    left: [f32; 2],
    /// 1/t = cos * slope[0] + sin * slope[1].
    slope: [f32; 2],
    /// Smallest and largest inverse range on the edge: keeps beams along the edge between its ends.
    limits: [f32; 2],
    /// First beam, may be fractional.
    first: f32,
    /// Last beam; beyond `Fan::turn` it goes on at beam 0.
    last: f32,
}

/// Half width (rad) of the band by which an edge's interval of beams is widened: twice the error of `angle`. The exact
/// test of each beam against the edge's ends decides; the interval only saves work.
const GUARD: f32 = 5e-4;

/// Computes the ranges (m) of all beams of `fan` in the lidar's frame against `outlines`; `ranges` has the padded
/// length of the fan. A beam that meets nothing within `range_max` gets exactly `range_max`. The lidar must not be
/// inside a solid.
#[inline(always)]
pub(super) fn scan(
    outlines: [&Outline; 2],
    view: View,
    fan: &Fan,
    range_max: f32,
    scratch: &mut Scratch,
    ranges: &mut [f32],
) {
    let farthest = 1.0 / range_max;
    ranges.fill(farthest);
    for outline in outlines {
        prepare(outline, view, fan, scratch);
        for edge in &scratch.edges {
            draw_edge(edge, fan, ranges);
        }
    }
    for range in ranges.iter_mut() {
        let hit = 1.0 / *range;
        *range = if *range > farthest && hit < range_max { hit } else { range_max };
    }
    for outline in outlines {
        for i in 0..outline.circle_x.len() {
            draw_circle([outline.circle_x[i], outline.circle_y[i]], outline.circle_radius[i], view, fan, ranges);
        }
    }
}

/// Brings corners into the lidar's frame and collects the edges that may be seen.
#[inline(always)]
fn prepare(outline: &Outline, view: View, fan: &Fan, scratch: &mut Scratch) {
    let n = outline.corner_x.len();
    scratch.edges.clear();
    for values in [&mut scratch.x, &mut scratch.y, &mut scratch.beam] {
        if values.len() < n {
            values.resize(n, 0.0);
        }
    }
    let (x, y, beam) = (&mut scratch.x[..n], &mut scratch.y[..n], &mut scratch.beam[..n]);
    let (corner_x, corner_y) = (&outline.corner_x[..n], &outline.corner_y[..n]);
    for i in 0..n {
        let (dx, dy) = (corner_x[i] - view.x, corner_y[i] - view.y);
        let (ahead, aside) = (view.cos * dx + view.sin * dy, view.cos * dy - view.sin * dx);
        (x[i], y[i]) = (ahead, aside);
        beam[i] = first_beam(ahead, aside, fan);
    }
    let (edge_x, edge_y, kind) = (&outline.edge_x[..n], &outline.edge_y[..n], &outline.edge[..n]);
    for i in 0..n {
        if kind[i] == Edge::None {
            continue;
        }
        let (ex, ey) = (view.cos * edge_x[i] + view.sin * edge_y[i], view.cos * edge_y[i] - view.sin * edge_x[i]);
        let cross = x[i] * ey - y[i] * ex;
        let seen = cross < 0.0 || (kind[i] == Edge::Wall && cross > 0.0);
        if seen {
            let (right, left) = if cross < 0.0 { (i + 1, i) } else { (i, i + 1) };
            let span = beam[left] - beam[right];
            let span = if span < 0.0 { span + fan.turn } else { span };
            let last = beam[right] + span + 2.0 * GUARD * fan.density;
            // Behind the lidar's field of view: neither before the last beam nor round the turn to the first.
            if beam[right] > (fan.beams - 1) as f32 && last < fan.turn {
                continue;
            }
            let inverse = 1.0 / cross;
            scratch.edges.push(RasterEdge {
                right: [x[right], y[right]],
                left: [x[left], y[left]],
                slope: [ey * inverse, -ex * inverse],
                limits: inverse_limits([x[i], y[i]], [x[i + 1], y[i + 1]], [ex, ey]),
                first: beam[right],
                last,
            });
        }
    }
}

/// Smallest and largest inverse range on the edge from `a` to `b` along `e`.
#[inline(always)]
fn inverse_limits(a: [f32; 2], b: [f32; 2], e: [f32; 2]) -> [f32; 2] {
    let (a2, b2) = (a[0] * a[0] + a[1] * a[1], b[0] * b[0] + b[1] * b[1]);
    let (near2, far2) = if a2 < b2 { (a2, b2) } else { (b2, a2) };
    // The nearest point is an end when the foot of the perpendicular lies outside the edge.
    let outside = a[0] * e[0] + a[1] * e[1] > 0.0 || b[0] * e[0] + b[1] * e[1] < 0.0;
    [1.0 / far2.sqrt(), if outside { 1.0 / near2.sqrt() } else { f32::INFINITY }]
}

/// Runs `block` for each block of beams that the interval from `first` to `last` touches, once round the turn.
#[inline(always)]
fn for_blocks(first: f32, last: f32, fan: &Fan, mut block: impl FnMut(usize)) {
    let end = (fan.beams - 1) as f32;
    for shift in [0.0, fan.turn] {
        let (low, high) = ((first - shift).max(0.0), (last - shift).min(end));
        if low <= high {
            let (low, high) = (low as usize / BLOCK, high as usize / BLOCK);
            for index in low..=high {
                block(index * BLOCK);
            }
        }
    }
}

#[inline(always)]
fn draw_edge(edge: &RasterEdge, fan: &Fan, depth: &mut [f32]) {
    let RasterEdge { right, left, slope, limits, .. } = *edge;
    for_blocks(edge.first, edge.last, fan, |start| {
        let range = start..start + BLOCK;
        let (cos, sin, depth) = (&fan.cos[range.clone()], &fan.sin[range.clone()], &mut depth[range]);
        for i in 0..BLOCK {
            let inverse = cos[i] * slope[0] + sin[i] * slope[1];
            let inverse = if inverse > limits[0] { inverse } else { limits[0] };
            let inverse = if inverse < limits[1] { inverse } else { limits[1] };
            // right x beam and beam x left: neighbours compute the same two products of a shared corner, so one of them
            // takes a beam that meets it.
            let from_right = right[0] * sin[i] - right[1] * cos[i];
            let to_left = cos[i] * left[1] - sin[i] * left[0];
            let covered = (from_right >= 0.0) & (to_left >= 0.0) & (inverse > depth[i]);
            depth[i] = if covered { inverse } else { depth[i] };
        }
    });
}

#[inline(always)]
fn draw_circle(center: [f32; 2], radius: f32, view: View, fan: &Fan, ranges: &mut [f32]) {
    let (dx, dy) = (center[0] - view.x, center[1] - view.y);
    let (x, y) = (view.cos * dx + view.sin * dy, view.cos * dy - view.sin * dx);
    let distance = (x * x + y * y).sqrt();
    // asin(q) <= q pi/2, and the circle fills at most half of the view.
    let quotient = if radius < distance { radius / distance } else { 1.0 };
    let half_width = (quotient * FRAC_PI_2 * 1.0001 + GUARD) * fan.density;
    let middle = first_beam(x, y, fan) + GUARD * fan.density;
    let first = middle - half_width;
    let (first, last) =
        if first < 0.0 { (first + fan.turn, middle + half_width + fan.turn) } else { (first, middle + half_width) };
    for_blocks(first, last, fan, |start| {
        let range = start..start + BLOCK;
        let (cos, sin, ranges) = (&fan.cos[range.clone()], &fan.sin[range.clone()], &mut ranges[range]);
        for i in 0..BLOCK {
            let along = cos[i] * x + sin[i] * y;
            let across = (cos[i] * y - sin[i] * x).abs();
            let half_chord_squared = (radius - across) * (radius + across);
            let chord = if half_chord_squared > 0.0 { half_chord_squared } else { 0.0 };
            let hit = along - chord.sqrt();
            let hit = if hit > 0.0 { hit } else { 0.0 };
            let covered = (half_chord_squared >= 0.0) & (along > 0.0) & (hit < ranges[i]);
            ranges[i] = if covered { hit } else { ranges[i] };
        }
    });
}

/// The beam, as a fraction, that points to (x, y), less the guard band: in [0, turn).
#[inline(always)]
fn first_beam(x: f32, y: f32, fan: &Fan) -> f32 {
    let beam = (angle(x, y) - fan.first_angle - GUARD) * fan.density;
    if beam < 0.0 { beam + fan.turn } else { beam }
}

/// Angle (rad) of (x, y), within 2.5e-4.
#[inline(always)]
fn angle(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = if ax > ay { (ay, ax) } else { (ax, ay) };
    // The smallest positive normal number keeps 0/0 out.
    let a = small / (large + f32::MIN_POSITIVE);
    let s = a * a;
    let octant = ((-0.046_496_475 * s + 0.159_314_22) * s - 0.327_622_77) * s * a + a;
    let quadrant = if ay > ax { FRAC_PI_2 - octant } else { octant };
    let half = if x < 0.0 { PI - quadrant } else { quadrant };
    if y < 0.0 { -half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angle_is_good_enough_for_the_guard_band() {
        for i in 0..100_000 {
            let exact = f64::from(i) / 100_000.0 * 2.0 * std::f64::consts::PI - std::f64::consts::PI;
            let (sin, cos) = libm::sincos(exact);
            for scale in [1e-6, 1.0, 1e3] {
                let error = f64::from(angle((scale * cos) as f32, (scale * sin) as f32)) - exact;
                assert!(error.abs() < f64::from(GUARD) / 2.0, "{exact}: {error}");
            }
        }
        assert_eq!(angle(0.0, 0.0), 0.0);
    }
}
