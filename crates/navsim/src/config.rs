//! Settings of a simulation. Python holds the defaults; here every field must be given and is checked once more.
//!
//! The tables and keys are those of the configuration file: `world`, `robot`, `lidar`, `task`, `reward`.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Everything that a simulator needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimConfig {
    /// Where the robot drives.
    pub world: WorldConfig,
    /// What drives.
    pub robot: RobotConfig,
    /// What it sees.
    pub lidar: LidarConfig,
    /// What it has to do.
    pub task: TaskConfig,
    /// What it gets for it.
    pub reward: RewardConfig,
}

/// How scenarios are drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorldConfig {
    /// `td3`, `boxes`, `open8`, `walls`, `mixed` (robot k in one of several worlds), or the path of a world file (ends in
    /// `.json`).
    pub name: String,
    /// Random boxes of the world `boxes`, 0 to 64; the other worlds know their own number.
    pub boxes: usize,
    /// Whether the boxes of `td3` take a uniform yaw (true) or yaw 0 as in the published world.
    pub random_yaw: bool,
    /// Goal = start + uniform(-u, u) per axis with u = min(max, start + growth x episode), metres.
    pub goal_range_start: f64,
    /// Growth of u per episode of the robot, metres.
    pub goal_range_growth: f64,
    /// Largest u, metres.
    pub goal_range_max: f64,
}

/// Shape and limits of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotConfig {
    /// Disc or rectangle, centred on the point that drives the arcs.
    pub footprint: FootprintKind,
    /// Radius of the disc, metres, > 0. Unused for a rectangle.
    pub radius: f64,
    /// Extent of the rectangle along x, metres, > 0. Unused for a disc.
    pub length: f64,
    /// Extent of the rectangle along y, metres, > 0. Unused for a disc.
    pub width: f64,
    /// Largest forward speed, m/s, > 0.
    pub v_max: f64,
    /// Largest turning speed, rad/s, > 0.
    pub omega_max: f64,
    /// Largest change of forward speed, m/s^2; 0 means none.
    pub acceleration_max: f64,
    /// Largest change of turning speed, rad/s^2; 0 means none.
    pub angular_acceleration_max: f64,
    /// Control periods by which a command acts late, 0 to 100; until the first one acts the robot stands.
    pub delay_steps: usize,
    /// Standard deviation of the scale errors of odometry, of distance and of rotation, in [0, 0.2]; 0 means none.
    pub odometry_noise: f64,
}

/// Kind of footprint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FootprintKind {
    /// A disc of `radius`.
    Disc,
    /// A rectangle of `length` x `width`.
    Rectangle,
}

/// Geometry and noise of the lidar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LidarConfig {
    /// Number of beams, 1 to 4,096. Beam i points at -fov/2 + (i + 1/2) fov/beams, right to left.
    pub beams: usize,
    /// Field of view, radians, in (0, 2 pi].
    pub fov: f64,
    /// Smallest range that is reported, metres, >= 0.
    pub range_min: f64,
    /// Largest range, metres; a beam that meets nothing reports exactly this.
    pub range_max: f64,
    /// Standard deviation of the Gaussian noise on hits, metres, >= 0.
    pub noise: f64,
    /// Standard deviation of a second, independent Gaussian noise that grows with the range, metres per metre, >= 0.
    pub noise_per_meter: f64,
    /// Hits are rounded to multiples of this, metres; 0 means none.
    pub resolution: f64,
    /// Probability with which a beam, whatever it meets, is lost: its range is NaN and its bin keeps the others.
    pub drop_probability: f64,
    /// Pose [x, y, yaw] of the lidar in the robot's frame (m, m, rad).
    pub mount: [f64; 3],
    /// Groups into which the beams are pooled by minimum, 1 to `beams`.
    pub bins: usize,
    /// Which caster computes the ranges.
    pub caster: Caster,
}

/// Ways to compute a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Caster {
    /// The rasteriser with what makes it faster and leaves its bits: every beam against every edge for up to 64 beams,
    /// and a tree of boxes, nearest first and past what is hidden, where static walls, faces of boxes or circles fill
    /// eight blocks of 16.
    Auto,
    /// The vectorised rasteriser: every edge and every circle is drawn over the beams that it may cover.
    Raster,
    /// Parry's ray casts, beam by beam, through its bounding volume hierarchy from 32 shapes on: the reference, and
    /// slow. In single precision it is coarse where a beam grazes a circle.
    Parry,
}

/// The episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskConfig {
    /// Control period, seconds, > 0.
    pub period: f64,
    /// Longest episode, seconds; it ends after round(time_limit / period) steps.
    pub time_limit: f64,
    /// The goal is reached below this distance of the robot's centre, metres, > 0.
    pub goal_radius: f64,
    /// What counts as a collision.
    pub collision: CollisionRule,
    /// Range of the sensor rule, metres.
    pub sensor_range: f64,
}

/// What counts as a collision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CollisionRule {
    /// The footprint touches an obstacle anywhere on the arc of the step.
    Footprint,
    /// The footprint touches, or the nearest bin at the end of the step is under `sensor_range` (the published rule).
    Sensor,
}

/// The reward of a step (equations 3 and 5, and the progress term).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardConfig {
    /// r_g: reward for reaching the goal.
    pub goal: f64,
    /// r_c: reward for a collision (negative).
    pub collision: f64,
    /// Form of the motion term.
    pub form: RewardForm,
    /// Added per metre by which the goal came nearer in the step.
    pub progress: f64,
}

/// Form of the motion term of equation 3.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RewardForm {
    /// v - |omega| in m/s and rad/s, as the paper prints it.
    Paper,
    /// (v / v_max - |omega| / omega_max) / 2, as in the published system.
    Halves,
}

/// Steps of `period` (s) after which an episode of `time_limit` (s) is cut.
pub(crate) fn max_steps(time_limit: f64, period: f64) -> u32 {
    libm::round(time_limit / period) as u32
}

/// Refuses the setting `key` unless its value is finite and allowed.
pub(crate) fn check(key: &'static str, value: f64, allowed: bool, expected: &str) -> Result<()> {
    if value.is_finite() && allowed {
        return Ok(());
    }
    Err(Error::Setting { key, value: format!("{value}"), expected: expected.into() })
}

impl SimConfig {
    /// Reads a configuration from JSON with every key of every table given.
    ///
    /// # Errors
    /// A missing or unknown key, a wrong type, or a value that `validate` refuses.
    pub fn from_json(text: &str) -> Result<Self> {
        let config: Self = serde_json::from_str(text).map_err(|e| Error::Parse(format!("configuration: {e}")))?;
        config.validate()?;
        Ok(config)
    }

    /// Checks every range and combination.
    ///
    /// # Errors
    /// The first setting that is out of range, with the allowed values.
    pub fn validate(&self) -> Result<()> {
        let (world, robot, lidar, task, reward) = (&self.world, &self.robot, &self.lidar, &self.task, &self.reward);
        check("world.boxes", world.boxes as f64, world.boxes <= 64, "0 to 64")?;
        check("world.goal_range_start", world.goal_range_start, world.goal_range_start > 0.0, "> 0")?;
        check("world.goal_range_growth", world.goal_range_growth, world.goal_range_growth >= 0.0, ">= 0")?;
        check(
            "world.goal_range_max",
            world.goal_range_max,
            world.goal_range_max >= world.goal_range_start,
            "at least world.goal_range_start",
        )?;
        for (key, value) in
            [("robot.radius", robot.radius), ("robot.length", robot.length), ("robot.width", robot.width)]
        {
            check(key, value, value > 0.0 && value <= 10.0, "in (0, 10] m")?;
        }
        check("robot.v_max", robot.v_max, robot.v_max > 0.0 && robot.v_max <= 100.0, "in (0, 100] m/s")?;
        check(
            "robot.omega_max",
            robot.omega_max,
            robot.omega_max > 0.0 && robot.omega_max <= 100.0,
            "in (0, 100] rad/s",
        )?;
        check(
            "robot.acceleration_max",
            robot.acceleration_max,
            robot.acceleration_max >= 0.0,
            ">= 0 m/s^2 (0: no limit)",
        )?;
        check(
            "robot.angular_acceleration_max",
            robot.angular_acceleration_max,
            robot.angular_acceleration_max >= 0.0,
            ">= 0 rad/s^2 (0: no limit)",
        )?;
        check("robot.delay_steps", robot.delay_steps as f64, robot.delay_steps <= 100, "0 to 100")?;
        let noise = robot.odometry_noise;
        check("robot.odometry_noise", noise, (0.0..=0.2).contains(&noise), "in [0, 0.2]")?;
        lidar.validate()?;
        check("task.period", task.period, task.period >= 1e-3 && task.period <= 10.0, "in [0.001, 10] s")?;
        let steps = task.time_limit / task.period;
        check("task.time_limit", task.time_limit, (0.5..=1e6).contains(&steps), "1 to 1,000,000 control periods")?;
        check(
            "task.goal_radius",
            task.goal_radius,
            task.goal_radius > 0.0 && task.goal_radius <= 100.0,
            "in (0, 100] m",
        )?;
        check("task.sensor_range", task.sensor_range, task.sensor_range >= 0.0, ">= 0 m")?;
        for (key, value) in
            [("reward.goal", reward.goal), ("reward.collision", reward.collision), ("reward.progress", reward.progress)]
        {
            check(key, value, value.abs() <= 1e6, "in [-1e6, 1e6]")?;
        }
        Ok(())
    }
}

impl LidarConfig {
    fn validate(&self) -> Result<()> {
        let turn = 2.0 * std::f64::consts::PI;
        check("lidar.beams", self.beams as f64, (1..=4096).contains(&self.beams), "1 to 4096")?;
        check("lidar.fov", self.fov, self.fov > 0.0 && self.fov <= turn, "in (0, 2 pi] rad")?;
        check("lidar.range_max", self.range_max, self.range_max > 0.0 && self.range_max <= 1000.0, "in (0, 1000] m")?;
        let below_max = self.range_min >= 0.0 && self.range_min < self.range_max;
        check("lidar.range_min", self.range_min, below_max, "in [0, lidar.range_max) m")?;
        check("lidar.noise", self.noise, self.noise >= 0.0 && self.noise <= 10.0, "in [0, 10] m")?;
        for (key, value) in [
            ("lidar.noise_per_meter", self.noise_per_meter),
            ("lidar.resolution", self.resolution),
            ("lidar.drop_probability", self.drop_probability),
        ] {
            check(key, value, (0.0..=1.0).contains(&value), "in [0, 1]")?;
        }
        for value in self.mount {
            check("lidar.mount", value, value.abs() <= 10.0, "numbers in [-10, 10]")?;
        }
        let every_bin_has_a_beam = (1..=self.beams).contains(&self.bins);
        check(
            "lidar.bins",
            self.bins as f64,
            every_bin_has_a_beam,
            "1 to lidar.beams, so that no bin is without a beam",
        )
    }
}
