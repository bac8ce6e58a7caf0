//! Paths through a known map.
//!
//! `shortest_path` is exact: obstacles grown by the robot (`inflated`), what they enclose (`enclosure`), the reachable
//! part of the goal (`goal_disc`), fast marching as a guide (`fast_marching`, `guide`), the shortest taut string
//! (`taut_string`). It gives lengths, which others are measured by.
//!
//! `plan` finds paths in the ways that robots use: on a map (`occupancy`) by A* or Dijkstra (`grid_search`), down a
//! field of distances (`descent`) or by ants (`ant_colony`), or by random trees (`rrt`, `rrt_star`, over `neighbours`).
//! A `problem` says exactly what is clear; every path is pulled tight and divided (`smooth`). `lookahead` leads robots
//! along their paths.

mod ant_colony;
mod budget;
mod config;
mod descent;
mod enclosure;
mod fast_marching;
mod goal_disc;
mod grid_search;
mod guide;
mod inflated;
mod lookahead;
mod neighbours;
mod occupancy;
mod plan;
mod problem;
mod rrt;
mod rrt_star;
mod shortest_path;
mod smooth;
mod taut_string;

pub use config::PlannerConfig;
pub use fast_marching::{BORDER, Field, Grid};
pub use lookahead::Lookahead;
pub use plan::{Plan, Planner, Status, plan};
pub use shortest_path::{needs_detour, shortest_path};

#[cfg(test)]
mod tests;
