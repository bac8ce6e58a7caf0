//! Ranges against double precision: a reference written here and parry2d-f64, in random worlds of every shape kind.
#![allow(clippy::unwrap_used)]

use navsim::config::{Caster, LidarConfig};
use navsim::lidar::{Isa, Lidar, NoiseName, Surroundings, beam_angle};
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::world::{Obstacles, Shape};
use std::f64::consts::{FRAC_PI_2, PI};

fn config(beams: usize, fov: f64, range_max: f64) -> LidarConfig {
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

fn name() -> NoiseName {
    NoiseName { stream: StreamName::new(0, Purpose::Noise, Split::Train, 0, 0), scan: 0 }
}

/// The scan of `shapes`, half of them as static and half as moved obstacles.
fn scan(shapes: &[Shape], pose: Pose, config: &LidarConfig, isa: Isa) -> Vec<f32> {
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
fn excess(range: f32, shapes: &[Shape], origin: [f64; 2], angle: f64, range_max: f64) -> f64 {
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
    (low - 1e-4 - range).max(range - high - 1e-4).max(0.0)
}

fn random_shape(random: &mut Stream, kind: usize, half: f64) -> Shape {
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

fn room(half: f64) -> Vec<Shape> {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    (0..4).map(|i| Shape::Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect()
}

/// A pose on a coarse grid now and then, so that beams run exactly along walls and through corners.
fn random_pose(random: &mut Stream, half: f64) -> Pose {
    let (x, y) = (random.uniform(-half, half), random.uniform(-half, half));
    if random.unit() < 0.2 {
        return Pose::new(x.round(), y.round(), FRAC_PI_2 * random.uniform(-2.0, 2.0).round());
    }
    Pose::new(x, y, random.uniform(-PI, PI))
}

#[test]
fn ranges_agree_with_double_precision() {
    let worlds = if std::env::var_os("NAVRL_FULL").is_some() { 12_000 } else { 1_000 };
    let mut rays = 0;
    for index in 0..worlds {
        let mut random = Stream::new(StreamName::new(11, Purpose::World, Split::Train, index, 0));
        let half = [2.0, 5.0, 15.0][index as usize % 3];
        let mut shapes = room(half);
        for i in 0..12 {
            let kind = if index % 5 < 4 { index as usize % 5 } else { i % 4 };
            shapes.push(random_shape(&mut random, kind, half));
        }
        let (beams, fov) = [(180, PI), (20, 2.0 * PI), (97, 2.0 * PI), (33, 0.7), (1, 1.0)][index as usize % 5];
        let range_max = [100.0, 10.0][index as usize % 2];
        let config = config(beams, fov, range_max);
        for _ in 0..2 {
            let pose = random_pose(&mut random, half);
            let ranges = scan(&shapes, pose, &config, Isa::detect());
            for (beam, range) in ranges.iter().enumerate() {
                let angle = pose.yaw + beam_angle(&config, beam);
                let excess = excess(*range, &shapes, [pose.x, pose.y], angle, range_max);
                assert!(excess == 0.0, "world {index}, {pose:?}, beam {beam}: {range} is {excess} m off");
                rays += 1;
            }
        }
    }
    println!("{rays} rays");
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    for index in 0..300 {
        let mut random = Stream::new(StreamName::new(12, Purpose::World, Split::Train, index, 0));
        let mut shapes = room(5.0);
        shapes.extend((0..16).map(|i| random_shape(&mut random, i % 4, 5.0)));
        let mut config = config([180, 20, 361, 1][index as usize % 4], [PI, 2.0 * PI][index as usize % 2], 10.0);
        config.noise = 0.01;
        let pose = random_pose(&mut random, 4.0);
        let bits = |isa| scan(&shapes, pose, &config, isa).iter().map(|r| r.to_bits()).collect::<Vec<_>>();
        let baseline = bits(Isa::Baseline);
        assert_eq!(baseline, bits(Isa::Avx2));
        assert_eq!(baseline, bits(Isa::Avx512));
    }
}

#[test]
fn the_two_casters_agree() {
    let (mut rays, mut parted) = (0, 0);
    for index in 0..200 {
        let mut random = Stream::new(StreamName::new(13, Purpose::World, Split::Train, index, 0));
        let mut shapes = room(5.0);
        // Enough shapes for parry's hierarchy in every other world; circles apart, where parry's own f32 cast is coarse.
        shapes.extend((0..if index % 2 == 0 { 10 } else { 80 }).map(|i| random_shape(&mut random, 1 + i % 3, 5.0)));
        let raster = config(180, 2.0 * PI, 10.0);
        let parry = LidarConfig { caster: Caster::Parry, ..raster.clone() };
        let pose = Pose::new(random.uniform(-4.0, 4.0), random.uniform(-4.0, 4.0), random.uniform(-PI, PI));
        let (a, b) = (scan(&shapes, pose, &raster, Isa::detect()), scan(&shapes, pose, &parry, Isa::detect()));
        for (beam, (a, b)) in a.iter().zip(&b).enumerate() {
            rays += 1;
            if (a - b).abs() > 1e-4 {
                // At a corner or along a wall both may be right within the rule.
                parted += 1;
                let angle = pose.yaw + beam_angle(&raster, beam);
                assert_eq!(excess(*a, &shapes, [pose.x, pose.y], angle, 10.0), 0.0);
            }
        }
    }
    assert!(parted * 1000 < rays, "{parted} of {rays}");
}

#[test]
fn analytic_rays() {
    let wall = [Shape::Segment { a: [2.0, -50.0], b: [2.0, 50.0] }];
    let config = config(3, FRAC_PI_2, 10.0);
    // Beams at -30, 0, 30 degrees meet the wall x = 2 at 2 / cos.
    let ranges = scan(&wall, Pose::new(0.0, 0.0, 0.0), &config, Isa::detect());
    for (range, angle) in ranges.iter().zip([-30.0_f64, 0.0, 30.0]) {
        assert!((f64::from(*range) - 2.0 / angle.to_radians().cos()).abs() < 1e-6);
    }
    assert_eq!(scan(&wall, Pose::new(0.0, 0.0, PI), &config, Isa::detect()), [10.0; 3]);
    let circle = [Shape::Circle { center: [3.0, 0.0], radius: 1.0 }];
    let ranges = scan(&circle, Pose::new(0.0, 0.0, 0.0), &config, Isa::detect());
    assert_eq!((ranges[0], ranges[2]), (10.0, 10.0));
    assert!((ranges[1] - 2.0).abs() < 1e-6);
}

#[test]
fn a_lidar_inside_a_solid_sees_zero() {
    let solids = [
        Shape::Circle { center: [0.0, 0.0], radius: 1.0 },
        Shape::Box { center: [0.0, 0.0], yaw: 0.4, length: 2.0, width: 1.0 },
        Shape::polygon(vec![[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]]).unwrap(),
    ];
    for solid in solids {
        for caster in [Caster::Raster, Caster::Parry] {
            let config = LidarConfig { caster, range_min: 0.12, ..config(8, 2.0 * PI, 10.0) };
            // Zero before the lower bound of the lidar.
            assert_eq!(scan(std::slice::from_ref(&solid), Pose::new(0.1, 0.0, 0.0), &config, Isa::detect()), [0.12; 8]);
        }
    }
}

/// Beams straight at the corners of a closed chain of walls and of a regular polygon: none gets through.
#[test]
fn no_beam_leaks_through_a_shared_corner() {
    for corners in [3_usize, 4, 7, 60] {
        for radius in [0.5, 3.0, 14.0] {
            let corner = |i: usize| {
                let angle = 0.1 + 2.0 * PI * i as f64 / corners as f64;
                [radius * angle.cos(), radius * angle.sin()]
            };
            let chain: Vec<Shape> =
                (0..corners).map(|i| Shape::Segment { a: corner(i), b: corner((i + 1) % corners) }).collect();
            for i in 0..corners {
                for offset in -3..=3 {
                    let [x, y] = corner(i);
                    let yaw = y.atan2(x) + f64::from(offset) * 1e-7;
                    let ranges = scan(&chain, Pose::new(0.0, 0.0, yaw), &config(1, 0.1, 100.0), Isa::detect());
                    assert!(f64::from(ranges[0]) <= radius + 1e-4, "corner {i} of {corners} at {radius} m: {ranges:?}");
                }
            }
        }
    }
}

#[test]
fn the_mount_moves_the_origin() {
    let wall = [Shape::Segment { a: [2.0, -50.0], b: [2.0, 50.0] }];
    let mounted = LidarConfig { mount: [0.5, 0.2, FRAC_PI_2], ..config(1, 0.1, 10.0) };
    // The robot looks along -y, the lidar 0.5 m ahead of its centre to its left: along +x from (0.2, -0.5).
    let ranges = scan(&wall, Pose::new(0.0, 0.0, -FRAC_PI_2), &mounted, Isa::detect());
    assert!((ranges[0] - 1.8).abs() < 1e-6);
}
