//! How long a search may go on.

use std::time::{Duration, Instant};

/// Samples, or rounds of ants, and seconds that are left.
#[derive(Debug)]
pub(crate) struct Budget {
    left: u64,
    until: Option<Instant>,
    /// What has been spent.
    pub spent: u64,
}

impl Budget {
    /// `count` units of work, and `seconds` of time from now if that is above 0.
    pub fn new(count: u64, seconds: f64) -> Self {
        let until = (seconds > 0.0).then(|| Instant::now() + Duration::from_secs_f64(seconds));
        Self { left: count, until, spent: 0 }
    }

    /// Takes one unit; false if none is left, or no time.
    pub fn spend(&mut self) -> bool {
        if self.left == 0 || self.is_late() {
            return false;
        }
        self.left -= 1;
        self.spent += 1;
        true
    }

    /// Whether no time is left.
    pub fn is_late(&self) -> bool {
        self.until.is_some_and(|until| Instant::now() >= until)
    }
}
