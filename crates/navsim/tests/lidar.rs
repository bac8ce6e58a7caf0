//! Ranges against double precision: a reference written here and parry2d-f64, in random worlds of every shape kind.
#![allow(clippy::unwrap_used)]

mod reference;

use navsim::config::{Caster, LidarConfig};
use navsim::cpu::Isa;
use navsim::lidar::beam_angle;
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::world::Shape;
use reference::{config, excess, random_pose, random_shape, room, scan};
use std::f64::consts::{FRAC_PI_2, PI};

#[test]
fn ranges_agree_with_double_precision() {
    let worlds = if std::env::var_os("NAVRL_FULL").is_some() { 12_000 } else { 1_000 };
    let mut rays = 0;
    for index in 0..worlds {
        let mut random = Stream::new(StreamName::new(11, Purpose::World, Split::Train, index, 0));
        let half = [2.0, 5.0, 15.0][index as usize % 3];
        let mut shapes = room(half);
        // Every hundredth world is large enough for the trees of both halves.
        for i in 0..if index % 100 == 7 { 1_000 } else { 12 } {
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
        for isa in Isa::available() {
            assert_eq!(bits(Isa::Baseline), bits(isa), "{}", isa.name());
        }
    }
}

#[test]
fn the_two_casters_agree() {
    let (mut rays, mut parted) = (0, 0);
    for index in 0..200 {
        let mut random = Stream::new(StreamName::new(13, Purpose::World, Split::Train, index, 0));
        let mut shapes = room(5.0);
        // Enough shapes for parry's hierarchy in every other world; circles apart, where parry's own f32 cast is
        // coarse.
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

/// Beams straight at the corners of a closed chain of walls: none gets through.
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

/// The answers that `Lidar::scan` documents for beams that meet an edge in one point or in all.
#[test]
fn special_beams_have_the_documented_answer() {
    let ahead = |shapes: &[Shape], caster| {
        scan(shapes, Pose::default(), &LidarConfig { caster, ..config(1, 0.1, 10.0) }, Isa::detect())[0]
    };
    let wall = |a, b| Shape::Segment { a, b };
    for caster in [Caster::Auto, Caster::Raster] {
        // Along a wall: the wall is not met, what stands at its end is.
        assert_eq!(ahead(&[wall([2.0, 0.0], [4.0, 0.0])], caster), 10.0);
        assert_eq!(ahead(&[wall([2.0, 0.0], [4.0, 0.0]), wall([4.0, -1.0], [4.0, 1.0])], caster), 4.0);
        // Along a side of a box, 2 m to 4 m ahead: its near side ends on the beam and is met.
        let beside = Shape::Box { center: [3.0, 0.5], yaw: 0.0, length: 2.0, width: 1.0 };
        assert_eq!(ahead(&[beside], caster), 2.0);
        // Through the end of a wall, and through the corner of a box.
        assert_eq!(ahead(&[wall([3.0, 0.0], [3.0, 1.0])], caster), 3.0);
        let corner = Shape::polygon(vec![[3.0, 0.0], [4.0, -1.0], [5.0, 0.0], [4.0, 1.0]]).unwrap();
        assert_eq!(ahead(&[corner], caster), 3.0);
        // Standing on a wall that crosses the beam, and on one that runs along it.
        assert_eq!(ahead(&[wall([0.0, -1.0], [0.0, 1.0])], caster), 10.0);
        assert_eq!(ahead(&[wall([-1.0, 0.0], [1.0, 0.0])], caster), 10.0);
        // A circle that the beam touches, and one that it misses by a millimetre.
        assert!((ahead(&[Shape::Circle { center: [3.0, 1.0], radius: 1.0 }], caster) - 3.0).abs() < 1e-3);
        assert_eq!(ahead(&[Shape::Circle { center: [3.0, 1.001], radius: 1.0 }], caster), 10.0);
    }
}

/// Beams straight at the corner of a solid that lies between two faces in sight: none gets through.
#[test]
fn no_beam_leaks_through_the_corner_of_a_solid() {
    let mut random = Stream::new(StreamName::new(14, Purpose::World, Split::Train, 0, 0));
    for i in 0..2_000 {
        let (x, y, yaw) = (random.uniform(-14.0, 14.0), random.uniform(-14.0, 14.0), random.uniform(-PI, PI));
        let (length, width) = (random.uniform(0.001, 3.0), random.uniform(0.001, 3.0));
        let (sin, cos) = yaw.sin_cos();
        let corner = |along: f64, across: f64| [x + along * cos - across * sin, y + along * sin + across * cos];
        let solid = if i % 2 == 0 {
            Shape::Box { center: [x, y], yaw, length, width }
        } else {
            let (a, b) = (0.5 * length, 0.5 * width);
            Shape::polygon(vec![corner(-a, -b), corner(a, -b), corner(a, b), corner(-a, b)]).unwrap()
        };
        // The lidar stands beyond the corner on both sides, so that both of its faces are in sight, and far enough for
        // a beam beside the corner to meet them near it.
        let [from_x, from_y] = corner(0.5 * length + random.uniform(1.0, 8.0), 0.5 * width + random.uniform(1.0, 8.0));
        let [to_x, to_y] = corner(0.5 * length, 0.5 * width);
        let (dx, dy) = (to_x - from_x, to_y - from_y);
        for offset in -3..=3 {
            let pose = Pose::new(from_x, from_y, dy.atan2(dx) + f64::from(offset) * 1e-7);
            for isa in Isa::available() {
                let range = scan(std::slice::from_ref(&solid), pose, &config(1, 0.1, 100.0), isa)[0];
                assert!((f64::from(range) - dx.hypot(dy)).abs() < 1e-4, "{solid:?} from {pose:?}: {range}");
            }
        }
    }
}
