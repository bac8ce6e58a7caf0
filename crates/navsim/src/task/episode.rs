//! One robot's episode: how it begins and what a step does.

use super::observation::{goal_in_robot, write_extra};
use super::odometry::Odometry;
use super::reward::{Step, paper_reward, reward};
use super::{EXTRA, Outcome};
use crate::collision::{CONTACT, Clearance, clearance, measure, sweep};
use crate::config::{CollisionRule, SimConfig, max_steps};
use crate::error::{Error, Result, expect_length};
use crate::lidar::{Lidar, NoiseName, ScanBuffer, Surroundings};
use crate::pose::{Pose, distance};
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::robot::{Arc, Footprint, command, limit_acceleration};
use crate::world::{Layout, Obstacles, Scenario, Shape, Worlds};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// More than any number of an episode comes to, and little enough for single precision to square it.
const NUMBER_MAX: f64 = 1e12;

/// Where episodes come from.
#[derive(Debug, Clone)]
enum Source {
    /// Every episode of every robot draws a new scenario.
    Worlds(Box<Worlds>),
    /// Robot k runs scenario k, again at each reset.
    Scenarios(Vec<(Scenario, Obstacles)>),
}

/// What all robots of a simulator share.
#[derive(Debug, Clone)]
pub struct Task {
    config: SimConfig,
    footprint: Footprint,
    lidar: Lidar,
    source: Source,
    seed: u64,
    /// Number of robot 0 in the batch that all are a part of.
    first: usize,
}

/// Sums over an episode.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Statistics {
    /// Return in the paper's form (equations 3 and 5, undiscounted).
    pub paper_return: f64,
    /// Steps made.
    pub steps: u32,
    /// Arc length driven, m.
    pub path: f64,
    /// Smallest clearance at the ends of steps, m.
    pub clearance: f32,
}

/// One robot and its episode.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Episode {
    /// Index of the episode, counted for each robot from 0.
    pub index: u64,
    /// How it stands.
    pub outcome: Outcome,
    /// Pose of the robot in the world.
    pub pose: Pose,
    /// Velocity of the step just made: v (m/s), omega (rad/s).
    pub velocity: [f64; 2],
    /// Sums so far.
    pub statistics: Statistics,
    /// Goal, m.
    pub goal: [f64; 2],
    start: Pose,
    moved: Vec<Shape>,
    goal_radius: f64,
    max_steps: u32,
    clearance: Clearance,
    goal_distance: f64,
    /// Commands (v m/s, omega rad/s) that have been given and do not act yet, oldest first.
    waiting: Vec<[f64; 2]>,
    /// Where the robot believes to be; `None` where it knows its pose.
    odometry: Option<Odometry>,
    /// Prepared form of `moved`, not stored; see `prepare_moved`.
    #[serde(skip)]
    obstacles: Obstacles,
}

/// Working memory of a thread: a scan and a draw.
#[derive(Debug, Clone)]
pub struct Workspace {
    scan: ScanBuffer,
    /// One for each world.
    layouts: Vec<Layout>,
}

/// Where the numbers of an observation go.
#[derive(Debug)]
pub struct ObservationRow<'a> {
    /// Bins and the four numbers of `write_extra`.
    pub observation: &'a mut [f32],
    /// Range of every beam, m; empty if nobody asks for them.
    pub ranges: &'a mut [f32],
}

impl Task {
    /// The task of a checked configuration: scenarios drawn from its world, or those given. Its robot k is robot
    /// `first` + k where streams and worlds are named.
    ///
    /// # Errors
    /// A setting out of range, a world that cannot hold the robot, or a scenario that the robot cannot run (with its
    /// index).
    pub fn new(config: SimConfig, scenarios: Option<Vec<Scenario>>, seed: u64, first: usize) -> Result<Self> {
        config.validate()?;
        let footprint = Footprint::new(&config.robot);
        let source = match scenarios {
            Some(scenarios) => Source::Scenarios(prepare(scenarios, &footprint)?),
            None => Source::Worlds(Box::new(Worlds::new(&config.world, &footprint)?)),
        };
        Ok(Self { lidar: Lidar::new(&config.lidar)?, config, footprint, source, seed, first })
    }

    /// The configuration.
    pub fn config(&self) -> &SimConfig {
        &self.config
    }

    /// Numbers of an observation.
    pub fn observation_size(&self) -> usize {
        self.lidar.bins().len() + EXTRA
    }

    /// Memory for one thread.
    pub fn workspace(&self) -> Workspace {
        let layouts = match &self.source {
            Source::Worlds(worlds) => worlds.layouts(),
            Source::Scenarios(_) => Vec::new(),
        };
        Workspace { scan: self.lidar.buffer(), layouts }
    }

    /// Share of the world's free area that is cut off from the rest, in [0, 1], of several worlds the largest; 0 for
    /// given scenarios.
    pub fn cut_off(&self) -> f64 {
        match &self.source {
            Source::Worlds(worlds) => worlds.cut_off(),
            Source::Scenarios(_) => 0.0,
        }
    }

    /// Number of given scenarios, `None` when they are drawn.
    fn scenario_count(&self) -> Option<usize> {
        match &self.source {
            Source::Worlds(_) => None,
            Source::Scenarios(scenarios) => Some(scenarios.len()),
        }
    }

    /// Begins episode `index` of `robot` and writes its first observation.
    ///
    /// # Errors
    /// `Error::WorldTooFull` when the world gives no start and goal; the episode is then as it was.
    pub fn begin(
        &self,
        robot: usize,
        index: u64,
        episode: &mut Episode,
        workspace: &mut Workspace,
        row: &mut ObservationRow,
    ) -> Result<()> {
        match &self.source {
            Source::Worlds(worlds) => {
                let number = self.first + robot;
                let name = StreamName::new(self.seed, Purpose::World, Split::Train, number as u32, index);
                let place = number % workspace.layouts.len();
                let layout = &mut workspace.layouts[place];
                worlds.of(number).draw(&mut Stream::new(name), index, layout)?;
                (episode.start, episode.goal) = (layout.start, layout.goal);
                episode.moved.clone_from(&layout.moved);
                episode.goal_radius = self.config.task.goal_radius;
                episode.max_steps = max_steps(self.config.task.time_limit, self.config.task.period);
            }
            Source::Scenarios(scenarios) => {
                let (scenario, _) = &scenarios[robot % scenarios.len()];
                (episode.start, episode.goal) = (scenario.start, scenario.goal);
                episode.goal_radius = scenario.goal_radius;
                episode.max_steps = max_steps(scenario.time_limit, self.config.task.period);
            }
        }
        episode.prepare_moved();
        episode.pose = episode.start;
        episode.index = index;
        episode.outcome = Outcome::Running;
        episode.velocity = [0.0, 0.0];
        episode.waiting.clear();
        episode.waiting.resize(self.config.robot.delay_steps, [0.0, 0.0]);
        let noise = self.config.robot.odometry_noise;
        episode.odometry =
            (noise > 0.0).then(|| Odometry::new(episode.start, noise, &self.stream(Purpose::Odometry, robot, episode)));
        let clearance = clearance(&self.footprint, &episode.pose, self.obstacles(robot, episode));
        episode.clearance = Clearance::exactly(clearance);
        episode.statistics = Statistics { clearance, ..Statistics::default() };
        episode.goal_distance = self.observe(robot, episode, workspace, row).1;
        Ok(())
    }

    /// Drives one control period with `action` in [-1, 1]^2 and writes the observation after it; returns the reward.
    ///
    /// With `robot.delay_steps` an earlier action drives, and the robot stands until the first one does. The robot sees
    /// the goal from where it believes to be, and is judged by where it is.
    ///
    /// A collision anywhere on the arc ends the step at contact; otherwise the goal counts if its distance at the end
    /// is under the goal radius, also on the last step; otherwise the time limit.
    pub fn step(
        &self,
        robot: usize,
        episode: &mut Episode,
        action: [f32; 2],
        workspace: &mut Workspace,
        row: &mut ObservationRow,
    ) -> f64 {
        let period = self.config.task.period;
        let wanted = episode.delayed(command(action, &self.config.robot));
        let velocity = limit_acceleration(wanted, episode.velocity, period, &self.config.robot);
        let arc = Arc { start: episode.pose, v: velocity[0], omega: velocity[1] };
        let (obstacles, smallest) = (self.obstacles(robot, episode), episode.statistics.clearance);
        let end = sweep(&self.footprint, &arc, period, obstacles, episode.clearance, smallest);

        episode.pose = end.pose;
        if let Some(odometry) = &mut episode.odometry {
            odometry.follow(&arc, end.time);
        }
        episode.velocity = velocity;
        episode.clearance = end.clearance;
        episode.statistics.steps += 1;
        episode.statistics.path += arc.v.abs() * end.time;
        // If it was not measured, it is more than the smallest.
        episode.statistics.clearance = smallest.min(end.clearance.measured);

        let (nearest, goal_distance) = self.observe(robot, episode, workspace, row);
        let task = &self.config.task;
        let sensed = task.collision == CollisionRule::Sensor && nearest < task.sensor_range;
        episode.outcome = if end.contact || sensed {
            Outcome::Collision
        } else if goal_distance < episode.goal_radius {
            Outcome::Goal
        } else if episode.statistics.steps >= episode.max_steps {
            Outcome::Timeout
        } else {
            Outcome::Running
        };
        if episode.outcome != Outcome::Running {
            // Where it stays, it is asked for again and again.
            episode.clearance = Clearance::exactly(self.clearance(robot, episode));
        }
        let progress = episode.goal_distance - goal_distance;
        episode.goal_distance = goal_distance;
        let step = Step { outcome: episode.outcome, velocity, nearest, progress };
        episode.statistics.paper_return += paper_reward(&step, &self.config.robot);
        reward(&step, &self.config.reward, &self.config.robot)
    }

    /// Writes scan, bins and the rest of the observation; returns the nearest bin and the goal's true distance, both
    /// m.
    fn observe(
        &self,
        robot: usize,
        episode: &Episode,
        workspace: &mut Workspace,
        row: &mut ObservationRow,
    ) -> (f64, f64) {
        let ranges = self.scan(robot, episode, workspace);
        if !row.ranges.is_empty() {
            row.ranges.copy_from_slice(ranges);
        }
        let (bins, extra) = row.observation.split_at_mut(self.lidar.bins().len());
        self.lidar.pool(&workspace.scan, bins);
        let goal_polar = goal_in_robot(&episode.believed_pose(), episode.goal);
        write_extra(goal_polar, episode.velocity, &self.config.robot, extra);
        let nearest = bins.iter().fold(f32::INFINITY, |a, b| a.min(*b));
        // A bin that lost all its beams is not clear; it is no obstacle either, to reward or end an episode by.
        for bin in bins.iter_mut().filter(|bin| **bin == f32::INFINITY) {
            *bin = 0.0;
        }
        let goal_distance = match episode.odometry {
            Some(_) => distance([episode.pose.x, episode.pose.y], episode.goal),
            None => goal_polar[0],
        };
        (f64::from(nearest), goal_distance)
    }

    /// Ranges (m) that the lidar reports now: the same whenever it is asked for in a step.
    pub fn scan<'w>(&self, robot: usize, episode: &Episode, workspace: &'w mut Workspace) -> &'w [f32] {
        let stream = self.stream(Purpose::Noise, robot, episode);
        let around = Surroundings {
            obstacles: self.obstacles(robot, episode),
            world_from_robot: episode.pose,
            // The centre is at least as far from the nearest obstacle as the footprint is.
            center_distance: episode.clearance.at_least(),
        };
        let noise = NoiseName { stream, scan: episode.statistics.steps };
        self.lidar.scan(&around, &noise, &mut workspace.scan)
    }

    /// Refuses an episode that this task could not have come to, such as one of a state that was edited.
    ///
    /// # Errors
    /// `Error::Parse`, with the name of what is wrong; `Error::Shape`.
    pub fn check(&self, episode: &Episode) -> Result<()> {
        let robot = &self.config.robot;
        expect_length("simulator state: waiting", robot.delay_steps, episode.waiting.len())?;
        if episode.odometry.is_some() != (robot.odometry_noise > 0.0) {
            return Err(Error::Parse("simulator state: odometry: expected with robot.odometry_noise only".into()));
        }
        episode.validate()
    }

    /// Distance (m) of the footprint from the nearest obstacle now.
    pub fn clearance(&self, robot: usize, episode: &Episode) -> f32 {
        let known = &episode.clearance;
        if known.driven > 0.0 {
            measure(&self.footprint, &episode.pose, self.obstacles(robot, episode), known)
        } else {
            known.measured
        }
    }

    /// Random numbers of this episode.
    fn stream(&self, purpose: Purpose, robot: usize, episode: &Episode) -> StreamName {
        let split = if self.scenario_count().is_some() { Split::Given } else { Split::Train };
        StreamName::new(self.seed, purpose, split, (self.first + robot) as u32, episode.index)
    }

    fn obstacles<'a>(&'a self, robot: usize, episode: &'a Episode) -> [&'a Obstacles; 2] {
        let fixed = match &self.source {
            Source::Worlds(worlds) => worlds.of(self.first + robot).static_obstacles(),
            Source::Scenarios(scenarios) => &scenarios[robot % scenarios.len()].1,
        };
        [fixed, &episode.obstacles]
    }

    /// What `robot` meets in this episode, as a scenario that can be stored and run again.
    pub fn scenario(&self, robot: usize, episode: &Episode) -> Scenario {
        match &self.source {
            Source::Worlds(worlds) => {
                worlds.of(self.first + robot).scenario(episode.start, episode.goal, &episode.moved, &self.config.task)
            }
            Source::Scenarios(scenarios) => scenarios[robot % scenarios.len()].0.clone(),
        }
    }
}

impl Episode {
    /// Pose in the world as the robot reckons it by odometry; the true one without `robot.odometry_noise`.
    pub fn believed_pose(&self) -> Pose {
        self.odometry.map_or(self.pose, |odometry| odometry.pose)
    }

    /// The command that acts when `given` is given.
    fn delayed(&mut self, given: [f64; 2]) -> [f64; 2] {
        if self.waiting.is_empty() {
            return given;
        }
        self.waiting.rotate_left(1);
        let last = self.waiting.len() - 1;
        std::mem::replace(&mut self.waiting[last], given)
    }

    /// Asks for what a step reads to be brought near: robots follow each other, their shapes lie all over the memory.
    pub fn prefetch(&self) {
        self.obstacles.prefetch();
    }

    /// Refuses numbers that no episode comes to have, such as those of a state that was edited.
    fn validate(&self) -> Result<()> {
        let Self { pose, start, velocity, goal, statistics, .. } = self;
        let positions = [
            ("pose", vec![pose.x, pose.y, pose.yaw]),
            ("start", vec![start.x, start.y, start.yaw]),
            ("velocity", velocity.to_vec()),
            ("goal", goal.to_vec()),
            ("waiting", self.waiting.concat()),
            ("odometry", self.odometry.map_or(Vec::new(), |odometry| odometry.numbers().to_vec())),
            ("statistics.paper_return", vec![statistics.paper_return]),
        ];
        let lengths = [
            ("goal_radius", vec![self.goal_radius]),
            ("goal_distance", vec![self.goal_distance]),
            ("clearance", vec![f64::from(self.clearance.measured), self.clearance.driven]),
            ("statistics", vec![statistics.path, f64::from(statistics.clearance)]),
        ];
        let within = |(name, values): (&str, Vec<f64>), range: RangeInclusive<f64>| match values
            .iter()
            .find(|value| !range.contains(value))
        {
            None => Ok(()),
            Some(value) => Err(Error::Parse(format!(
                "simulator state: {name} = {value}: expected a number in [{}, {}]",
                range.start(),
                range.end()
            ))),
        };
        positions.into_iter().try_for_each(|numbers| within(numbers, -NUMBER_MAX..=NUMBER_MAX))?;
        lengths.into_iter().try_for_each(|numbers| within(numbers, 0.0..=NUMBER_MAX))?;
        self.moved.iter().try_for_each(Shape::validate)
    }

    /// Prepares the moved shapes for queries, after a draw or when a stored episode was read back.
    pub fn prepare_moved(&mut self) {
        self.obstacles.refill(&self.moved);
    }
}

/// Prepares given scenarios; one that starts in contact is refused with its index.
fn prepare(scenarios: Vec<Scenario>, footprint: &Footprint) -> Result<Vec<(Scenario, Obstacles)>> {
    if scenarios.is_empty() {
        return Err(Error::Scenario("the list of scenarios is empty".into()));
    }
    let none = Obstacles::default();
    let mut prepared = Vec::with_capacity(scenarios.len());
    for (index, scenario) in scenarios.into_iter().enumerate() {
        scenario.validate()?;
        let obstacles = Obstacles::new(&scenario.shapes);
        let start = &scenario.start;
        if clearance(footprint, start, [&obstacles, &none]) <= CONTACT {
            let [x, y, yaw] = [start.x, start.y, start.yaw];
            return Err(Error::Scenario(format!("scenario {index}: its start [{x}, {y}, {yaw}] is in contact")));
        }
        prepared.push((scenario, obstacles));
    }
    Ok(prepared)
}
