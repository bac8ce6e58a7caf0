//! Paths through a known map.
//!
//! `plan` finds paths in the ways that robots use: on a map (`occupancy`) by A* or Dijkstra (`grid_search`), down a
//! field of distances (`descent`) or by ants (`ant_colony`), or by random trees (`rrt`, `rrt_star`, over `neighbours`).
//! A `problem` says exactly what is clear; every path is pulled tight and divided (`smooth`). `lookahead` leads robots
//! along their paths.

mod ant_colony;
mod budget;
mod config;
mod descent;
mod grid_search;
mod lookahead;
mod neighbours;
mod occupancy;
mod plan;
mod problem;
mod rrt;
mod rrt_star;
mod smooth;

pub use config::PlannerConfig;
pub use lookahead::Lookahead;
pub use plan::{Plan, Planner, Status, plan};

#[cfg(test)]
mod tests;
