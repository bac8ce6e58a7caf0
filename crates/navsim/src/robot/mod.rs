//! The robot: its footprint and how it moves.

mod footprint;
mod kinematics;

pub use footprint::Footprint;
pub use kinematics::{Arc, command, limit_acceleration};
