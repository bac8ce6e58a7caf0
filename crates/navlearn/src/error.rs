//! What stops an update: sizes that do not fit, a NaN or an infinity.

use std::fmt::Display;
use thiserror::Error;

/// Why an update was not made. All but `Critics` and `Actor` are found before anything of the call has changed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Error {
    /// Settings or slices do not fit each other.
    #[error("{what}: expected {expected}, got {got}")]
    Size {
        /// What has the wrong size.
        what: String,
        /// The size that fits.
        expected: String,
        /// The size that came.
        got: String,
    },
    /// The second thread could not be started.
    #[error("cannot start a second thread to learn: {reason}")]
    Thread {
        /// What the system says.
        reason: String,
    },
    /// A NaN or an infinity in a row of replay that was drawn.
    #[error("the row in place {row} of replay is not finite in column {column}")]
    Row {
        /// Place in replay.
        row: usize,
        /// Column of the row.
        column: usize,
    },
    /// In a packed vector of a network.
    #[error("entry {place} of the {network}'s {vector} is not finite")]
    Parameter {
        /// "actor" or "critic".
        network: &'static str,
        /// Which of its vectors.
        vector: &'static str,
        /// Index into the vector.
        place: usize,
    },
    /// In the noise on the target's actions.
    #[error("the target noise is not finite in draw {place}")]
    Noise {
        /// Index into the draws of the call.
        place: usize,
    },
    /// In the critics' values, errors or gradients: they overflowed. Nothing of that update has changed.
    #[error("the critics' error in update {update} is not finite")]
    Critics {
        /// Number of the update since the start, from 1.
        update: u64,
    },
    /// In the actor's outputs or gradients: they overflowed. The critics have made their step of that update.
    #[error("the actor's gradient in update {update} is not finite")]
    Actor {
        /// Number of the update since the start, from 1.
        update: u64,
    },
}

/// The present crate's results.
pub type Result<T> = std::result::Result<T, Error>;

/// Refuses a size that is not as expected.
pub fn expect_size(what: impl Into<String>, got: usize, expected: usize) -> Result<()> {
    expect(what, got, got == expected, || expected.to_string())
}

/// Refuses a size unless it fits.
pub fn expect(what: impl Into<String>, got: impl Display, fits: bool, expected: impl Fn() -> String) -> Result<()> {
    if fits { Ok(()) } else { Err(Error::Size { what: what.into(), expected: expected(), got: got.to_string() }) }
}
