//! Decisions of the controllers, on scans of robots in the middle of their way.
#![allow(missing_docs, clippy::unwrap_used)]

use benches::config;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use navsim::BatchSim;
use navsim::controller::{Controller, ControllersConfig, Inputs, Kind};

const ROBOTS: usize = 64;

/// Ranges, goals and velocities of robots that have driven some steps in `td3`.
fn situations() -> (Vec<f32>, Vec<f64>, Vec<f64>) {
    let sim = config("td3", 180, 0.008);
    let bins = sim.lidar.bins;
    let mut batch = BatchSim::new(sim, ROBOTS, 0, 1, true, None).unwrap();
    for t in 0..30 {
        let actions: Vec<f32> = (0..ROBOTS).flat_map(|k| [0.6, if (t + k) % 20 < 12 { 0.3 } else { -0.5 }]).collect();
        batch.step(&actions).unwrap();
    }
    batch.keep_ranges().unwrap();
    let ranges = batch.ranges().to_vec();
    let results = batch.results();
    let rows = results.observations.chunks(bins + 4);
    let goals = rows.flat_map(|row| [f64::from(row[bins]), f64::from(row[bins + 1])]).collect();
    (ranges, goals, results.velocities.clone())
}

fn controllers(criterion: &mut Criterion) {
    let (ranges, goals, velocities) = situations();
    let settings = include_str!("../../crates/navsim/tests/controllers.json");
    let settings = ControllersConfig::from_json(settings).unwrap();
    let inputs = Inputs { robots: None, ranges: &ranges, goals: &goals, velocities: &velocities };
    let mut group = criterion.benchmark_group("controller");
    group.sample_size(20).throughput(Throughput::Elements(ROBOTS as u64));
    for kind in Kind::ALL {
        let mut controller = Controller::new(kind, &settings, &config("td3", 180, 0.008), 0).unwrap();
        let mut commands = [0.0; 2 * ROBOTS];
        group.bench_function(kind.name(), |bencher| {
            bencher.iter(|| controller.command(&inputs, &mut commands).unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, controllers);
criterion_main!(benches);
