//! A step and its parts: whole steps by robots, threads and noise, resets, the swept collision test, noise, and bins.
#![allow(missing_docs, clippy::unwrap_used)]

use benches::config;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use navsim::BatchSim;
use navsim::collision::{Clearance, clearance, sweep};
use navsim::config::LidarConfig;
use navsim::lidar::{Lidar, NoiseName, Surroundings};
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::robot::{Arc, Footprint};
use navsim::world::{Generator, Layout, Obstacles};
use std::hint::black_box;

fn actions(count: usize) -> Vec<f32> {
    let mut random = Stream::new(StreamName::new(1, Purpose::World, Split::Given, 0, 0));
    (0..count).map(|_| random.uniform(-1.0, 1.0) as f32).collect()
}

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    for (world, robots, threads, noise) in [
        ("open8", 1, 1, 0.0),
        ("open8", 64, 1, 0.0),
        ("open8", 1024, 1, 0.0),
        ("open8", 16384, 1, 0.0),
        ("open8", 1024, 1, 0.008),
        ("open8", 4096, 1, 0.0),
        ("open8", 4096, 2, 0.0),
        ("td3", 256, 1, 0.008),
    ] {
        let mut sim = BatchSim::new(config(world, 180, noise), robots, 0, threads, true, None).unwrap();
        // Sixteen commands in turn: robots that keep one of their own circle, and collide at once or never.
        let actions = actions(16 * 2 * robots);
        let mut turns = actions.chunks(2 * robots).cycle();
        group.throughput(Throughput::Elements(robots as u64));
        let id = BenchmarkId::new(world, format!("{robots} robots, {threads} threads, noise {noise}"));
        group.bench_function(id, |bencher| bencher.iter(|| sim.step(turns.next().unwrap()).unwrap()));
    }
    group.finish();
}

/// A draw of start, goal and obstacles with a way between them, and a reset with the first observation.
fn reset(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("reset");
    for (world, boxes) in [("td3", 0), ("boxes", 8), ("boxes", 32), ("open8", 0)] {
        let mut config = config(world, 180, 0.0);
        config.world.boxes = boxes;
        let generator = Generator::new(&config.world, &Footprint::new(&config.robot)).unwrap();
        let (mut layout, mut episode) = (Layout::default(), 0);
        group.bench_function(BenchmarkId::new(world, format!("draw, {boxes} boxes")), |bencher| {
            bencher.iter(|| {
                episode += 1;
                let name = StreamName::new(0, Purpose::World, Split::Train, 0, episode);
                generator.draw(&mut Stream::new(name), episode, &mut layout).unwrap();
            });
        });
        let mut sim = BatchSim::new(config, 64, 0, 1, true, None).unwrap();
        group.throughput(Throughput::Elements(64));
        group.bench_function(BenchmarkId::new(world, format!("64 robots, {boxes} boxes")), |bencher| {
            bencher.iter(|| sim.reset(None).unwrap());
        });
        group.throughput(Throughput::Elements(1));
    }
    group.finish();
}

/// A step of 0.05 m and one of 10 m from starts in worlds of `open8`, and the clearance alone.
fn collision(criterion: &mut Criterion) {
    let config = config("open8", 180, 0.0);
    let generator = Generator::new(&config.world, &Footprint::new(&config.robot)).unwrap();
    let none = Obstacles::default();
    let worlds: Vec<(Obstacles, Pose)> = (0..64)
        .map(|index| generator.draw_listed(Split::Tuning, 0, index, &config.task).unwrap())
        .map(|scenario| (Obstacles::new(&scenario.shapes), scenario.start))
        .collect();
    let mut group = criterion.benchmark_group("collision");
    let disc = Footprint::Disc { radius: 0.25 };
    let rectangle = Footprint::Rectangle { length: 0.5, width: 0.4 };
    for (name, footprint) in [("disc", disc), ("rectangle", rectangle)] {
        let mut next = worlds.iter().cycle();
        group.bench_function(format!("clearance, {name}"), |bencher| {
            bencher.iter(|| next.next().map(|(obstacles, pose)| clearance(&footprint, pose, [obstacles, &none])));
        });
        for v in [0.5, 100.0] {
            let gap = |(obstacles, pose): &(_, _)| Clearance::exactly(clearance(&footprint, pose, [obstacles, &none]));
            let gaps: Vec<Clearance> = worlds.iter().map(gap).collect();
            let mut next = worlds.iter().zip(&gaps).cycle();
            group.bench_function(format!("sweep at {v} m/s, {name}"), |bencher| {
                bencher.iter(|| {
                    let ((obstacles, start), gap) = next.next().unwrap();
                    let arc = Arc { start: *start, v, omega: 0.7 };
                    sweep(&footprint, &arc, 0.1, [obstacles, &none], *gap, f32::INFINITY)
                });
            });
        }
    }
    group.finish();
}

/// Noise and faults of 180 beams, on top of a scan in a world without obstacles.
fn noise(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("noise");
    let quiet = config("open8", 180, 0.0).lidar;
    let none = Obstacles::default();
    let stream = StreamName::new(0, Purpose::Noise, Split::Given, 0, 0);
    for (name, lidar) in [
        ("none", quiet.clone()),
        ("sigma", LidarConfig { noise: 0.01, ..quiet.clone() }),
        ("sigma and per meter", LidarConfig { noise: 0.01, noise_per_meter: 0.01, ..quiet.clone() }),
        ("resolution", LidarConfig { resolution: 0.001, ..quiet.clone() }),
        ("lost beams", LidarConfig { drop_probability: 0.01, ..quiet }),
    ] {
        let lidar = Lidar::new(&lidar).unwrap();
        let (mut buffer, mut scan) = (lidar.buffer(), 0);
        let around =
            Surroundings { obstacles: [&none, &none], world_from_robot: Pose::default(), center_distance: 1.0 };
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                scan += 1;
                black_box(lidar.scan(&around, &NoiseName { stream, scan }, &mut buffer)[0])
            });
        });
    }
    group.finish();
}

/// 180 beams to 20 bins, 1,080 to 40.
fn bins(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("bins");
    for (beams, count) in [(180, 20), (1080, 40)] {
        let mut config = config("open8", beams, 0.0).lidar;
        config.bins = count;
        let lidar = Lidar::new(&config).unwrap();
        let (buffer, mut pooled) = (lidar.buffer(), vec![0.0; count]);
        group.bench_function(format!("{beams} beams to {count}"), |bencher| {
            bencher.iter(|| lidar.pool(&buffer, black_box(&mut pooled)));
        });
    }
    group.finish();
}

criterion_group!(benches, step, reset, collision, noise, bins);
criterion_main!(benches);
