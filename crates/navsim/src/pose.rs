//! Position and heading in the plane.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Position (m) and heading (rad, counter-clockwise from x) of a frame in its parent frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// Metres along the parent's x axis.
    pub x: f64,
    /// Metres along the parent's y axis.
    pub y: f64,
    /// Heading, radians; any value is allowed, `wrap_angle` brings it to [-pi, pi].
    pub yaw: f64,
}

impl Pose {
    /// A pose from x (m), y (m) and yaw (rad).
    pub fn new(x: f64, y: f64, yaw: f64) -> Self {
        Self { x, y, yaw }
    }

    /// Where `point` (m, in this frame) lies in the parent frame.
    pub fn transform(&self, point: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.yaw);
        [self.x + cos * point[0] - sin * point[1], self.y + sin * point[0] + cos * point[1]]
    }

    /// Where `point` (m, in the parent frame) lies in this frame.
    pub fn inverse_transform(&self, point: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.yaw);
        let (dx, dy) = (point[0] - self.x, point[1] - self.y);
        [cos * dx + sin * dy, cos * dy - sin * dx]
    }

    /// The pose in the parent frame of a frame that is given in this one: `parent_from_self * self_from_child`.
    pub fn compose(&self, child: &Pose) -> Pose {
        let [x, y] = self.transform([child.x, child.y]);
        Pose { x, y, yaw: wrap_angle(self.yaw + child.yaw) }
    }
}

/// `angle` (rad) brought to [-pi, pi]. Infinite and NaN angles give NaN.
pub fn wrap_angle(angle: f64) -> f64 {
    if (-PI..=PI).contains(&angle) {
        return angle;
    }
    let turns = libm::round(angle / (2.0 * PI));
    (angle - turns * (2.0 * PI)).clamp(-PI, PI)
}

/// Distance (m) between two points.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(b[0] - a[0], b[1] - a[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_quarter_turn_maps_forward_to_left() {
        let pose = Pose::new(1.0, 2.0, FRAC_PI_2);
        let [x, y] = pose.transform([3.0, 0.0]);
        assert!((x - 1.0).abs() < 1e-15 && (y - 5.0).abs() < 1e-15);
        let [x, y] = pose.inverse_transform([1.0, 5.0]);
        assert!((x - 3.0).abs() < 1e-15 && y.abs() < 1e-15);
    }

    #[test]
    fn angles_are_wrapped_to_half_turns() {
        assert_eq!(wrap_angle(PI), PI);
        assert_eq!(wrap_angle(-PI), -PI);
        assert!((wrap_angle(3.0 * FRAC_PI_2) + FRAC_PI_2).abs() < 1e-15);
        assert!((wrap_angle(-7.0) - (-7.0 + 2.0 * PI)).abs() < 1e-15);
        assert!(wrap_angle(f64::NAN).is_nan());
    }
}
