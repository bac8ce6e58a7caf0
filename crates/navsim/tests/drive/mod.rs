//! What batches are made of in tests, and how their robots are driven.

use navsim::SimConfig;
use navsim::rng::{Purpose, Split, Stream, StreamName};

/// Python's defaults, in another world.
pub fn config(world: &str) -> SimConfig {
    let mut config = SimConfig::from_json(include_str!("../defaults.json")).unwrap();
    config.world.name = world.into();
    config
}

/// Actions that robot `k` takes at step `t`, the same whatever the batch.
pub fn actions(robots: usize, t: u32) -> Vec<f32> {
    let action = |k: usize| {
        let mut random = Stream::new(StreamName::new(5, Purpose::World, Split::Given, k as u32, u64::from(t)));
        [random.uniform(-0.2, 1.0) as f32, random.uniform(-1.0, 1.0) as f32]
    };
    (0..robots).flat_map(action).collect()
}
