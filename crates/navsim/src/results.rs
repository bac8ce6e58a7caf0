//! The arrays that a batch writes in place: allocated once, one row for each robot.

use crate::error::{Result, expect_length};
use crate::task::{Episode, Outcome};
use serde::{Deserialize, Serialize};

/// Declares the arrays once: their owned form, their borrowed form for a range of robots, and how it is split.
macro_rules! results {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $zero:expr, $width:expr;)*) => {
        /// What the robots of a batch see and get. Rows follow each other without gaps.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        pub struct Results {
            $($(#[$doc])* pub $name: Vec<$type>,)*
        }

        /// The same rows of all arrays, for a contiguous range of robots.
        pub(crate) struct Rows<'a> {
            /// Numbers of an observation.
            width: usize,
            $(pub $name: &'a mut [$type],)*
        }

        impl Results {
            /// Arrays for `num_envs` robots whose observations have `width` numbers.
            pub(crate) fn new(num_envs: usize, width: usize) -> Self {
                Self { $($name: vec![$zero; num_envs * $width(width)],)* }
            }

            pub(crate) fn rows(&mut self) -> Rows<'_> {
                Rows { width: self.observations.len() / self.rewards.len(), $($name: &mut self.$name,)* }
            }

            pub(crate) fn check_same_shape(&self, other: &Self) -> Result<()> {
                $(expect_length(stringify!($name), self.$name.len(), other.$name.len())?;)*
                Ok(())
            }

            /// Copies into the memory that is there, to which others may hold views.
            pub(crate) fn copy_from(&mut self, other: &Self) {
                $(self.$name.copy_from_slice(&other.$name);)*
            }
        }

        impl<'a> Rows<'a> {
            pub(crate) fn split_at(self, robots: usize) -> (Rows<'a>, Rows<'a>) {
                let width = self.width;
                $(let $name = self.$name.split_at_mut(robots * $width(width));)*
                (Rows { width, $($name: $name.0,)* }, Rows { width, $($name: $name.1,)* })
            }
        }
    };
}

results! {
    /// Observation of each robot now, (num_envs, bins + 4): bins (m), goal distance (m), goal angle (rad), previous
    /// command as shares of the limits.
    observations: f32 = 0.0, |width| width;
    /// Reward of the step just made, unscaled.
    rewards: f32 = 0.0, |_| 1;
    /// Whether the step just made ended the episode at the goal or by a collision.
    terminated: bool = false, |_| 1;
    /// Whether the time limit cut the episode at the step just made.
    truncated: bool = false, |_| 1;
    /// True successor of the step just made, also when the episode goes on, (num_envs, bins + 4).
    final_observations: f32 = 0.0, |width| width;
    /// `Outcome` of the step just made.
    outcome: u8 = 0, |_| 1;
    /// Pose now, (num_envs, 3): x (m), y (m), yaw (rad).
    poses: f64 = 0.0, |_| 3;
    /// Goal now, (num_envs, 2), m.
    goals: f64 = 0.0, |_| 2;
    /// Velocity of the step just made, (num_envs, 2): v (m/s), omega (rad/s); 0 at the start of an episode.
    velocities: f64 = 0.0, |_| 2;
    /// Return in the paper's form of the episode that the step just made belongs to.
    episode_returns: f64 = 0.0, |_| 1;
    /// Its steps so far.
    episode_steps: u32 = 0, |_| 1;
    /// Its arc length driven, m.
    episode_path: f64 = 0.0, |_| 1;
    /// Its smallest clearance at the ends of steps, m.
    episode_clearance: f64 = 0.0, |_| 1;
    /// Its index, counted for each robot from 0.
    episodes: u64 = 0, |_| 1;
}

impl Rows<'_> {
    /// Place for the observation of robot `i`.
    pub fn observation(&mut self, i: usize) -> &mut [f32] {
        &mut self.observations[i * self.width..(i + 1) * self.width]
    }

    pub fn write_step(&mut self, i: usize, reward: f64, outcome: Outcome) {
        self.rewards[i] = reward as f32;
        self.outcome[i] = outcome as u8;
        self.terminated[i] = outcome.terminated();
        self.truncated[i] = outcome.truncated();
    }

    pub fn write_statistics(&mut self, i: usize, episode: &Episode) {
        let statistics = &episode.statistics;
        self.velocities[2 * i..2 * i + 2].copy_from_slice(&episode.velocity);
        self.episode_returns[i] = statistics.paper_return;
        self.episode_steps[i] = statistics.steps;
        self.episode_path[i] = statistics.path;
        self.episode_clearance[i] = f64::from(statistics.clearance);
        self.episodes[i] = episode.index;
    }

    pub fn write_situation(&mut self, i: usize, episode: &Episode) {
        let pose = &episode.pose;
        self.poses[3 * i..3 * i + 3].copy_from_slice(&[pose.x, pose.y, pose.yaw]);
        self.goals[2 * i..2 * i + 2].copy_from_slice(&episode.goal);
    }

    /// The observation of robot `i` is also the successor of the step just made.
    pub fn copy_to_final(&mut self, i: usize) {
        let range = i * self.width..(i + 1) * self.width;
        self.final_observations[range.clone()].copy_from_slice(&self.observations[range]);
    }
}
