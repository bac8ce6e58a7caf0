//! One robot's episode: how it begins and what a step does.

use super::observation::{goal_in_robot, write_extra};
use super::reward::{Step, paper_reward, reward};
use super::{EXTRA, Outcome};
use crate::collision::{CONTACT, clearance, sweep};
use crate::config::{CollisionRule, SimConfig, max_steps};
use crate::error::{Error, Result};
use crate::lidar::{Lidar, NoiseName, ScanBuffer, Surroundings};
use crate::pose::Pose;
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::robot::{Arc, Footprint, command, limit_acceleration};
use crate::world::{Generator, Layout, Obstacles, Scenario, Shape};
use serde::{Deserialize, Serialize};

/// Where episodes come from.
#[derive(Debug, Clone)]
pub enum Source {
    /// Every episode of every robot draws a new scenario.
    Generator(Box<Generator>),
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
    clearance: f32,
    goal_distance: f64,
    /// Prepared form of `moved`, not stored; see `prepare_moved`.
    #[serde(skip)]
    obstacles: Obstacles,
}

/// Working memory of a thread: a scan and a draw.
#[derive(Debug, Clone)]
pub struct Workspace {
    scan: ScanBuffer,
    layout: Layout,
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
    /// The task of a checked configuration: scenarios drawn from its world, or those given.
    ///
    /// # Errors
    /// A setting out of range, a world that cannot hold the robot, or a scenario that the robot cannot run (with its
    /// index).
    pub fn new(config: SimConfig, scenarios: Option<Vec<Scenario>>, seed: u64) -> Result<Self> {
        config.validate()?;
        let footprint = Footprint::new(&config.robot);
        let source = match scenarios {
            Some(scenarios) => Source::Scenarios(prepare(scenarios, &footprint)?),
            None => Source::Generator(Box::new(Generator::new(&config.world, &footprint)?)),
        };
        Ok(Self { lidar: Lidar::new(&config.lidar)?, config, footprint, source, seed })
    }

    /// The configuration.
    pub fn config(&self) -> &SimConfig {
        &self.config
    }

    /// The lidar.
    pub fn lidar(&self) -> &Lidar {
        &self.lidar
    }

    /// Numbers of an observation.
    pub fn observation_size(&self) -> usize {
        self.lidar.bins().len() + EXTRA
    }

    /// Memory for one thread.
    pub fn workspace(&self) -> Workspace {
        let layout = match &self.source {
            Source::Generator(generator) => generator.layout(),
            Source::Scenarios(_) => Layout::default(),
        };
        Workspace { scan: self.lidar.buffer(), layout }
    }

    /// Share of the world's free area that is cut off from the rest, in [0, 1]; 0 for given scenarios.
    pub fn cut_off(&self) -> f64 {
        match &self.source {
            Source::Generator(generator) => generator.cut_off(),
            Source::Scenarios(_) => 0.0,
        }
    }

    /// Number of given scenarios, `None` when they are drawn.
    pub fn scenario_count(&self) -> Option<usize> {
        match &self.source {
            Source::Generator(_) => None,
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
            Source::Generator(generator) => {
                let name = StreamName::new(self.seed, Purpose::World, Split::Train, robot as u32, index);
                let layout = &mut workspace.layout;
                generator.draw(&mut Stream::new(name), index, layout)?;
                (episode.start, episode.goal) = (layout.start, layout.goal);
                episode.moved.clone_from(&layout.moved);
                episode.goal_radius = self.config.task.goal_radius;
                episode.max_steps = max_steps(&self.config.task);
            }
            Source::Scenarios(scenarios) => {
                let (scenario, _) = &scenarios[robot % scenarios.len()];
                (episode.start, episode.goal) = (scenario.start, scenario.goal);
                episode.goal_radius = scenario.goal_radius;
                let mut task = self.config.task.clone();
                task.time_limit = scenario.time_limit;
                episode.max_steps = max_steps(&task);
            }
        }
        episode.prepare_moved();
        episode.pose = episode.start;
        episode.index = index;
        episode.outcome = Outcome::Running;
        episode.velocity = [0.0, 0.0];
        episode.clearance = clearance(&self.footprint, &episode.pose, self.obstacles(robot, episode));
        episode.statistics = Statistics { clearance: episode.clearance, ..Statistics::default() };
        episode.goal_distance = self.observe(robot, episode, workspace, row).1;
        Ok(())
    }

    /// Drives one control period with `action` in [-1, 1]^2 and writes the observation after it; returns the reward.
    ///
    /// A collision anywhere on the arc ends the step at contact; otherwise the goal counts if its distance at the end is
    /// under the goal radius, also on the last step; otherwise the time limit.
    pub fn step(
        &self,
        robot: usize,
        episode: &mut Episode,
        action: [f32; 2],
        workspace: &mut Workspace,
        row: &mut ObservationRow,
    ) -> f64 {
        let period = self.config.task.period;
        let wanted = command(action, &self.config.robot);
        let velocity = limit_acceleration(wanted, episode.velocity, period, &self.config.robot);
        let arc = Arc { start: episode.pose, v: velocity[0], omega: velocity[1] };
        let end = sweep(&self.footprint, &arc, period, self.obstacles(robot, episode), episode.clearance);

        episode.pose = end.pose;
        episode.velocity = velocity;
        episode.clearance = end.clearance;
        episode.statistics.steps += 1;
        episode.statistics.path += arc.v.abs() * end.time;
        episode.statistics.clearance = episode.statistics.clearance.min(end.clearance);

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
        let progress = episode.goal_distance - goal_distance;
        episode.goal_distance = goal_distance;
        let step = Step { outcome: episode.outcome, velocity, nearest, progress };
        episode.statistics.paper_return += paper_reward(&step, &self.config.robot);
        reward(&step, &self.config.reward, &self.config.robot)
    }

    /// Writes scan, bins and the rest of the observation; returns the nearest bin and the goal's distance, both m.
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
        let goal_polar = goal_in_robot(&episode.pose, episode.goal);
        write_extra(goal_polar, episode.velocity, &self.config.robot, extra);
        let nearest = bins.iter().fold(f32::INFINITY, |a, b| a.min(*b));
        // A bin that lost all its beams is not clear; it is no obstacle either, to reward or end an episode by.
        for bin in bins.iter_mut().filter(|bin| **bin == f32::INFINITY) {
            *bin = 0.0;
        }
        (f64::from(nearest), goal_polar[0])
    }

    /// Ranges (m) that the lidar reports now: the same whenever it is asked for in a step.
    pub fn scan<'w>(&self, robot: usize, episode: &Episode, workspace: &'w mut Workspace) -> &'w [f32] {
        let split = if self.scenario_count().is_some() { Split::Given } else { Split::Train };
        let stream = StreamName::new(self.seed, Purpose::Noise, split, robot as u32, episode.index);
        let around = Surroundings {
            obstacles: self.obstacles(robot, episode),
            world_from_robot: episode.pose,
            // The centre is at least as far from the nearest obstacle as the footprint is.
            center_distance: episode.clearance,
        };
        let noise = NoiseName { stream, scan: episode.statistics.steps };
        self.lidar.scan(&around, &noise, &mut workspace.scan)
    }

    fn obstacles<'a>(&'a self, robot: usize, episode: &'a Episode) -> [&'a Obstacles; 2] {
        let fixed = match &self.source {
            Source::Generator(generator) => generator.static_obstacles(),
            Source::Scenarios(scenarios) => &scenarios[robot % scenarios.len()].1,
        };
        [fixed, &episode.obstacles]
    }

    /// What `robot` meets in this episode, as a scenario that can be stored and run again.
    pub fn scenario(&self, robot: usize, episode: &Episode) -> Scenario {
        match &self.source {
            Source::Generator(generator) => {
                generator.scenario(episode.start, episode.goal, &episode.moved, &self.config.task)
            }
            Source::Scenarios(scenarios) => scenarios[robot % scenarios.len()].0.clone(),
        }
    }
}

impl Episode {
    /// Asks for what a step reads to be brought near: robots follow each other, their shapes lie all over the memory.
    pub fn prefetch(&self) {
        self.obstacles.prefetch();
    }

    /// Prepares the moved shapes for queries, after a draw or when a stored episode was read back.
    pub fn prepare_moved(&mut self) {
        self.obstacles.clear();
        for shape in &self.moved {
            self.obstacles.push(shape);
        }
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
