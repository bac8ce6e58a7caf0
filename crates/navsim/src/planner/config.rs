//! Settings of the planners. Python holds the defaults; here every field must be given and is checked once more.

use crate::config::check;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Settings of all planners; each reads its own. They are the table `planner` of the configuration file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannerConfig {
    /// Clearance that is wanted beyond the robot's radius, m, 0 to 100. Where start, goal or every way is narrower,
    /// half of it, and then none.
    pub margin: f64,
    /// Side of a cell of `astar`, `dijkstra` and `fmm`, m, in [0.001, 100].
    pub resolution: f64,
    /// Side of a cell of `antcolony`, m, in [0.001, 100].
    pub ant_resolution: f64,
    /// How far a tree grows towards a sample at most, m, in [0.001, 1000]. `rrtstar` then joins points at any distance.
    pub step: f64,
    /// Samples of `rrt` (at most) and `rrtstar`, 1 to 10 million.
    pub samples: u64,
    /// Share of the samples of a tree that are the goal, in [0, 1); of `rrtstar` until a path is known.
    pub goal_bias: f64,
    /// Ants of a round, 1 to 10,000.
    pub ants: u32,
    /// Rounds of ants, 1 to 10,000.
    pub rounds: u32,
    /// Share of a trail that is lost, and set anew, in a round, in (0, 1].
    pub evaporation: f64,
    /// How strongly the goal draws ants: the odds of a step at an angle a from it are exp(goal_weight cos a), 0 to 20.
    pub goal_weight: f64,
    /// Longest search of `rrt`, `rrtstar` and `antcolony`, s; 0: none, and then the same seed gives the same path.
    pub time_limit: f64,
    /// Whether a path is pulled tight.
    pub shortcut: bool,
    /// Largest distance of neighbouring points of the path, m; 0: only its corners.
    pub spacing: f64,
}

impl PlannerConfig {
    /// Reads the settings from JSON, every key given.
    ///
    /// # Errors
    /// `Error::Parse`, or `Error::Setting` for a value out of range.
    pub fn from_json(text: &str) -> Result<Self> {
        let config: Self = serde_json::from_str(text).map_err(|error| Error::Parse(format!("planner: {error}")))?;
        config.validate()?;
        Ok(config)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// `Error::Setting` with the first that is out of range.
    pub fn validate(&self) -> Result<()> {
        let range = |key, value: f64, [low, high]: [f64; 2], expected| {
            check(key, value, (low..=high).contains(&value), expected)
        };
        range("planner.margin", self.margin, [0.0, 100.0], "in [0, 100] m")?;
        range("planner.resolution", self.resolution, [1e-3, 100.0], "in [0.001, 100] m")?;
        range("planner.ant_resolution", self.ant_resolution, [1e-3, 100.0], "in [0.001, 100] m")?;
        range("planner.step", self.step, [1e-3, 1000.0], "in [0.001, 1000] m")?;
        range("planner.samples", self.samples as f64, [1.0, 1e7], "1 to 10,000,000")?;
        check("planner.goal_bias", self.goal_bias, (0.0..1.0).contains(&self.goal_bias), "in [0, 1)")?;
        range("planner.ants", self.ants.into(), [1.0, 1e4], "1 to 10,000")?;
        range("planner.rounds", self.rounds.into(), [1.0, 1e4], "1 to 10,000")?;
        check("planner.evaporation", self.evaporation, self.evaporation > 0.0 && self.evaporation <= 1.0, "in (0, 1]")?;
        range("planner.goal_weight", self.goal_weight, [0.0, 20.0], "in [0, 20]")?;
        range("planner.time_limit", self.time_limit, [0.0, 1e6], "in [0, 1,000,000] s")?;
        let corners_only = self.spacing == 0.0;
        let spacing = corners_only || (1e-3..=1000.0).contains(&self.spacing);
        check("planner.spacing", self.spacing, spacing, "0, or in [0.001, 1000] m")
    }
}
