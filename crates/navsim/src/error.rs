//! What can go wrong, each with the value that was expected and the one that came.

use thiserror::Error;

/// A refusal of the simulator. Every message fits on one line. The simulator is untouched by a call that returns one,
/// except by `WorldTooFull` in the middle of a run: some robots have then begun an episode and others not.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    /// A setting is out of its range or contradicts another.
    #[error("{key} = {value}: expected {expected}")]
    Setting {
        /// Key path in the configuration, for example `lidar.beams`.
        key: &'static str,
        /// The value that came.
        value: String,
        /// The values that are allowed.
        expected: String,
    },
    /// A text (scenario, world file, configuration) cannot be read.
    #[error("{0}")]
    Parse(String),
    /// A line of a scenario list is refused.
    #[error("line {line}: {reason}")]
    Line {
        /// Line number, from 1.
        line: usize,
        /// Why it is refused.
        reason: String,
    },
    /// A shape is not a finite, non-degenerate circle, box, segment or convex polygon.
    #[error("{0}")]
    Shape(String),
    /// A scenario cannot be run by this robot.
    #[error("{0}")]
    Scenario(String),
    /// No start, goal and boxes were found within the allowed number of tries.
    #[error("world '{world}' is too full: {tries} draws gave no start and reachable goal ({reason})")]
    WorldTooFull {
        /// Name of the world.
        world: String,
        /// Draws that were made.
        tries: u32,
        /// What the last draw failed on, with the clearance numbers.
        reason: String,
    },
    /// An array has the wrong length.
    #[error("{name}: expected {expected} elements, got {got}")]
    Length {
        /// Name of the argument.
        name: &'static str,
        /// Elements that were expected.
        expected: usize,
        /// Elements that came.
        got: usize,
    },
    /// An array holds NaN or infinity.
    #[error("{name}: expected finite numbers, got {value} for robot {robot}")]
    NotFinite {
        /// Name of the argument.
        name: &'static str,
        /// The value that came.
        value: f32,
        /// Index of the robot.
        robot: usize,
    },
    /// A number in an array cannot be used.
    #[error("{name}: row {row}: expected {expected}, got {value}")]
    Number {
        /// Name of the argument.
        name: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// The value that came.
        value: f64,
        /// Row of the array.
        row: usize,
    },
    /// The simulator's threads belong to another process (it was created before a fork).
    #[error("simulator created in process {created} cannot step in its fork {current}: create it after the fork")]
    Forked {
        /// Process that created the simulator.
        created: u32,
        /// Process that called it.
        current: u32,
    },
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// Threads that were asked for.
        threads: usize,
        /// What the operating system said.
        reason: String,
    },
}

/// Result of a call that may be refused.
pub type Result<T> = std::result::Result<T, Error>;

/// Refuses the array `name` unless it has the expected length.
pub(crate) fn expect_length(name: &'static str, expected: usize, got: usize) -> Result<()> {
    if expected == got { Ok(()) } else { Err(Error::Length { name, expected, got }) }
}
