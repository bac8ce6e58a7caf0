//! Settings of the controllers. Python holds the defaults; here every field must be given and is checked once more.
//!
//! The tables and keys are those of the configuration file: `dwa`, `apf`, `gap`, `mppi`, `pursuit`.

use crate::config::check;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// The settings of every controller that has any.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControllersConfig {
    /// Dynamic window.
    pub dwa: DwaConfig,
    /// Artificial potential field.
    pub apf: ApfConfig,
    /// Gap following.
    pub gap: GapConfig,
    /// Model predictive path integral control.
    pub mppi: MppiConfig,
    /// Regulated pure pursuit.
    pub pursuit: PursuitConfig,
}

/// The dynamic window: objective heading x h + clearance x c + speed x v, each part in [0, 1], but for the clearance of
/// `dwa-1997`, which is in metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DwaConfig {
    /// Weight of looking at the goal at the horizon, >= 0.
    pub heading: f64,
    /// Weight of the free way along the arc, >= 0.
    pub clearance: f64,
    /// Weight of the forward speed, >= 0.
    pub speed: f64,
    /// Time after which the heading is judged, s.
    pub horizon: f64,
    /// A free way of this length or more counts in full, m.
    pub clearance_max: f64,
    /// Added to the robot's radius, m.
    pub margin: f64,
    /// Time that the command acts before the robot can brake, s.
    pub reaction: f64,
    /// Time in which the speeds of the window are reached, s.
    pub interval: f64,
    /// Forward speeds that are tried.
    pub v_samples: usize,
    /// Turning speeds that are tried.
    pub omega_samples: usize,
}

/// The potential field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ApfConfig {
    /// Weight of the repulsion beside an attraction of 1, m^2.
    pub repulsion: f64,
    /// Clearance at which the repulsion begins, m.
    pub reach: f64,
    /// Turning speed per angle to the force, 1/s.
    pub turn_gain: f64,
}

/// Gap following.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GapConfig {
    /// A direction is free if the robot can drive so far in it, m.
    pub reach: f64,
    /// Added to the robot's radius, m.
    pub margin: f64,
    /// Cost of a direction per angle to the goal, 1/rad.
    pub goal: f64,
    /// Cost of a direction per angle to the heading, 1/rad.
    pub heading: f64,
    /// How far from the border of a wide gap the robot aims, rad.
    pub border: f64,
    /// Turning speed per angle to the chosen direction, 1/s.
    pub turn_gain: f64,
    /// Free way ahead at which the robot drives at full speed, m.
    pub slow_distance: f64,
}

/// Model predictive path integral control.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MppiConfig {
    /// Sampled sequences of commands.
    pub samples: usize,
    /// Commands of a sequence.
    pub steps: usize,
    /// Time that a command of a sequence lasts, s.
    pub step: f64,
    /// Cost by which a sequence loses a factor e of weight.
    pub temperature: f64,
    /// Steps that a draw of noise lasts.
    pub hold: usize,
    /// Standard deviation of the forward speed's noise, m/s.
    pub v_noise: f64,
    /// Standard deviation of the turning speed's noise, rad/s.
    pub omega_noise: f64,
    /// Cost per metre to the goal and second, 1/(m s).
    pub goal: f64,
    /// Cost per second at an obstacle's inflated border, 1/s; falls with the square to 0 at `inflation`.
    pub obstacle: f64,
    /// Clearance at which obstacles begin to cost, m.
    pub inflation: f64,
    /// Added to the robot's radius, m.
    pub margin: f64,
    /// Cost per second in contact, 1/s.
    pub collision: f64,
}

/// Regulated pure pursuit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PursuitConfig {
    /// Distance along the path of the point that is pursued, m.
    pub lookahead: f64,
    /// A larger angle to that point is turned away in place, rad.
    pub turn_in_place: f64,
    /// Turning speed per angle while turning in place, 1/s.
    pub turn_gain: f64,
    /// Angle up to which arcs beside a blocked one are tried, rad.
    pub detour: f64,
    /// Arcs of a smaller radius are driven slower in proportion, m.
    pub radius_min: f64,
    /// Distance to the goal at which the robot begins to slow, m.
    pub approach: f64,
    /// Slowest forward speed while it slows, m/s.
    pub v_min: f64,
    /// The robot slows so that it could still stop on the free way along its arc a period and this time later, s.
    pub stop_time: f64,
    /// Added to the robot's radius, m; half of the clearance where that is less.
    pub margin: f64,
}

impl ControllersConfig {
    /// Reads the settings from JSON with every key of every table given.
    ///
    /// # Errors
    /// A missing or unknown key, a wrong type, or a value that `validate` refuses.
    pub fn from_json(text: &str) -> Result<Self> {
        let config: Self = serde_json::from_str(text).map_err(|e| Error::Parse(format!("controllers: {e}")))?;
        config.validate()?;
        Ok(config)
    }

    /// Checks every range.
    ///
    /// # Errors
    /// The first setting that is out of its range.
    pub fn validate(&self) -> Result<()> {
        let Self { dwa, apf, gap, mppi, pursuit } = self;
        for (key, value, range) in [
            ("dwa.heading", dwa.heading, 0.0..=1e6),
            ("dwa.clearance", dwa.clearance, 0.0..=1e6),
            ("dwa.speed", dwa.speed, 0.0..=1e6),
            ("dwa.horizon", dwa.horizon, 1e-3..=60.0),
            ("dwa.clearance_max", dwa.clearance_max, 1e-3..=1000.0),
            ("dwa.margin", dwa.margin, 0.0..=10.0),
            ("dwa.reaction", dwa.reaction, 0.0..=10.0),
            ("dwa.interval", dwa.interval, 1e-3..=10.0),
            ("dwa.v_samples", dwa.v_samples as f64, 2.0..=1001.0),
            ("dwa.omega_samples", dwa.omega_samples as f64, 2.0..=1001.0),
            ("apf.repulsion", apf.repulsion, 0.0..=1e6),
            ("apf.reach", apf.reach, 1e-3..=1000.0),
            ("apf.turn_gain", apf.turn_gain, 0.0..=1000.0),
            ("gap.reach", gap.reach, 1e-3..=1000.0),
            ("gap.margin", gap.margin, 0.0..=10.0),
            ("gap.goal", gap.goal, 0.0..=1e6),
            ("gap.heading", gap.heading, 0.0..=1e6),
            ("gap.border", gap.border, 0.0..=3.2),
            ("gap.turn_gain", gap.turn_gain, 0.0..=1000.0),
            ("gap.slow_distance", gap.slow_distance, 1e-3..=1000.0),
            ("mppi.samples", mppi.samples as f64, 1.0..=65_536.0),
            ("mppi.steps", mppi.steps as f64, 1.0..=1000.0),
            ("mppi.step", mppi.step, 1e-3..=10.0),
            ("mppi.hold", mppi.hold as f64, 1.0..=1000.0),
            ("mppi.temperature", mppi.temperature, 1e-6..=1e6),
            ("mppi.v_noise", mppi.v_noise, 0.0..=100.0),
            ("mppi.omega_noise", mppi.omega_noise, 0.0..=100.0),
            ("mppi.goal", mppi.goal, 0.0..=1e6),
            ("mppi.obstacle", mppi.obstacle, 0.0..=1e6),
            ("mppi.inflation", mppi.inflation, 1e-3..=1000.0),
            ("mppi.margin", mppi.margin, 0.0..=10.0),
            ("mppi.collision", mppi.collision, 0.0..=1e6),
            ("pursuit.lookahead", pursuit.lookahead, 1e-3..=1000.0),
            ("pursuit.turn_in_place", pursuit.turn_in_place, 0.0..=3.2),
            ("pursuit.turn_gain", pursuit.turn_gain, 0.0..=1000.0),
            ("pursuit.detour", pursuit.detour, 0.0..=3.2),
            ("pursuit.radius_min", pursuit.radius_min, 0.0..=1000.0),
            ("pursuit.approach", pursuit.approach, 0.0..=1000.0),
            ("pursuit.v_min", pursuit.v_min, 0.0..=100.0),
            ("pursuit.stop_time", pursuit.stop_time, 0.0..=60.0),
            ("pursuit.margin", pursuit.margin, 0.0..=10.0),
        ] {
            check(key, value, range.contains(&value), &format!("{} to {}", range.start(), range.end()))?;
        }
        Ok(())
    }
}
