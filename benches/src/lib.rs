//! What the benches share: the default configuration in a built-in world.

use navsim::SimConfig;

/// The default robot, lidar and task in the world `name`, with `beams` beams and noise of `noise` metres.
pub fn config(name: &str, beams: usize, noise: f64) -> SimConfig {
    #[allow(clippy::expect_used)] // a file of this repository, compared with Python's defaults by tests/test_config.py
    let mut config = SimConfig::from_json(include_str!("../../crates/navsim/tests/defaults.json")).expect("defaults");
    config.world.name = name.into();
    (config.lidar.beams, config.lidar.noise, config.lidar.bins) = (beams, noise, 20.min(beams));
    config
}
