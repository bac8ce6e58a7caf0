//! What the tests of the lidar share: scans, random worlds, and a reference in double precision.
#![allow(dead_code)]

use navsim::config::{Caster, LidarConfig};
use navsim::cpu::Isa;
use navsim::lidar::{Lidar, NoiseName, Surroundings};
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::world::{Obstacles, Shape};
use std::f64::consts::{FRAC_PI_2, PI};

/// A lidar without noise at the robot's centre.
pub fn config(beams: usize, fov: f64, range_max: f64) -> LidarConfig {
    LidarConfig {
        beams,
        fov,
        range_min: 0.0,
        range_max,
        noise: 0.0,
        noise_per_meter: 0.0,
        resolution: 0.0,
        drop_probability: 0.0,
        mount: [0.0; 3],
        bins: 1,
        caster: Caster::Auto,
    }
}

/// Any stream: the tests add no noise, or compare scans with the same.
pub fn name() -> NoiseName {
    NoiseName { stream: StreamName::new(0, Purpose::Noise, Split::Train, 0, 0), scan: 0 }
}

/// The scan of `shapes`, half of them as static and half as moved obstacles.
pub fn scan(shapes: &[Shape], pose: Pose, config: &LidarConfig, isa: Isa) -> Vec<f32> {
    let lidar = Lidar::with_isa(config, isa);
    let (fixed, moved) = shapes.split_at(shapes.len() / 2);
    let (fixed, moved) = (Obstacles::new(fixed), Obstacles::new(moved));
    let around = Surroundings { obstacles: [&fixed, &moved], world_from_robot: pose, center_distance: 0.0 };
    lidar.scan(&around, &name(), &mut lidar.buffer()).to_vec()
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn sub(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// Range of one ray against one shape in double precision; 0 inside a solid.
fn reference(shape: &Shape, origin: [f64; 2], direction: [f64; 2]) -> f64 {
    if let Shape::Circle { center, radius } = shape {
        let to_center = sub(*center, origin);
        let (along, across) = (to_center[0] * direction[0] + to_center[1] * direction[1], cross(direction, to_center));
        if to_center[0].hypot(to_center[1]) <= *radius {
            return 0.0;
        }
        let chord = (radius - across.abs()) * (radius + across.abs());
        return if chord >= 0.0 && along > 0.0 { along - chord.sqrt() } else { f64::INFINITY };
    }
    let corners = shape.corners();
    let n = corners.len();
    let edges = if n == 2 { 1 } else { n };
    if n > 2 && (0..n).all(|i| cross(sub(corners[(i + 1) % n], corners[i]), sub(origin, corners[i])) >= 0.0) {
        return 0.0;
    }
    (0..edges)
        .map(|i| reference_edge(corners[i], corners[(i + 1) % n], origin, direction))
        .fold(f64::INFINITY, f64::min)
}

fn reference_edge(a: [f64; 2], b: [f64; 2], origin: [f64; 2], direction: [f64; 2]) -> f64 {
    let (to_a, edge) = (sub(a, origin), sub(b, a));
    let denominator = cross(direction, edge);
    if denominator == 0.0 {
        return f64::INFINITY;
    }
    let (range, share) = (cross(to_a, edge) / denominator, cross(to_a, direction) / denominator);
    if range >= 0.0 && (0.0..=1.0).contains(&share) { range } else { f64::INFINITY }
}

fn reference_range(shapes: &[Shape], origin: [f64; 2], angle: f64, range_max: f64) -> f64 {
    let direction = [angle.cos(), angle.sin()];
    shapes.iter().map(|s| reference(s, origin, direction)).fold(range_max, f64::min)
}

/// The rule: a range lies within 0.1 mm of what double precision gives for an origin within 4 um and an angle within
/// 1 urad. Returns how far it is outside.
pub fn excess(range: f32, shapes: &[Shape], origin: [f64; 2], angle: f64, range_max: f64) -> f64 {
    let range = f64::from(range);
    let exact = reference_range(shapes, origin, angle, range_max);
    if (range - exact).abs() <= 1e-4 {
        return 0.0;
    }
    let (mut low, mut high) = (exact, exact);
    // The nanometres take a ray off a wall that its origin stands on.
    for dx in [-4e-6, -1e-9, 0.0, 1e-9, 4e-6] {
        for dy in [-4e-6, -1e-9, 0.0, 1e-9, 4e-6] {
            for da in [-1e-6, 0.0, 1e-6] {
                let near = reference_range(shapes, [origin[0] + dx, origin[1] + dy], angle + da, range_max);
                (low, high) = (low.min(near), high.max(near));
            }
        }
    }
    // Samples miss most of a wall that the beam runs along: all of it within these bounds may be met.
    let low = shapes.iter().fold(low, |low, shape| low.min(nearest_grazed(shape, origin, angle)));
    (low - 1e-4 - range).max(range - high - 1e-4).max(0.0)
}

/// Range of the nearest point of the shape's edges that a beam from within 4 um and 1 urad may meet.
fn nearest_grazed(shape: &Shape, origin: [f64; 2], angle: f64) -> f64 {
    let direction = [angle.cos(), angle.sin()];
    let place = |corner: [f64; 2]| {
        let to = sub(corner, origin);
        (to[0] * direction[0] + to[1] * direction[1], cross(direction, to))
    };
    let corners = shape.corners();
    let mut nearest = f64::INFINITY;
    for (i, corner) in corners.iter().enumerate() {
        let ((ahead, aside), (end_ahead, end_aside)) = (place(*corner), place(corners[(i + 1) % corners.len()]));
        // The part of the edge where each of three terms, linear along it, is not negative.
        let terms = |ahead: f64, aside: f64| [ahead, 5.7e-6 + 1e-6 * ahead - aside, 5.7e-6 + 1e-6 * ahead + aside];
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for (a, b) in terms(ahead, aside).into_iter().zip(terms(end_ahead, end_aside)) {
            let zero = a / (a - b);
            match (a >= 0.0, b >= 0.0) {
                (true, true) => {}
                (true, false) => last = last.min(zero),
                (false, true) => first = first.max(zero),
                (false, false) => last = -1.0,
            }
        }
        if first <= last {
            let at = |share: f64| ahead + share * (end_ahead - ahead);
            nearest = nearest.min(at(first)).min(at(last));
        }
    }
    nearest
}

/// A circle (kind 0), box, segment or polygon within about `half` of the middle.
pub fn random_shape(random: &mut Stream, kind: usize, half: f64) -> Shape {
    let mut at = || [random.uniform(-half, half), random.uniform(-half, half)];
    let center = at();
    let near = at();
    match kind {
        0 => Shape::Circle { center, radius: random.uniform(0.02, 1.0) },
        1 => Shape::Box {
            center,
            yaw: random.uniform(-PI, PI),
            length: random.uniform(0.01, 3.0),
            width: random.uniform(0.001, 1.0),
        },
        2 => Shape::Segment { a: center, b: near },
        _ => {
            let (radius, turn) = (random.uniform(0.05, 1.5), random.uniform(0.0, PI));
            let corners = 3 + (random.uniform(0.0, 6.0) as usize);
            let corner = |i: usize| {
                let angle = turn + 2.0 * PI * i as f64 / corners as f64;
                [center[0] + radius * angle.cos(), center[1] + radius * angle.sin()]
            };
            Shape::polygon((0..corners).map(corner).collect()).unwrap()
        }
    }
}

/// Four walls.
pub fn room(half: f64) -> Vec<Shape> {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    (0..4).map(|i| Shape::Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect()
}

/// A pose on a coarse grid now and then, so that beams run exactly along walls and through corners.
pub fn random_pose(random: &mut Stream, half: f64) -> Pose {
    let (x, y) = (random.uniform(-half, half), random.uniform(-half, half));
    if random.unit() < 0.2 {
        return Pose::new(x.round(), y.round(), FRAC_PI_2 * random.uniform(-2.0, 2.0).round());
    }
    Pose::new(x, y, random.uniform(-PI, PI))
}
