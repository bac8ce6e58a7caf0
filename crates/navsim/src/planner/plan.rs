//! Plans: which planner, and what came of it.

use super::ant_colony::ant_colony;
use super::budget::Budget;
use super::config::PlannerConfig;
use super::descent::descend;
use super::grid_search::{Route, search};
use super::occupancy::Map;
use super::problem::Problem;
use super::rrt::rrt;
use super::rrt_star::rrt_star;
use super::smooth::{cut, divide, length, pull_tight};
use crate::config::check;
use crate::cpu::DefaultMode;
use crate::error::Result;
use crate::grown::{Field, Point};
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::world::Scenario;
use std::time::Instant;

/// Most nodes of a map: a search keeps at most 14 bytes for each, 140 MB.
const NODES_MAX: usize = 10_000_000;
/// Most nodes of a map for ants, whose trails take 41 bytes for each.
const ANT_NODES_MAX: usize = 1_000_000;

/// Largest radius of a robot, m: that of the largest coordinate.
const RADIUS_MAX: f64 = 1000.0;

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

/// Plans the way of `scenario` for a robot of `radius` (m, in (0, 1000]; for a rectangle the radius of the circle
/// around it). `seed` and `index` name the random numbers of `rrt`, `rrtstar` and `antcolony`.
///
/// # Errors
/// A scenario, radius or setting out of range, or a map of more than 10 million nodes (for ants of 1 million). That
/// there is no path is no error but a `Status`.
pub fn plan(
    scenario: &Scenario,
    planner: Planner,
    radius: f64,
    config: &PlannerConfig,
    seed: u64,
    index: u32,
) -> Result<Plan> {
    let began = Instant::now();
    let _mode = DefaultMode::set();
    config.validate()?;
    check("radius", radius, radius > 0.0 && radius <= RADIUS_MAX, "in (0, 1000] m")?;
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

/// The path as a planner leaves it, or why there is none.
struct Outcome {
    path: std::result::Result<Vec<Point>, Status>,
    expansions: u64,
}

/// What a planner makes of a problem that can be solved.
fn find(problem: &Problem, planner: Planner, config: &PlannerConfig, random: &mut Stream) -> Result<Outcome> {
    if problem.to_circle(problem.start) <= 0.0 {
        return Ok(Outcome { path: Ok(vec![problem.start]), expansions: 0 });
    }
    Ok(match planner {
        Planner::Rrt | Planner::RrtStar => {
            let grow = if planner == Planner::Rrt { rrt } else { rrt_star };
            let mut budget = Budget::new(config.samples, config.time_limit);
            let path = grow(problem, config, random, &mut budget).ok_or(Status::BudgetSpent);
            Outcome { path, expansions: budget.spent }
        }
        Planner::AntColony => {
            let map = Map::new(problem, "planner.ant_resolution", config.ant_resolution, ANT_NODES_MAX)?;
            let mut budget = Budget::new(u64::from(config.rounds), config.time_limit);
            let route = ant_colony(problem, &map, config, random, &mut budget);
            let ended = if budget.is_late() { Status::BudgetSpent } else { Status::TooCoarse };
            Outcome { path: walked(problem, &map, &route).ok_or(ended), expansions: route.expansions }
        }
        Planner::AStar | Planner::Dijkstra => {
            let map = Map::new(problem, "planner.resolution", config.resolution, NODES_MAX)?;
            let lead = (planner == Planner::AStar).then_some(problem.goal);
            let route = search(&map, &map.around(problem, problem.start), &map.goals(problem), lead);
            Outcome { path: walked(problem, &map, &route).ok_or(Status::TooCoarse), expansions: route.expansions }
        }
        Planner::FastMarching => {
            let map = Map::new(problem, "planner.resolution", config.resolution, NODES_MAX)?;
            let field = Field::march(map.grid, &map.blocked, &map.goals(problem));
            let expansions = field.distances().iter().filter(|distance| distance.is_finite()).count() as u64;
            Outcome { path: descend(problem, &map, &field).ok_or(Status::TooCoarse), expansions }
        }
    })
}

/// The path over the nodes of a route.
fn walked(problem: &Problem, map: &Map, route: &Route) -> Option<Vec<Point>> {
    let end = problem.entry(map.grid.position(*route.nodes.last()?))?;
    let nodes = route.nodes.iter().map(|node| map.grid.position(*node));
    Some(std::iter::once(problem.start).chain(nodes).chain([end]).collect())
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
