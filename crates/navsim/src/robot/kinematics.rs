//! Differential drive: what a command does to the pose. Commands are constant over a control period, so the robot's
//! centre moves on an exact circular arc.

use crate::config::RobotConfig;
use crate::pose::{Pose, wrap_angle};

/// The command (v m/s, omega rad/s) of an action in [-1, 1]^2; numbers outside are clipped.
pub fn command(action: [f32; 2], robot: &RobotConfig) -> [f64; 2] {
    let [a1, a2] = action.map(|a| f64::from(a).clamp(-1.0, 1.0));
    // Eq. 6: v = v_max (a1 + 1) / 2, omega = omega_max a2
    [robot.v_max * 0.5 * (a1 + 1.0), robot.omega_max * a2]
}

/// `wanted` (v, omega) as far as the acceleration limits let `current` come in `period` seconds.
pub fn limit_acceleration(wanted: [f64; 2], current: [f64; 2], period: f64, robot: &RobotConfig) -> [f64; 2] {
    let approach = |wanted: f64, current: f64, limit: f64| {
        let change = limit * period;
        if limit > 0.0 { wanted.clamp(current - change, current + change) } else { wanted }
    };
    [
        approach(wanted[0], current[0], robot.acceleration_max),
        approach(wanted[1], current[1], robot.angular_acceleration_max),
    ]
}

/// Motion at constant v (m/s) and omega (rad/s) from a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    /// Pose at time 0.
    pub start: Pose,
    /// Forward speed, m/s.
    pub v: f64,
    /// Turning speed, rad/s, counter-clockwise positive.
    pub omega: f64,
}

impl Arc {
    /// Pose after `time` seconds, exact on the circle.
    pub fn at(&self, time: f64) -> Pose {
        let half_turn = 0.5 * self.omega * time;
        // The chord of a circular arc of length s and angle 2h is s sin(h)/h, along the heading in its middle.
        let chord = self.v * time * sinc(half_turn);
        let (sin, cos) = libm::sincos(self.start.yaw + half_turn);
        Pose {
            x: self.start.x + chord * cos,
            y: self.start.y + chord * sin,
            yaw: wrap_angle(self.start.yaw + 2.0 * half_turn),
        }
    }
}

/// sin(x) / x.
fn sinc(x: f64) -> f64 {
    // Below 1e-3 the next term of the series, x^4/120, is under 1e-14.
    if x.abs() < 1e-3 { 1.0 - x * x / 6.0 } else { libm::sin(x) / x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn robot() -> RobotConfig {
        RobotConfig {
            footprint: crate::config::FootprintKind::Disc,
            radius: 0.25,
            length: 0.5,
            width: 0.4,
            v_max: 0.5,
            omega_max: 1.0,
            acceleration_max: 1.0,
            angular_acceleration_max: 2.5,
            delay_steps: 0,
            odometry_noise: 0.0,
        }
    }

    /// Eq. 6 by hand: a1 = -1 stands still, 0 is half speed, 1 full speed; outside [-1, 1] is clipped.
    #[test]
    fn actions_become_commands() {
        assert_eq!(command([-1.0, 0.0], &robot()), [0.0, 0.0]);
        assert_eq!(command([0.0, -0.5], &robot()), [0.25, -0.5]);
        assert_eq!(command([1.0, 1.0], &robot()), [0.5, 1.0]);
        assert_eq!(command([7.0, -7.0], &robot()), [0.5, -1.0]);
    }

    #[test]
    fn acceleration_is_limited_when_a_limit_is_set() {
        let limited = limit_acceleration([0.5, -1.0], [0.0, 0.0], 0.1, &robot());
        assert!((limited[0] - 0.1).abs() < 1e-15 && (limited[1] + 0.25).abs() < 1e-15);
        let free = RobotConfig { acceleration_max: 0.0, angular_acceleration_max: 0.0, ..robot() };
        assert_eq!(limit_acceleration([0.5, -1.0], [0.0, 0.0], 0.1, &free), [0.5, -1.0]);
    }

    #[test]
    fn a_quarter_circle_ends_where_it_should() {
        let arc = Arc { start: Pose::new(1.0, 1.0, 0.0), v: 0.5, omega: 1.0 };
        // Radius v / omega = 0.5: from (1, 1) heading east to (1.5, 1.5) heading north.
        let end = arc.at(FRAC_PI_2);
        assert!((end.x - 1.5).abs() < 1e-12 && (end.y - 1.5).abs() < 1e-12 && (end.yaw - FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn straight_and_nearly_straight_motion_agree() {
        let start = Pose::new(0.0, 0.0, 0.3);
        let straight = Arc { start, v: 0.5, omega: 0.0 }.at(0.1);
        assert!((straight.x - 0.05 * libm::cos(0.3)).abs() < 1e-15);
        for omega in [1e-9, 1e-3, 0.019_99, 0.020_01] {
            let end = Arc { start, v: 0.5, omega }.at(0.1);
            let radius = 0.5 / omega;
            let exact = radius * (libm::sin(0.3 + omega * 0.1) - libm::sin(0.3));
            assert!((end.x - exact).abs() < 1e-16 * radius + 1e-13, "{omega}");
        }
    }

    #[test]
    fn turning_in_place_wraps() {
        let end = Arc { start: Pose::new(0.0, 0.0, 3.0), v: 0.0, omega: 1.0 }.at(1.0);
        assert!(end.x == 0.0 && end.y == 0.0 && (end.yaw - (4.0 - 2.0 * PI)).abs() < 1e-12);
    }
}
