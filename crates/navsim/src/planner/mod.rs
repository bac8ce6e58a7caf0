//! Paths through a known map.

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
