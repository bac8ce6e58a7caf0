//! Properties of a scan in drawn worlds: the rule against double precision, and one answer from every way of casting.
#![allow(clippy::unwrap_used)]

mod reference;

use navsim::config::{Caster, LidarConfig};
use navsim::cpu::Isa;
use navsim::lidar::beam_angle;
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::world::Shape;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use reference::{config, excess, random_pose, random_shape, room, scan};
use std::f64::consts::PI;

/// A world with a lidar in it.
#[derive(Debug, Clone)]
struct Scene {
    shapes: Vec<Shape>,
    pose: Pose,
    lidar: LidarConfig,
}

impl Scene {
    /// The bits of the ranges.
    fn bits(&self, caster: Caster, isa: Isa) -> Vec<u32> {
        let lidar = LidarConfig { caster, ..self.lidar.clone() };
        scan(&self.shapes, self.pose, &lidar, isa).iter().map(|range| range.to_bits()).collect()
    }

    /// Whether every beam keeps the rule.
    fn check(&self) -> Result<(), TestCaseError> {
        for (beam, range) in scan(&self.shapes, self.pose, &self.lidar, Isa::detect()).iter().enumerate() {
            let angle = self.pose.yaw + self.lidar.mount[2] + beam_angle(&self.lidar, beam);
            let excess = excess(*range, &self.shapes, [self.pose.x, self.pose.y], angle, self.lidar.range_max);
            prop_assert!(excess == 0.0, "beam {beam}: {range} is {excess} m off");
        }
        Ok(())
    }

    /// Whether every way of casting gives the same bits: with and without shortcuts, on every instruction set.
    fn compare(&self) -> Result<(), TestCaseError> {
        let expected = self.bits(Caster::Raster, Isa::Baseline);
        for isa in Isa::available() {
            prop_assert_eq!(&expected, &self.bits(Caster::Raster, isa), "raster, {}", isa.name());
            prop_assert_eq!(&expected, &self.bits(Caster::Auto, isa), "auto, {}", isa.name());
        }
        Ok(())
    }
}

/// Rooms of 2 to 30 m with up to `most` shapes of one kind or of all; any field of view, direction and number of beams.
fn scenes(most: usize) -> impl Strategy<Value = Scene> {
    let beams = prop_oneof![3 => 1..=64_usize, 3 => 65..=400_usize, 1 => 401..=4096_usize];
    let fov = prop_oneof![Just(2.0 * PI), Just(PI), 0.01..2.0 * PI];
    let count = prop_oneof![0..=20_usize, 0..=most];
    (any::<u64>(), 1.0..15.0, count, 0..=4_usize, beams, fov, -PI..PI, prop_oneof![Just(100.0), 0.5..30.0]).prop_map(
        |(seed, half, count, kind, beams, fov, yaw, range_max)| {
            let mut random = Stream::new(StreamName::new(seed, Purpose::World, Split::Train, 0, 0));
            let mut shapes = room(half);
            shapes.extend((0..count).map(|i| random_shape(&mut random, if kind < 4 { kind } else { i % 4 }, half)));
            let lidar = LidarConfig { mount: [0.0, 0.0, yaw], ..config(beams, fov, range_max) };
            Scene { shapes, pose: random_pose(&mut random, half), lidar }
        },
    )
}

fn cases(some: u32, all: u32) -> ProptestConfig {
    let full = std::env::var_os("NAVRL_FULL").is_some();
    let cases = if full { all } else { some };
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(5), failure_persistence: None, ..ProptestConfig::default() }
}

/// As `scenes`, with walls that the lidar looks along: on the line of a beam, ahead or behind, but for a few roundings.
fn scenes_edge_on() -> impl Strategy<Value = Scene> {
    (scenes(0), any::<u64>(), 0..=3_i32).prop_map(|(mut scene, seed, noise)| {
        let mut random = Stream::new(StreamName::new(seed, Purpose::World, Split::Train, 1, 0));
        let Scene { shapes, pose, lidar } = &mut scene;
        for _ in 0..20 {
            let beam = random.uniform(0.0, lidar.beams as f64) as usize;
            let angle = pose.yaw + lidar.mount[2] + beam_angle(lidar, beam);
            let near = random.uniform(-5.0, 5.0);
            let far = near + near.signum() * random.uniform(0.01, 5.0);
            let mut at = |range: f64| {
                let mut near = |value: f64| value + random.uniform(-1e-8, 1e-8) * f64::from(noise);
                [near(pose.x + range * angle.cos()), near(pose.y + range * angle.sin())]
            };
            shapes.push(Shape::Segment { a: at(near), b: at(far) });
        }
        scene
    })
}

proptest! {
    #![proptest_config(cases(150, 3_000))]

    #[test]
    fn ranges_follow_the_rule(scene in scenes(60)) {
        scene.check()?;
    }

    #[test]
    fn every_way_of_casting_gives_the_same_bits(scene in scenes(1_500)) {
        scene.compare()?;
    }

    #[test]
    fn walls_seen_edge_on_follow_the_rule(scene in scenes_edge_on()) {
        scene.check()?;
        scene.compare()?;
    }
}
