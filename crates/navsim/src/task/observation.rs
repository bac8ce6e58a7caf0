//! What the robot knows: the public observation of equation 2.

use crate::config::RobotConfig;
use crate::pose::Pose;

/// Numbers of an observation besides the bins: goal distance, goal angle, previous v, previous omega.
pub const EXTRA: usize = 4;

/// The goal as the robot sees it: distance (m) and angle (rad, in [-pi, pi], counter-clockwise from straight ahead).
pub fn goal_in_robot(pose: &Pose, goal: [f64; 2]) -> [f64; 2] {
    let [ahead, left] = pose.inverse_transform(goal);
    [libm::hypot(ahead, left), libm::atan2(left, ahead)]
}

/// Writes the numbers behind the bins: goal distance (m), goal angle (rad), and the command of the step just made as
/// shares of the limits, v / v_max in [0, 1] and omega / omega_max in [-1, 1].
pub fn write_extra(goal_polar: [f64; 2], velocity: [f64; 2], robot: &RobotConfig, extra: &mut [f32]) {
    // Eq. 2: s = (20 bins, goal distance, goal angle, previous action)
    let values = [goal_polar[0], goal_polar[1], velocity[0] / robot.v_max, velocity[1] / robot.omega_max];
    for (place, value) in extra.iter_mut().zip(values) {
        *place = value as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn the_goal_in_polar_coordinates() {
        let pose = Pose::new(1.0, 1.0, FRAC_PI_2);
        let check = |goal, distance: f64, angle: f64| {
            let [d, a] = goal_in_robot(&pose, goal);
            assert!((d - distance).abs() < 1e-12 && (a - angle).abs() < 1e-12, "{goal:?}: {d} {a}");
        };
        check([1.0, 3.0], 2.0, 0.0);
        check([-1.0, 1.0], 2.0, FRAC_PI_2);
        check([2.0, 1.0], 1.0, -FRAC_PI_2);
        let [_, behind] = goal_in_robot(&Pose::new(0.0, 0.0, 0.0), [-1.0, 0.0]);
        assert_eq!(behind.abs(), PI);
    }
}
