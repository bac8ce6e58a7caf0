//! One scan: caster, instruction set, beams and noise, in 64 drawn worlds of `open8` (8 boxes, 4 walls, 4 inner walls).
#![allow(missing_docs, clippy::unwrap_used)]

use benches::config;
use criterion::{Criterion, criterion_group, criterion_main};
use navsim::config::{Caster, LidarConfig};
use navsim::lidar::{Isa, Lidar, NoiseName, Surroundings};
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, StreamName};
use navsim::world::{Generator, Obstacles};
use std::hint::black_box;

/// Worlds with a pose in each that is not in contact.
fn worlds() -> Vec<(Obstacles, Pose)> {
    let config = config("open8", 180, 0.0);
    let footprint = navsim::robot::Footprint::new(&config.robot);
    let generator = Generator::new(&config.world, &footprint).unwrap();
    let draw = |index| generator.draw_listed(Split::Tuning, 0, index, &config.task).unwrap();
    (0..64).map(draw).map(|scenario| (Obstacles::new(&scenario.shapes), scenario.start)).collect()
}

fn scan(criterion: &mut Criterion) {
    let worlds = worlds();
    let none = Obstacles::default();
    let stream = StreamName::new(0, Purpose::Noise, Split::Given, 0, 0);
    let mut group = criterion.benchmark_group("scan");
    let mut bench = |name: String, lidar: &LidarConfig, isa: Isa| {
        let lidar = Lidar::with_isa(lidar, isa);
        let (mut buffer, mut count) = (lidar.buffer(), 0);
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                count = (count + 1) % worlds.len();
                let (obstacles, pose) = &worlds[count];
                let around =
                    Surroundings { obstacles: [obstacles, &none], world_from_robot: *pose, center_distance: 1.0 };
                let ranges = lidar.scan(&around, &NoiseName { stream, scan: count as u32 }, &mut buffer);
                black_box(ranges[0])
            });
        });
    };
    let base = config("open8", 180, 0.0).lidar;
    for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| *isa <= Isa::detect()) {
        bench(format!("raster, 180 beams, {}", isa.name()), &base, isa);
    }
    let best = Isa::detect();
    let turn = 2.0 * std::f64::consts::PI;
    for (beams, fov) in [(20, turn), (360, turn), (1080, 0.75 * turn)] {
        bench(format!("raster, {beams} beams"), &LidarConfig { beams, fov, ..base.clone() }, best);
    }
    bench("raster, 180 beams, noise".into(), &LidarConfig { noise: 0.008, ..base.clone() }, best);
    bench("parry, 180 beams".into(), &LidarConfig { caster: Caster::Parry, ..base }, best);
}

criterion_group!(benches, scan);
criterion_main!(benches);
