//! Where the robot will be when a command that is given now begins to act: the commands on their way are driven in
//! thought, so that every controller decides for the place and the speed that its command will find.

use crate::config::RobotConfig;
use crate::pose::Pose;
use crate::robot::{Arc, limit_acceleration};
use std::collections::VecDeque;

/// Commands (v m/s, omega rad/s) of a robot that have been given and do not act yet, the next one first.
#[derive(Debug, Clone, Default)]
pub(super) struct Foresight {
    waiting: VecDeque<[f64; 2]>,
}

impl Foresight {
    /// Pose in the robot's frame of now, and velocity, when the commands on their way have been driven. Before its
    /// first command a robot stands.
    pub fn look(&mut self, velocity: [f64; 2], period: f64, robot: &RobotConfig) -> (Pose, [f64; 2]) {
        self.waiting.resize(robot.delay_steps, [0.0; 2]);
        self.waiting.iter().fold((Pose::default(), velocity), |(start, current), &wanted| {
            let [v, omega] = limit_acceleration(wanted, current, period, robot);
            (Arc { start, v, omega }.at(period), [v, omega])
        })
    }

    /// Takes the next command; the first of those on their way acts from now on.
    pub fn give(&mut self, command: [f64; 2]) {
        if self.waiting.pop_front().is_some() {
            self.waiting.push_back(command);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With a delay of two periods of 0.1 s: 0.5 m/s straight on, then 0.5 m/s and 1 rad/s.
    #[test]
    fn commands_on_their_way_are_driven_one_after_the_other() {
        let config = crate::SimConfig::from_json(include_str!("../../tests/defaults.json")).unwrap();
        let robot = RobotConfig { delay_steps: 2, ..config.robot };
        let mut foresight = Foresight::default();
        let (pose, velocity) = foresight.look([0.3, 0.2], 0.1, &robot);
        assert_eq!((pose, velocity), (Pose::default(), [0.0; 2]));
        foresight.give([0.5, 0.0]);
        foresight.give([0.5, 1.0]);
        let (pose, velocity) = foresight.look([0.0; 2], 0.1, &robot);
        assert_eq!(velocity, [0.5, 1.0]);
        let (x, y) = (0.05 + 0.5 * 0.1f64.sin(), 0.5 * (1.0 - 0.1f64.cos()));
        assert!((pose.x - x).abs() < 1e-12 && (pose.y - y).abs() < 1e-12 && (pose.yaw - 0.1).abs() < 1e-12);
        // Within 1 m/s^2 it only comes to 0.1 and then 0.2 m/s.
        let slow = RobotConfig { acceleration_max: 1.0, ..robot };
        let (pose, velocity) = foresight.look([0.0; 2], 0.1, &slow);
        assert_eq!(velocity, [0.2, 1.0]);
        assert!((pose.x - (0.01 + 0.2 * 0.1f64.sin())).abs() < 1e-12);
        // A robot without delay is where it is.
        let (pose, velocity) = Foresight::default().look([0.3, 0.2], 0.1, &RobotConfig { delay_steps: 0, ..slow });
        assert_eq!((pose, velocity), (Pose::default(), [0.3, 0.2]));
    }
}
