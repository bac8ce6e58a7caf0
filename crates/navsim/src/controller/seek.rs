//! Looking for a goal that is not where the robot believes it to be. Odometry drifts: a robot may stand where it thinks
//! the goal is, and nothing tells it that it has arrived. It then drives around that place in a widening spiral until
//! its goal circle touches the true one.

use crate::pose::distance;
use std::f64::consts::TAU;

/// Nearer than this share of the goal's radius (m / m) the goal would have been reached, were it there.
const NEAR: f64 = 1.0 / 3.0;
/// Time (s) so near, in all, after which the robot knows that the goal is elsewhere.
const DOUBT: f64 = 0.5;
/// Angle (rad) about the believed goal by which the point that is pursued lies ahead, on the tangent.
const AHEAD: f64 = 0.8;
/// By how many radii of the goal the spiral widens in a turn: less than the two that would leave nothing out if robots
/// followed it exactly.
const PITCH: f64 = 1.2;
/// Time (s) without driving after which the spiral is followed the other way round: something stands in the way.
const PATIENCE: f64 = 2.0;
/// Slower than this share of v_max is not driving.
const DRIVING: f64 = 0.1;

/// What a robot remembers of its goal.
#[derive(Debug, Clone, Default)]
pub(super) struct Seek {
    /// Distance (m) of the goal in the last decision.
    last: f64,
    /// Time (s) spent near the believed goal.
    near: f64,
    /// Angle (rad) driven about the believed goal.
    swept: f64,
    /// Time (s) for which the robot has not been driving.
    standing: f64,
    clockwise: bool,
}

/// What the search depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seeker {
    /// Radius of the goal circle, m.
    pub radius: f64,
    pub v_max: f64,
    /// Control period, s.
    pub period: f64,
}

impl Seek {
    /// Where to drive (m, in the robot's frame) for a goal that is believed to lie at `goal`: there, and once the robot
    /// has been there in vain, ahead on a spiral around it. A goal that jumps is another one.
    pub fn target(&mut self, goal: [f64; 2], v: f64, by: &Seeker) -> [f64; 2] {
        let away = distance([0.0; 2], goal);
        if (away - self.last).abs() > 2.0 * by.v_max * by.period + NEAR * by.radius {
            *self = Self::default();
        }
        self.last = away;
        if self.near < DOUBT {
            self.near += if away < NEAR * by.radius { by.period } else { 0.0 };
            return goal;
        }
        // The first turn is as tight as the robot can drive.
        let spiral = by.radius * (1.0 + PITCH * (self.swept / TAU - 1.0).max(0.0));
        self.swept += v.max(0.0) * by.period / spiral.max(away);
        self.standing = if v < DRIVING * by.v_max { self.standing + by.period } else { 0.0 };
        if self.standing > PATIENCE {
            (self.standing, self.clockwise) = (0.0, !self.clockwise);
        }
        let ahead = if self.clockwise { -AHEAD } else { AHEAD };
        // From the goal, the robot lies in the opposite direction.
        let direction = libm::atan2(-goal[1], -goal[0]) + ahead;
        let (sin, cos) = libm::sincos(direction);
        let reach = spiral / libm::cos(AHEAD);
        [goal[0] + reach * cos, goal[1] + reach * sin]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose;
    use crate::robot::Arc;

    const BY: Seeker = Seeker { radius: 0.3, v_max: 0.5, period: 0.1 };

    /// Drives from (-1, 0) to the point that is given, turning by 1 rad/s at most; where the robot was, step by step.
    fn drive(steps: usize, mut blocked: impl FnMut(&Pose) -> bool) -> Vec<Pose> {
        let (mut seek, mut pose, mut v) = (Seek::default(), Pose::new(-1.0, 0.0, 0.0), 0.0);
        let mut places = Vec::new();
        for _ in 0..steps {
            let [x, y] = seek.target(pose.inverse_transform([0.0, 0.0]), v, &BY);
            let omega = (2.0 * libm::atan2(y, x)).clamp(-1.0, 1.0);
            v = if blocked(&pose) || x < 0.0 { 0.0 } else { 0.5 };
            pose = Arc { start: pose, v, omega }.at(0.1);
            places.push(pose);
        }
        places
    }

    /// Every place within three radii of the believed goal comes within the goal's radius of the robot.
    #[test]
    fn the_spiral_finds_a_goal_all_around() {
        let places = drive(600, |_| false);
        for bearing in 0..24 {
            for offset in [0.35, 0.5, 0.7, 0.9, 1.1] {
                let (sin, cos) = libm::sincos(f64::from(bearing) * std::f64::consts::PI / 12.0);
                let goal = [offset * cos, offset * sin];
                let nearest = places.iter().map(|p| distance([p.x, p.y], goal)).fold(f64::INFINITY, f64::min);
                assert!(nearest < 0.3, "{offset} m at {bearing}/24: {nearest}");
            }
        }
    }

    #[test]
    fn until_it_has_been_there_the_goal_is_the_goal() {
        let mut seek = Seek::default();
        for _ in 0..5 {
            assert_eq!(seek.target([0.05, 0.0], 0.5, &BY), [0.05, 0.0]);
        }
        let [x, y] = seek.target([0.05, 0.0], 0.5, &BY);
        // The robot lies behind the goal as that sees it: 0.8 rad on from there, where the tangent of 0.3 m ends.
        assert!((x - (0.05 - 0.3)).abs() < 1e-9 && (y + 0.3 * 0.8f64.tan()).abs() < 1e-9, "{x} {y}");
        // Another goal is no matter of the last one.
        assert_eq!(seek.target([4.0, 1.0], 0.5, &BY), [4.0, 1.0]);
        assert_eq!(seek.target([3.95, 1.0], 0.5, &BY), [3.95, 1.0]);
    }

    /// A wall at y > 0.3 lets nothing pass: turned back there, the robot has still been on both sides of it.
    #[test]
    fn what_stands_in_the_way_turns_the_search_back() {
        let places = drive(600, |pose| pose.y > 0.3 && libm::sin(pose.yaw) > 0.0);
        let around = |low: f64, high: f64| {
            places.iter().any(|p| {
                let bearing = libm::atan2(p.y, p.x);
                distance([p.x, p.y], [0.0; 2]) > 0.3 && (low..high).contains(&bearing)
            })
        };
        assert!(around(0.0, 1.0) && around(-1.0, 0.0) && around(-3.0, -2.0) && around(2.0, 3.0));
    }
}
