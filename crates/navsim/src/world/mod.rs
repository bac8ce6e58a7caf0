//! Worlds: shapes, their prepared form, and where scenarios come from.

mod blocks;
mod distance;
mod file;
mod free_space;
mod generator;
mod grid;
mod json;
mod obstacles;
mod outline;
mod rooms;
mod scenario;
pub mod shapes;
mod tree;
mod worlds;

pub(crate) use blocks::{BLOCK, Block, Blocks, Lanes, larger, smaller};
pub use file::{RandomBoxes, WorldFile};
pub(crate) use free_space::rolling_clearance;
pub use generator::{Generator, Layout};
pub use obstacles::Obstacles;
pub(crate) use outline::{BOXES, Outline};
pub use scenario::{Scenario, ScenarioList};
pub use shapes::Shape;
pub(crate) use tree::Tree;
pub use worlds::Worlds;
