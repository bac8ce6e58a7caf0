//! Plans: which planner, with which settings, and what came of it.

use super::ant_colony::ant_colony;
use super::budget::Budget;
use super::descent::descend;
use super::fast_marching::Field;
use super::grid_search::{Lead, search};
use super::inflated::Point;
use super::occupancy::Map;
use super::problem::Problem;
use super::rrt::rrt;
use super::rrt_star::rrt_star;
use super::smooth::{cut, divide, length, pull_tight};
use crate::error::{Error, Result};
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::world::Scenario;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Ways to find a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Planner {
    /// A* on a grid of eight neighbours.
    AStar,
    /// Dijkstra's algorithm on the same grid.
    Dijkstra,
    /// Rapidly exploring random tree.
    Rrt,
    /// RRT*, with informed samples.
    RrtStar,
    /// Ant colony on a grid.
    AntColony,
    /// Down the field of distances from the goal, by fast marching on a grid.
    FastMarching,
}

impl Planner {
    /// Every planner with its name.
    pub const ALL: [(&'static str, Planner); 6] = [
        ("astar", Planner::AStar),
        ("dijkstra", Planner::Dijkstra),
        ("rrt", Planner::Rrt),
        ("rrtstar", Planner::RrtStar),
        ("antcolony", Planner::AntColony),
        ("fmm", Planner::FastMarching),
    ];

    /// The planner of that name, `None` for another word.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(word, _)| *word == name).map(|(_, planner)| *planner)
    }
}

/// Settings of all planners. Python holds the defaults; every field must be given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannerConfig {
    /// Clearance that is wanted beyond the robot's radius, m, 0 to 100. Where start, goal or every way is narrower, half of
    /// it, and then none.
    pub margin: f64,
    /// Side of a cell of `astar`, `dijkstra` and `fmm`, m, in [0.001, 100].
    pub resolution: f64,
    /// Side of a cell of `antcolony`, m, in [0.001, 100].
    pub ant_resolution: f64,
    /// Longest edge of `rrt` and `rrtstar`, m, in [0.001, 1000].
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

/// How a plan ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// There is a path.
    Found,
    /// The obstacles cut the goal off from the start: exact, whatever the planner.
    NoPath,
    /// The start has less clearance than the robot's radius.
    StartInCollision,
    /// No place at the rim of the goal circle has the clearance of the robot's radius.
    GoalInCollision,
    /// The map's cells are too large to show the way that there is.
    TooCoarse,
    /// The samples, the rounds or the time ended before a path was found.
    BudgetSpent,
}

impl Status {
    /// The status in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::NoPath => "no path",
            Self::StartInCollision => "start in collision",
            Self::GoalInCollision => "goal in collision",
            Self::TooCoarse => "too coarse",
            Self::BudgetSpent => "budget spent",
        }
    }
}

/// What a planner found.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// How it ended.
    pub status: Status,
    /// Corners of the path from the start to within the goal circle, m; empty unless found.
    pub path: Vec<Point>,
    /// Length (m) of the path; infinite without one.
    pub length: f64,
    /// Distance (m) that the path keeps from every shape at least: radius and margin, or as much of the margin as there
    /// was room for.
    pub clearance: f64,
    /// Nodes expanded (`astar`, `dijkstra`, `fmm`), samples drawn (`rrt`, `rrtstar`), steps walked (`antcolony`).
    pub expansions: u64,
    /// Time that it took, s.
    pub time: f64,
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
        let (samples, ants, rounds) = (self.samples as f64, f64::from(self.ants), f64::from(self.rounds));
        for (key, value, low, high) in [
            ("margin", self.margin, 0.0, 100.0),
            ("resolution", self.resolution, 1e-3, 100.0),
            ("ant_resolution", self.ant_resolution, 1e-3, 100.0),
            ("step", self.step, 1e-3, 1000.0),
            ("samples", samples, 1.0, 1e7),
            ("goal_bias", self.goal_bias, 0.0, 1.0 - f64::EPSILON),
            ("ants", ants, 1.0, 1e4),
            ("rounds", rounds, 1.0, 1e4),
            ("evaporation", self.evaporation, f64::MIN_POSITIVE, 1.0),
            ("goal_weight", self.goal_weight, 0.0, 20.0),
            ("time_limit", self.time_limit, 0.0, 1e6),
        ] {
            if !(value >= low && value <= high) {
                let expected = format!("a number from {low} to {high}");
                return Err(Error::Setting { key, value: value.to_string(), expected });
            }
        }
        if self.spacing != 0.0 && !(self.spacing >= 1e-3 && self.spacing <= 1000.0) {
            let expected = "0, or a number from 0.001 to 1000".into();
            return Err(Error::Setting { key: "spacing", value: self.spacing.to_string(), expected });
        }
        Ok(())
    }
}

/// Plans the way of `scenario` for a robot of `radius` (m, > 0; for a rectangle the radius of the circle around it).
/// `seed` and `index` name the random numbers of `rrt`, `rrtstar` and `antcolony`.
///
/// # Errors
/// A scenario, radius or setting out of range, or a map of more than 10 million nodes. That there is no path is no error
/// but a `Status`.
pub fn plan(
    scenario: &Scenario,
    planner: Planner,
    radius: f64,
    config: &PlannerConfig,
    seed: u64,
    index: u32,
) -> Result<Plan> {
    let began = Instant::now();
    config.validate()?;
    if !(radius > 0.0 && radius.is_finite()) {
        let expected = "a number above 0".into();
        return Err(Error::Setting { key: "radius", value: radius.to_string(), expected });
    }
    let cell = match planner {
        Planner::AntColony => config.ant_resolution,
        Planner::Rrt | Planner::RrtStar => 0.0,
        _ => config.resolution,
    };
    let mut problem = Problem::new(scenario, radius + config.margin, 2.0 * cell)?;
    let mut status = problem.obstruction();
    for share in [0.5, 0.0] {
        if status.is_some() && config.margin > 0.0 {
            problem = Problem::new(scenario, radius + share * config.margin, 2.0 * cell)?;
            status = problem.obstruction();
        }
    }
    let mut random = Stream::new(StreamName::new(seed, Purpose::Planner, Split::Given, index, 0));
    let found = match status {
        Some(status) => Outcome { path: Err(status), expansions: 0 },
        None => find(&problem, planner, config, &mut random)?,
    };
    let (status, path) = match found.path {
        Ok(path) => (Status::Found, finished(&problem, path, config)),
        Err(status) => (status, Vec::new()),
    };
    let length = if path.is_empty() { f64::INFINITY } else { length(&path) };
    let time = began.elapsed().as_secs_f64();
    Ok(Plan { status, path, length, clearance: problem.clearance, expansions: found.expansions, time })
}

struct Outcome {
    path: std::result::Result<Vec<Point>, Status>,
    expansions: u64,
}

fn find(problem: &Problem, planner: Planner, config: &PlannerConfig, random: &mut Stream) -> Result<Outcome> {
    if problem.to_circle(problem.start) <= 0.0 {
        return Ok(Outcome { path: Ok(vec![problem.start]), expansions: 0 });
    }
    if matches!(planner, Planner::Rrt | Planner::RrtStar) {
        let grow = if planner == Planner::Rrt { rrt } else { rrt_star };
        let mut budget = Budget::new(config.samples, config.time_limit);
        let path = grow(problem, config, random, &mut budget).ok_or(Status::BudgetSpent);
        return Ok(Outcome { path, expansions: budget.spent });
    }
    let ants = planner == Planner::AntColony;
    let map = Map::new(problem, if ants { config.ant_resolution } else { config.resolution })?;
    if planner == Planner::FastMarching {
        let field = Field::march(map.grid, &map.blocked, &map.goals(problem));
        let expansions = field.distances().iter().filter(|distance| distance.is_finite()).count() as u64;
        return Ok(Outcome { path: descend(problem, &map, &field).ok_or(Status::TooCoarse), expansions });
    }
    let route = if ants {
        let mut budget = Budget::new(u64::from(config.rounds), config.time_limit);
        ant_colony(problem, &map, config, random, &mut budget)
    } else {
        let lead = (planner == Planner::AStar).then_some(Lead { goal: problem.goal, radius: problem.goal_radius });
        search(&map, &map.around(problem, problem.start), &map.goals(problem), lead)
    };
    let nodes = route.nodes.iter().map(|node| map.grid.position(*node));
    let mut path: Vec<Point> = std::iter::once(problem.start).chain(nodes).collect();
    path.extend(route.nodes.last().and_then(|node| problem.entry(map.grid.position(*node))));
    let path = if route.nodes.is_empty() { Err(Status::TooCoarse) } else { Ok(path) };
    Ok(Outcome { path, expansions: route.expansions })
}

/// The path as it is handed out.
fn finished(problem: &Problem, mut path: Vec<Point>, config: &PlannerConfig) -> Vec<Point> {
    cut(problem, &mut path);
    if config.shortcut && path.len() > 1 {
        pull_tight(problem, &mut path);
    }
    path.dedup();
    if config.spacing > 0.0 { divide(&path, config.spacing) } else { path }
}
