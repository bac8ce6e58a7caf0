//! The outline of the robot on the floor.

use crate::config::{FootprintKind, RobotConfig};

/// Shape of the robot seen from above, centred on the point that drives the arcs, x forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Footprint {
    /// A disc.
    Disc {
        /// Radius, m, > 0.
        radius: f64,
    },
    /// A rectangle.
    Rectangle {
        /// Full extent along x, m, > 0.
        length: f64,
        /// Full extent along y, m, > 0.
        width: f64,
    },
}

impl Footprint {
    /// The footprint that the configuration names.
    pub fn new(robot: &RobotConfig) -> Self {
        match robot.footprint {
            FootprintKind::Disc => Self::Disc { radius: robot.radius },
            FootprintKind::Rectangle => Self::Rectangle { length: robot.length, width: robot.width },
        }
    }

    /// Radius (m) of the smallest disc about the centre that holds the footprint.
    pub fn circumscribed_radius(&self) -> f64 {
        match self {
            Self::Disc { radius } => *radius,
            Self::Rectangle { length, width } => 0.5 * libm::hypot(*length, *width),
        }
    }

    /// How far (m) a point of the footprint travels, at most, per radian of turning.
    pub fn turning_reach(&self) -> f64 {
        match self {
            Self::Disc { .. } => 0.0,
            Self::Rectangle { .. } => self.circumscribed_radius(),
        }
    }
}
