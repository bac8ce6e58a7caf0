//! Whole steps and resets of a batch: motion, collision, scan, observation, reward and the resets that come due.
#![allow(missing_docs, clippy::unwrap_used)]

use benches::config;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use navsim::BatchSim;
use navsim::rng::{Purpose, Split, Stream, StreamName};

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
        ("open8", 4096, 2, 0.0),
        ("td3", 256, 1, 0.008),
    ] {
        let mut sim = BatchSim::new(config(world, 180, noise), robots, 0, threads, true, None).unwrap();
        let actions = actions(2 * robots);
        group.throughput(Throughput::Elements(robots as u64));
        let id = BenchmarkId::new(world, format!("{robots} robots, {threads} threads, noise {noise}"));
        group.bench_function(id, |bencher| bencher.iter(|| sim.step(&actions).unwrap()));
    }
    group.finish();
}

fn reset(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("reset");
    for world in ["td3", "boxes", "open8"] {
        let mut sim = BatchSim::new(config(world, 180, 0.0), 64, 0, 1, true, None).unwrap();
        group.throughput(Throughput::Elements(64));
        group.bench_function(world, |bencher| bencher.iter(|| sim.reset(None).unwrap()));
    }
    group.finish();
}

criterion_group!(benches, step, reset);
criterion_main!(benches);
