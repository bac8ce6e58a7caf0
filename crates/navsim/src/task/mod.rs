//! The task: drive to the goal without touching anything, in time.

mod episode;
mod observation;
mod odometry;
mod reward;

pub use episode::{Episode, ObservationRow, Statistics, Task, Workspace};
pub use observation::{EXTRA, goal_in_robot};
pub use reward::{Step, paper_reward, reward};

use serde::{Deserialize, Serialize};

/// How an episode stands after a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[repr(u8)]
pub enum Outcome {
    /// It goes on.
    #[default]
    Running = 0,
    /// The centre came nearer to the goal than the goal radius.
    Goal = 1,
    /// The footprint touched an obstacle.
    Collision = 2,
    /// The time limit cut it.
    Timeout = 3,
}

impl Outcome {
    /// Whether the step ended the episode for good: goal or collision.
    pub fn terminated(self) -> bool {
        matches!(self, Self::Goal | Self::Collision)
    }

    /// Whether the time limit cut the episode.
    pub fn truncated(self) -> bool {
        self == Self::Timeout
    }
}
