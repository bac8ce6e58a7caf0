//! Local controllers: from what a robot has (a scan, its goal, its own speed) to a command, for many robots at once.
//!
//! No controller knows the map: [`Controller::command`] gets arrays and nothing else. All obey the same limits. A robot
//! that is no disc counts as the smallest disc that holds it. Commands that act late are foreseen, and a goal that is not
//! where the robot believes it to be is looked for, for all of them alike.

mod clearance_map;
mod dwa;
mod foresight;
mod gap;
mod mppi;
mod potential_field;
mod pursuit;
mod scene;
mod seek;
mod settings;

pub use settings::{ApfConfig, ControllersConfig, DwaConfig, GapConfig, MppiConfig, PursuitConfig};

use crate::batch::ROBOTS_MAX;
use crate::config::{RobotConfig, SimConfig};
use crate::cpu::DefaultMode;
use crate::error::{Error, Result, expect_length};
use crate::pose::distance;
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::robot::{Footprint, limit_acceleration};
use scene::{Eye, Scene};

/// The controllers by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Dynamic window with the weights of the settings.
    Dwa,
    /// Dynamic window with the weights of 1997: heading 2, free way 0.2 per metre, speed 0.2.
    Dwa1997,
    /// Artificial potential field.
    Apf,
    /// Gap following.
    Gap,
    /// Model predictive path integral control.
    Mppi,
    /// Regulated pure pursuit of the goal.
    Pursuit,
    /// Straight at the goal, blind.
    Straight,
    /// Commands drawn uniformly from the limits.
    Random,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 8] =
        [Self::Dwa, Self::Dwa1997, Self::Apf, Self::Gap, Self::Mppi, Self::Pursuit, Self::Straight, Self::Random];

    /// `dwa`, `dwa-1997`, `apf`, `gap`, `mppi`, `pursuit`, `straight` or `random`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dwa => "dwa",
            Self::Dwa1997 => "dwa-1997",
            Self::Apf => "apf",
            Self::Gap => "gap",
            Self::Mppi => "mppi",
            Self::Pursuit => "pursuit",
            Self::Straight => "straight",
            Self::Random => "random",
        }
    }

    /// The controller of that name, `None` for another word.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// What the robot can do, as controllers need it.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Radius of the disc that holds the robot, m.
    radius: f32,
    v_max: f32,
    omega_max: f32,
    /// m/s^2, 0 for no limit.
    acceleration: f32,
    /// rad/s^2, 0 for no limit.
    angular_acceleration: f32,
    /// Control period, s.
    period: f32,
}

impl Limits {
    /// Way (m) that stopping from speed `v` takes, when braking begins after `reaction` seconds:
    /// v reaction + v^2 / (2 acceleration). Without a limit the robot then stops at once.
    fn stopping_way(&self, v: f32, reaction: f32) -> f32 {
        let braking = if self.acceleration > 0.0 { 0.5 * v * v / self.acceleration } else { 0.0 };
        v * reaction + braking
    }

    /// Largest speed (m/s) with a stopping way of at most `way` (m); `reaction` > 0.
    fn stopping_speed(&self, way: f32, reaction: f32) -> f32 {
        let a = self.acceleration;
        if a > 0.0 { a * (libm::sqrtf(reaction * reaction + 2.0 * way / a) - reaction) } else { way / reaction }
    }
}

/// What one robot sees now.
#[derive(Debug, Clone, Copy)]
struct Sight<'a> {
    scene: &'a Scene,
    /// The goal (m) in the robot's frame, and the same in polar coordinates.
    goal: [f32; 2],
    goal_distance: f32,
    goal_angle: f32,
    /// v (m/s) and omega (rad/s) of the last period.
    velocity: [f32; 2],
    /// Field of view (rad): half of it to both sides of its middle, and the angle from beam to beam.
    half_fov: f32,
    middle: f32,
    increment: f32,
}

/// How a command is found.
#[derive(Debug, Clone)]
enum Law {
    Dwa(dwa::Dwa),
    Apf(ApfConfig),
    Gap(gap::Gap),
    Mppi(mppi::Mppi),
    Pursuit(pursuit::Pursuit),
    Straight,
    Random,
}

/// What a controller remembers of a robot.
#[derive(Debug, Clone, Default)]
struct Memory {
    /// Decisions made since the last reset.
    decisions: u64,
    foresight: foresight::Foresight,
    seek: seek::Seek,
    plan: mppi::Plan,
}

/// A controller of many robots.
#[derive(Debug, Clone)]
pub struct Controller {
    law: Law,
    robot: RobotConfig,
    limits: Limits,
    seeker: seek::Seeker,
    period: f64,
    eye: Eye,
    scene: Scene,
    seed: u64,
    memories: Vec<Memory>,
}

/// What a batch of robots has, row by row.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Which robot each row belongs to: names its memory and its random numbers. `None`: row k is robot k.
    pub robots: Option<&'a [u32]>,
    /// Ranges, m, `beams` to a row; at range_max or beyond: nothing met; NaN or negative: beam lost.
    pub ranges: &'a [f32],
    /// Distance (m, >= 0) and angle (rad) of the goal in the robot's frame, two to a row.
    pub goals: &'a [f64],
    /// v (m/s) and omega (rad/s) of the last period, two to a row.
    pub velocities: &'a [f64],
}

impl Controller {
    /// The controller `kind` for the robot, lidar and period of `sim`. `seed` names the random numbers of `mppi` and
    /// `random`.
    ///
    /// # Errors
    /// A setting out of its range, or another word in `NAVRL_ISA`.
    pub fn new(kind: Kind, config: &ControllersConfig, sim: &SimConfig, seed: u64) -> Result<Self> {
        sim.validate()?;
        config.validate()?;
        let robot = &sim.robot;
        let limits = Limits {
            radius: Footprint::new(robot).circumscribed_radius() as f32,
            v_max: robot.v_max as f32,
            omega_max: robot.omega_max as f32,
            acceleration: robot.acceleration_max as f32,
            angular_acceleration: robot.angular_acceleration_max as f32,
            period: sim.task.period as f32,
        };
        let law = match kind {
            Kind::Dwa => Law::Dwa(dwa::Dwa::new(&config.dwa)),
            Kind::Dwa1997 => Law::Dwa(dwa::Dwa::new(&config.dwa.clone().of_1997(sim.lidar.range_max))),
            Kind::Apf => Law::Apf(config.apf.clone()),
            Kind::Gap => Law::Gap(gap::Gap::new(&config.gap)),
            Kind::Mppi => Law::Mppi(mppi::Mppi::new(&config.mppi, &limits)?),
            Kind::Pursuit => Law::Pursuit(pursuit::Pursuit::new(&config.pursuit)),
            Kind::Straight => Law::Straight,
            Kind::Random => Law::Random,
        };
        Ok(Self {
            law,
            robot: robot.clone(),
            limits,
            seeker: seek::Seeker { radius: sim.task.goal_radius, v_max: robot.v_max, period: sim.task.period },
            period: sim.task.period,
            eye: Eye::new(&sim.lidar),
            scene: Scene::default(),
            seed,
            memories: Vec::new(),
        })
    }

    /// Number of beams of a scan.
    pub fn beams(&self) -> usize {
        self.eye.beams()
    }

    /// Forgets all robots: their next decision is the first.
    pub fn reset(&mut self) {
        self.memories.clear();
    }

    /// Writes one command (v m/s, omega rad/s) for each row to `commands`, within the limits of the robot.
    ///
    /// # Errors
    /// Wrong lengths, goals or velocities that are not finite, a negative distance, a robot beyond `ROBOTS_MAX`:
    /// nothing has been decided then.
    pub fn command(&mut self, inputs: &Inputs, commands: &mut [f64]) -> Result<()> {
        let rows = commands.len() / 2;
        self.check(inputs, rows)?;
        let _mode = DefaultMode::set();
        for row in 0..rows {
            let robot = inputs.robots.map_or(row, |robots| robots[row] as usize);
            self.eye.look(&inputs.ranges[row * self.beams()..(row + 1) * self.beams()], &mut self.scene);
            let pair = |values: &[f64]| [values[2 * row], values[2 * row + 1]];
            let command = self.decide(robot, pair(inputs.goals), pair(inputs.velocities));
            commands[2 * row..2 * row + 2].copy_from_slice(&command);
        }
        Ok(())
    }

    fn check(&mut self, inputs: &Inputs, rows: usize) -> Result<()> {
        expect_length("ranges", rows * self.beams(), inputs.ranges.len())?;
        expect_length("goal", 2 * rows, inputs.goals.len())?;
        expect_length("velocity", 2 * rows, inputs.velocities.len())?;
        numbers("goal", inputs.goals)?;
        numbers("velocity", inputs.velocities)?;
        if let Some(row) = (0..rows).find(|row| inputs.goals[2 * row] < 0.0) {
            let value = inputs.goals[2 * row];
            return Err(Error::Number { name: "goal", expected: "a distance >= 0", value, row });
        }
        let mut robots = rows;
        if let Some(names) = inputs.robots {
            expect_length("robots", rows, names.len())?;
            robots = names.iter().fold(0, |most, &robot| most.max(robot as usize + 1));
        }
        if robots > ROBOTS_MAX {
            let expected = format!("fewer than {ROBOTS_MAX} robots");
            return Err(Error::Setting { key: "robots", value: (robots - 1).to_string(), expected });
        }
        if self.memories.len() < robots {
            self.memories.resize_with(robots, Memory::default);
        }
        Ok(())
    }

    fn decide(&mut self, robot: usize, goal: [f64; 2], velocity: [f64; 2]) -> [f64; 2] {
        let Self { law, limits, eye, scene, memories, .. } = self;
        let memory = &mut memories[robot];
        let (sin, cos) = libm::sincos(goal[1]);
        let (mut goal, mut velocity) = ([goal[0] * cos, goal[0] * sin], velocity);
        if self.robot.delay_steps > 0 {
            let (pose, later) = memory.foresight.look(velocity, self.period, &self.robot);
            scene.move_to(&pose);
            (goal, velocity) = (pose.inverse_transform(goal), later);
        }
        let goal = memory.seek.target(goal, velocity[0], &self.seeker);
        let sight = Sight {
            scene,
            goal: goal.map(|part| part as f32),
            goal_distance: distance([0.0; 2], goal) as f32,
            goal_angle: libm::atan2(goal[1], goal[0]) as f32,
            velocity: velocity.map(|v| v as f32),
            half_fov: eye.half_fov,
            middle: eye.middle,
            increment: eye.increment,
        };
        let stream = StreamName::new(self.seed, Purpose::Control, Split::Given, robot as u32, memory.decisions);
        let wanted = match law {
            Law::Dwa(dwa) => dwa.command(limits, &sight),
            Law::Apf(config) => potential_field::command(config, limits, &sight),
            Law::Gap(gap) => gap.command(limits, &sight),
            Law::Mppi(mppi) => mppi.command(limits, &sight, &mut memory.plan, &stream),
            Law::Pursuit(pursuit) => pursuit.command(limits, &sight),
            Law::Straight => straight(limits, &sight),
            Law::Random => random(limits, &stream),
        };
        memory.decisions += 1;
        let [v, omega] = limit_acceleration(wanted.map(f64::from), velocity, self.period, &self.robot);
        let command = [v.clamp(0.0, self.robot.v_max), omega.clamp(-self.robot.omega_max, self.robot.omega_max)];
        memory.foresight.give(command);
        command
    }
}

/// Turns to the goal at 2/s; drives at full speed when it looks there within 0.3 rad.
fn straight(limits: &Limits, sight: &Sight) -> [f32; 2] {
    let angle = sight.goal_angle;
    [if angle.abs() < 0.3 { limits.v_max } else { 0.0 }, 2.0 * angle]
}

/// Any command within the limits, all alike.
fn random(limits: &Limits, stream: &StreamName) -> [f32; 2] {
    let mut stream = Stream::new(*stream);
    [limits.v_max * stream.unit() as f32, limits.omega_max * stream.uniform(-1.0, 1.0) as f32]
}

/// Refuses NaN, infinity, and what overflows in single precision.
fn numbers(name: &'static str, values: &[f64]) -> Result<()> {
    match values.iter().position(|value| !(-1e9..=1e9).contains(value)) {
        None => Ok(()),
        Some(i) => Err(Error::Number { name, expected: "numbers within +-1e9", value: values[i], row: i / 2 }),
    }
}
