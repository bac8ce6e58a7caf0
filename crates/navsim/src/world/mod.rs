//! Worlds: shapes, their prepared form, and where scenarios come from.

mod obstacles;
mod outline;
pub mod shapes;

pub use obstacles::Obstacles;
pub(crate) use obstacles::{isometry, vector};
pub(crate) use outline::{Edge, Outline};
pub use shapes::Shape;
