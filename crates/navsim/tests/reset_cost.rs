//! What a reset costs: `cargo test --release -p navsim --test reset_cost -- --ignored --nocapture`.
#![allow(clippy::unwrap_used)]

use navsim::config::WorldConfig;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::robot::Footprint;
use navsim::world::{Generator, Layout};
use std::time::Instant;

const RESETS: u64 = 1_000;

#[test]
#[ignore = "a measurement"]
fn print_the_cost_of_a_reset() {
    for (name, boxes) in [("td3", 0), ("boxes", 4), ("boxes", 8), ("boxes", 16), ("boxes", 32), ("open8", 0)] {
        let config = WorldConfig {
            name: name.into(),
            boxes,
            random_yaw: true,
            goal_range_start: 10.0,
            goal_range_growth: 0.0,
            goal_range_max: 10.0,
        };
        let generator = Generator::new(&config, &Footprint::Disc { radius: 0.25 }).unwrap();
        let mut layout = Layout::default();
        let mut costs: Vec<f64> = (0..60)
            .map(|round| {
                let begin = Instant::now();
                for episode in 0..RESETS {
                    let name = StreamName::new(0, Purpose::World, Split::Train, round, episode);
                    generator.draw(&mut Stream::new(name), episode, &mut layout).unwrap();
                }
                begin.elapsed().as_secs_f64() * 1e9 / RESETS as f64
            })
            .collect();
        costs.sort_by(f64::total_cmp);
        println!(
            "{name:>6} {boxes:>2}: {:6.0} / {:6.0} / {:6.0} ns a reset (min / median / max)",
            costs[0], costs[30], costs[59]
        );
    }
}
