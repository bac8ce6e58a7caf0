//! Paths through a known map.
//!
//! `shortest_path` is exact: obstacles grown by the robot (`inflated`), what they enclose (`enclosure`), the reachable
//! part of the goal (`goal_disc`), fast marching as a guide (`fast_marching`, `guide`), the shortest taut string
//! (`taut_string`).

mod enclosure;
mod fast_marching;
mod goal_disc;
mod guide;
mod inflated;
mod shortest_path;
mod taut_string;

pub use fast_marching::{BORDER, Field, Grid};
pub use shortest_path::{needs_detour, shortest_path};

#[cfg(test)]
mod tests;
