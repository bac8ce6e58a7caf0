//! Many robots at once: arrays in, arrays out, and the only threads of the crate.

use crate::config::SimConfig;
use crate::cpu::DefaultMode;
use crate::error::{Error, Result, expect_length};
use crate::results::{Results, Rows};
use crate::task::{Episode, ObservationRow, Outcome, Task, Workspace};
use crate::world::Scenario;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::{Deserialize, Serialize};

/// Largest number of robots: streams are named by a 32-bit index.
pub const ROBOTS_MAX: usize = 1 << 20;
/// Largest number of threads, by common sense.
pub const THREADS_MAX: usize = 256;

/// A batch of robots, each with a world of its own, stepped together.
///
/// Robot k meets the same worlds and noise whatever the size of the batch and the number of threads.
#[derive(Debug)]
pub struct BatchSim {
    task: Task,
    autoreset: bool,
    episodes: Vec<Episode>,
    results: Results,
    /// Empty until `keep_ranges`, then never moved: others may hold views.
    ranges: Vec<f32>,
    workers: Vec<Worker>,
    pool: Option<ThreadPool>,
    process: u32,
}

/// What belongs to one thread: its memory, and how its part of the last call went.
#[derive(Debug)]
struct Worker {
    workspace: Workspace,
    result: Result<()>,
}

/// What distinguishes a simulator in the middle of its work from a new one.
#[derive(Serialize, Deserialize)]
struct State {
    version: u32,
    episodes: Vec<Episode>,
    results: Results,
}

const STATE_VERSION: u32 = 4;

/// What is done to a range of robots.
#[derive(Clone, Copy)]
enum Work<'a> {
    Step(&'a [f32]),
    Reset(Option<&'a [bool]>),
    Begin,
    Scan,
}

impl BatchSim {
    /// A simulator of `num_envs` robots that have begun their episode 0, stepped by `num_threads` threads, of which the
    /// calling one is the first. With `scenarios`, robot k runs scenario k (modulo their number).
    ///
    /// With `autoreset` a step that ends an episode begins the next one in the same call.
    ///
    /// # Errors
    /// A setting, number of robots or number of threads out of range; a world too full; threads that do not start.
    pub fn new(
        config: SimConfig,
        num_envs: usize,
        seed: u64,
        num_threads: usize,
        autoreset: bool,
        scenarios: Option<Vec<Scenario>>,
    ) -> Result<Self> {
        Self::part(config, num_envs, seed, num_threads, autoreset, scenarios, 0)
    }

    /// A simulator of the robots `first` to `first + num_envs - 1` of a larger one, which meet what they would meet
    /// there. With `scenarios`, which are those of this part, robot k runs scenario k.
    ///
    /// # Errors
    /// Those of `new`; more robots before these than a simulator can have.
    pub fn part(
        config: SimConfig,
        num_envs: usize,
        seed: u64,
        num_threads: usize,
        autoreset: bool,
        scenarios: Option<Vec<Scenario>>,
        first: usize,
    ) -> Result<Self> {
        within("num_envs", num_envs, ROBOTS_MAX)?;
        within("first + num_envs", first + num_envs, ROBOTS_MAX)?;
        within("num_threads", num_threads, THREADS_MAX)?;
        let _mode = DefaultMode::set();
        let task = Task::new(config, scenarios, seed, first)?;
        let mut simulator = Self {
            autoreset,
            episodes: vec![Episode::default(); num_envs],
            results: Results::new(num_envs, task.observation_size()),
            ranges: Vec::new(),
            workers: (0..num_threads).map(|_| Worker { workspace: task.workspace(), result: Ok(()) }).collect(),
            pool: start_pool(num_threads)?,
            process: std::process::id(),
            task,
        };
        simulator.run(Work::Begin)?;
        Ok(simulator)
    }

    /// Number of robots.
    pub fn num_envs(&self) -> usize {
        self.episodes.len()
    }

    /// Numbers of an observation: bins + 4.
    pub fn observation_size(&self) -> usize {
        self.task.observation_size()
    }

    /// The configuration.
    pub fn config(&self) -> &SimConfig {
        self.task.config()
    }

    /// Results of the last call, written in place.
    pub fn results(&self) -> &Results {
        &self.results
    }

    /// Range of every beam now, (num_envs, beams), m; NaN for a lost beam. Empty before `keep_ranges`.
    pub fn ranges(&self) -> &[f32] {
        &self.ranges
    }

    /// Fills `ranges`, and lets every later call write them in place. They are eight times as many numbers as the
    /// observations, and few need them.
    ///
    /// # Errors
    /// A process forked from the one that made this simulator.
    pub fn keep_ranges(&mut self) -> Result<()> {
        if !self.ranges.is_empty() {
            return Ok(());
        }
        self.check_process()?;
        self.ranges = vec![0.0; self.num_envs() * self.config().lidar.beams];
        self.run(Work::Scan)
    }

    /// What `robot` meets in its present episode.
    pub fn scenario(&self, robot: usize) -> Option<Scenario> {
        self.episodes.get(robot).map(|episode| self.task.scenario(robot, episode))
    }

    /// Where each robot believes to be, by its odometry: x (m), y (m), yaw (rad). Without `robot.odometry_noise` the
    /// pose.
    pub fn odometry(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        self.episodes.iter().map(Episode::believed_pose).map(|pose| [pose.x, pose.y, pose.yaw])
    }

    /// Distance (m) of each robot's footprint from the nearest obstacle now.
    pub fn clearances(&self) -> impl Iterator<Item = f32> + '_ {
        self.episodes.iter().enumerate().map(|(robot, episode)| self.task.clearance(robot, episode))
    }

    /// Begins the next episode of all robots, or of those whose `mask` is true.
    ///
    /// # Errors
    /// A mask of another length; a world too full (the simulator is then of no more use).
    pub fn reset(&mut self, mask: Option<&[bool]>) -> Result<()> {
        if let Some(mask) = mask {
            expect_length("mask", self.num_envs(), mask.len())?;
        }
        self.run(Work::Reset(mask))
    }

    /// Drives every robot for one control period; `actions` holds (a1, a2) of each robot, clipped to [-1, 1].
    ///
    /// Without autoreset a finished robot stays as it is, with reward 0, until `reset`.
    ///
    /// # Errors
    /// Wrong length, NaN or infinity: nothing has moved then. A world too full: the simulator is of no more use.
    pub fn step(&mut self, actions: &[f32]) -> Result<()> {
        expect_length("actions", 2 * self.num_envs(), actions.len())?;
        // Without a way out of the loop many are looked at together.
        let all_finite = actions.iter().fold(true, |all, a| all & a.is_finite());
        let bad = if all_finite { None } else { actions.iter().position(|a| !a.is_finite()) };
        match bad {
            None => self.run(Work::Step(actions)),
            Some(i) => Err(Error::NotFinite { name: "actions", value: actions[i], robot: i / 2 }),
        }
    }

    /// Everything that the future depends on, besides what `new` was given.
    ///
    /// # Errors
    /// A number that JSON cannot hold (none should ever arise).
    pub fn state(&self) -> Result<Vec<u8>> {
        let state = State { version: STATE_VERSION, episodes: self.episodes.clone(), results: self.results.clone() };
        serde_json::to_vec(&state).map_err(|e| Error::Parse(format!("simulator state: {e}")))
    }

    /// Continues bit for bit where `state` was taken, from a simulator made with the same arguments.
    ///
    /// # Errors
    /// Bytes that are no state or hold impossible numbers, the state of another number of robots or bins, or a process
    /// forked from the one that made this simulator: nothing has changed then.
    pub fn restore(&mut self, state: &[u8]) -> Result<()> {
        self.check_process()?;
        let state: State = serde_json::from_slice(state).map_err(|e| Error::Parse(format!("simulator state: {e}")))?;
        if state.version != STATE_VERSION {
            return Err(Error::Parse(format!(
                "simulator state: expected version {STATE_VERSION}, got {}",
                state.version
            )));
        }
        expect_length("simulator state", self.num_envs(), state.episodes.len())?;
        self.results.check_same_shape(&state.results)?;
        state.episodes.iter().try_for_each(|episode| self.task.check(episode))?;
        self.results.copy_from(&state.results);
        self.episodes = state.episodes;
        self.episodes.iter_mut().for_each(Episode::prepare_moved);
        if self.ranges.is_empty() { Ok(()) } else { self.run(Work::Scan) }
    }

    /// Refuses a process that has no threads of this simulator: a fork takes only the calling one along.
    fn check_process(&self) -> Result<()> {
        let current = std::process::id();
        if self.pool.is_none() || current == self.process {
            return Ok(());
        }
        Err(Error::Forked { created: self.process, current })
    }

    /// Splits the robots into one contiguous part for each thread; the calling thread does the first.
    fn run(&mut self, work: Work) -> Result<()> {
        self.check_process()?;
        let Self { task, autoreset, episodes, results, ranges, workers, pool, .. } = self;
        let (rows, beams) = (results.rows(), ranges.len() / episodes.len());
        let mut part = Part { task, autoreset: *autoreset, work, first: 0, episodes, rows, ranges, beams };
        let Some(pool) = pool else { return part.run(&mut workers[0].workspace) };
        let threads = workers.len().min(part.episodes.len());
        let (own, others) = workers[..threads].split_at_mut(1);
        pool.in_place_scope(|scope| {
            for (i, worker) in others.iter_mut().enumerate().rev() {
                let last;
                (part, last) = part.split_at_share(i + 1, i + 2);
                scope.spawn(move |_| worker.run(last));
            }
            own[0].run(part);
        });
        workers[..threads].iter_mut().try_for_each(|worker| std::mem::replace(&mut worker.result, Ok(())))
    }
}

impl Worker {
    fn run(&mut self, mut part: Part) {
        self.result = part.run(&mut self.workspace);
    }
}

/// A contiguous range of robots and what is done to them.
struct Part<'a> {
    task: &'a Task,
    autoreset: bool,
    work: Work<'a>,
    first: usize,
    episodes: &'a mut [Episode],
    rows: Rows<'a>,
    /// Ranges of its robots, if anybody asked.
    ranges: &'a mut [f32],
    /// Ranges of a robot, 0 if nobody asked.
    beams: usize,
}

impl<'a> Part<'a> {
    /// The first `share` of `of` equal shares of the robots, and the rest.
    fn split_at_share(self, share: usize, of: usize) -> (Part<'a>, Part<'a>) {
        let Self { task, autoreset, work, first, episodes, rows, ranges, beams } = self;
        let here = episodes.len() * share / of;
        let (left, right) = episodes.split_at_mut(here);
        let (left_rows, right_rows) = rows.split_at(here);
        let (left_ranges, right_ranges) = ranges.split_at_mut(here * beams);
        (
            Part { episodes: left, rows: left_rows, ranges: left_ranges, task, autoreset, work, first, beams },
            Part {
                first: first + here,
                episodes: right,
                rows: right_rows,
                ranges: right_ranges,
                task,
                autoreset,
                work,
                beams,
            },
        )
    }

    fn run(&mut self, workspace: &mut Workspace) -> Result<()> {
        let _mode = DefaultMode::set();
        for i in 0..self.episodes.len() {
            let robot = self.first + i;
            if let Some(next) = self.episodes.get(i + 1) {
                next.prefetch();
            }
            match self.work {
                Work::Begin => self.begin(i, 0, workspace)?,
                Work::Reset(mask) => {
                    if mask.is_none_or(|mask| mask[robot]) {
                        self.begin(i, self.episodes[i].index + 1, workspace)?;
                    }
                }
                Work::Scan => {
                    let ranges = self.task.scan(robot, &self.episodes[i], workspace);
                    self.ranges[i * self.beams..(i + 1) * self.beams].copy_from_slice(ranges);
                }
                Work::Step(actions) => self.step(i, [actions[2 * robot], actions[2 * robot + 1]], workspace)?,
            }
        }
        Ok(())
    }

    /// Begins an episode and clears what the last step of the one before left.
    fn begin(&mut self, i: usize, index: u64, workspace: &mut Workspace) -> Result<()> {
        self.begin_quietly(i, index, workspace)?;
        let outcome = self.episodes[i].outcome;
        self.rows.write_step(i, 0.0, outcome);
        self.rows.write_statistics(i, &self.episodes[i]);
        self.rows.copy_to_final(i);
        Ok(())
    }

    /// Begins an episode and leaves reward, flags, statistics and final observation as they are.
    fn begin_quietly(&mut self, i: usize, index: u64, workspace: &mut Workspace) -> Result<()> {
        let episode = &mut self.episodes[i];
        let ranges = &mut self.ranges[i * self.beams..(i + 1) * self.beams];
        let mut row = ObservationRow { observation: self.rows.observation(i), ranges };
        self.task.begin(self.first + i, index, episode, workspace, &mut row)?;
        self.rows.write_situation(i, episode);
        Ok(())
    }

    fn step(&mut self, i: usize, action: [f32; 2], workspace: &mut Workspace) -> Result<()> {
        let episode = &mut self.episodes[i];
        if episode.outcome != Outcome::Running {
            self.rows.rewards[i] = 0.0;
            return Ok(());
        }
        let ranges = &mut self.ranges[i * self.beams..(i + 1) * self.beams];
        let mut row = ObservationRow { observation: self.rows.observation(i), ranges };
        let reward = self.task.step(self.first + i, episode, action, workspace, &mut row);
        let (index, outcome) = (episode.index, episode.outcome);
        self.rows.write_step(i, reward, outcome);
        self.rows.write_statistics(i, episode);
        self.rows.write_situation(i, episode);
        self.rows.copy_to_final(i);
        if outcome != Outcome::Running && self.autoreset {
            self.begin_quietly(i, index + 1, workspace)?;
        }
        Ok(())
    }
}

/// Threads beside the calling one. Never rayon's global pool, on which a forked child would hang.
fn start_pool(threads: usize) -> Result<Option<ThreadPool>> {
    if threads == 1 {
        return Ok(None);
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads - 1).thread_name(|i| format!("navsim-{}", i + 1)).build();
    pool.map(Some).map_err(|e| Error::Threads { threads, reason: e.to_string() })
}

fn within(key: &'static str, value: usize, max: usize) -> Result<()> {
    if (1..=max).contains(&value) {
        return Ok(());
    }
    Err(Error::Setting { key, value: value.to_string(), expected: format!("1 to {max}") })
}
