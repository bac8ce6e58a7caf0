//! Contact of the footprint with obstacles anywhere on the arc of a step.

use crate::pose::Pose;
use crate::robot::{Arc, Footprint};
use crate::world::Obstacles;
use serde::{Deserialize, Serialize};

/// Clearances are not followed beyond this distance, m.
pub const CLEARANCE_MAX: f32 = 1000.0;
/// The footprint touches when its clearance is at most this, m: five times the rounding error of a clearance in a 30 m
/// room, a fifth of what is promised.
pub const CONTACT: f32 = 2e-5;
/// The arc is followed in steps of at least this, m, so that sliding along a wall ends; what a step can overlook is
/// less.
const ADVANCE_MIN: f32 = 5e-5;

/// More than clearances and travels may err by rounding, m.
const ROUNDING: f32 = 0.01;

/// What is known of the distance between the footprint and the nearest obstacle. It is measured only when it can
/// matter: what follows from an older measurement lies within `at_least` and `at_most`, but for rounding.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Clearance {
    /// Clearance where it was measured last, m.
    pub measured: f32,
    /// No point of the footprint has moved farther than this since, m: the sum of many steps, in double precision.
    pub driven: f64,
}

impl Clearance {
    /// A clearance (m) that has just been measured.
    pub fn exactly(measured: f32) -> Self {
        Self { measured, driven: 0.0 }
    }

    /// The clearance is not less than this, m.
    pub fn at_least(&self) -> f32 {
        (f64::from(self.measured) - self.driven) as f32
    }

    /// The clearance is not more than this, m.
    pub fn at_most(&self) -> f32 {
        (f64::from(self.measured) + self.driven) as f32
    }

    fn after(&self, travel: f64) -> Self {
        Self { driven: self.driven + travel, ..*self }
    }
}

/// Where the robot is after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sweep {
    /// Pose at the end of the step, or at contact.
    pub pose: Pose,
    /// Time driven, s.
    pub time: f64,
    /// Clearance of the footprint there.
    pub clearance: Clearance,
    /// Whether the footprint touches an obstacle there.
    pub contact: bool,
}

/// Clearance (m) of `footprint` at `pose`: 0 in contact, at most `CLEARANCE_MAX`.
pub fn clearance(footprint: &Footprint, pose: &Pose, obstacles: [&Obstacles; 2]) -> f32 {
    clearance_within(footprint, pose, obstacles, CLEARANCE_MAX)
}

/// As `clearance`, but nothing that is farther away than `limit` (m) is looked at.
fn clearance_within(footprint: &Footprint, pose: &Pose, obstacles: [&Obstacles; 2], limit: f32) -> f32 {
    let pose = [pose.x, pose.y, pose.yaw];
    obstacles.iter().fold(limit, |nearest, obstacles| obstacles.clearance(footprint, pose, nearest))
}

/// The clearance (m) at `pose`, of which something is `known`: most shapes are too far away to be looked at closely.
pub fn measure(footprint: &Footprint, pose: &Pose, obstacles: [&Obstacles; 2], known: &Clearance) -> f32 {
    let farthest = known.at_most();
    let found = clearance_within(footprint, pose, obstacles, CLEARANCE_MAX.min(farthest + ROUNDING));
    // Always so, unless there is nothing within `CLEARANCE_MAX` or coordinates are beyond what single precision holds.
    if found < farthest + 0.5 * ROUNDING { found } else { clearance(footprint, pose, obstacles) }
}

/// Moves `footprint` along `arc` for `period` seconds or until it touches, from a pose whose clearance is known as
/// `at_start`. The clearance at the end is not measured if it is certainly more than `enough` (m, >= 0).
///
/// Conservative advancement: no point of the footprint moves farther than |v| + reach |omega| per second, so from a
/// clearance c it is safe to go on for c / speed. A contact is reported if the clearance along the exact arc falls
/// under zero by more than 1e-4 m, and none if it stays above 1e-4 m, at any speed and for walls of any thickness.
pub fn sweep(
    footprint: &Footprint,
    arc: &Arc,
    period: f64,
    obstacles: [&Obstacles; 2],
    at_start: Clearance,
    enough: f32,
) -> Sweep {
    let speed = arc.v.abs() + footprint.turning_reach() * arc.omega.abs();
    let after = at_start.after(speed * period);
    if after.at_least() > enough + ROUNDING {
        return Sweep { pose: arc.at(period), time: period, clearance: after, contact: false };
    }
    let measure = |pose: &Pose, known: Clearance| measure(footprint, pose, obstacles, &known);
    let safe_time = |gap: f32| f64::from(gap.max(ADVANCE_MIN)) / speed.max(f64::MIN_POSITIVE);
    let mut gap = at_start;
    let certain = gap.at_least() - ROUNDING;
    if gap.driven > 0.0 && (certain <= 0.0 || safe_time(certain) < period) {
        gap = Clearance::exactly(measure(&arc.start, gap));
    }
    let mut time = 0.0;
    let mut pose = arc.start;
    while gap.at_least() > CONTACT {
        let safe = safe_time(gap.at_least());
        if time + safe >= period {
            pose = arc.at(period);
            let clearance = measure(&pose, gap.after(speed * (period - time)));
            return Sweep {
                pose,
                time: period,
                clearance: Clearance::exactly(clearance),
                contact: clearance <= CONTACT,
            };
        }
        time += safe;
        pose = arc.at(time);
        gap = Clearance::exactly(measure(&pose, gap.after(speed * safe)));
    }
    Sweep { pose, time, clearance: gap, contact: true }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Shape;

    fn wall(a: [f64; 2], b: [f64; 2]) -> Obstacles {
        Obstacles::new(&[Shape::Segment { a, b }])
    }

    const DISC: Footprint = Footprint::Disc { radius: 0.25 };

    fn drive(footprint: &Footprint, arc: Arc, obstacles: &Obstacles) -> Sweep {
        let none = Obstacles::default();
        let start = clearance(footprint, &arc.start, [obstacles, &none]);
        sweep(footprint, &arc, 0.1, [obstacles, &none], Clearance::exactly(start), f32::INFINITY)
    }

    #[test]
    fn a_disc_stops_at_the_wall() {
        let arc = Arc { start: Pose::new(0.0, 0.0, 0.0), v: 10.0, omega: 0.0 };
        let end = drive(&DISC, arc, &wall([0.75, -5.0], [0.75, 5.0]));
        assert!(end.contact);
        // Contact when the centre is 0.25 m from the wall: x = 0.5, after 0.05 s.
        assert!((end.pose.x - 0.5).abs() < 1e-4 && (end.time - 0.05).abs() < 1e-5, "{end:?}");
    }

    #[test]
    fn nothing_is_tunnelled_at_100_m_per_s() {
        let arc = Arc { start: Pose::new(0.0, 0.0, 0.0), v: 100.0, omega: 0.0 };
        let end = drive(&DISC, arc, &wall([5.0, -1.0], [5.0, 1.0]));
        assert!(end.contact && (end.pose.x - 4.75).abs() < 1e-4);
    }

    #[test]
    fn the_arc_and_not_its_chord_is_swept() {
        // A half circle of radius 1 about (0, 1) from (0, 0) to (0, 2): its chord passes x = 0, its arc x = 1.
        let omega = std::f64::consts::PI / 0.1;
        let arc = Arc { start: Pose::new(0.0, 0.0, 0.0), v: omega, omega };
        let beside = |x: f64| wall([x, 0.5], [x, 1.5]);
        assert!(drive(&DISC, arc, &beside(1.25 - 2e-4)).contact);
        assert!(!drive(&DISC, arc, &beside(1.25 + 2e-4)).contact);
        assert!(!drive(&DISC, arc, &beside(0.1)).contact);
    }

    #[test]
    fn a_rectangle_turning_in_place_meets_what_its_corner_meets() {
        let rectangle = Footprint::Rectangle { length: 0.8, width: 0.4 };
        let corner = libm::hypot(0.4, 0.2);
        let quarter = Arc { start: Pose::new(0.0, 0.0, 0.0), v: 0.0, omega: 0.5 * std::f64::consts::PI / 0.1 };
        assert!(drive(&rectangle, quarter, &wall([-1.0, corner - 2e-4], [1.0, corner - 2e-4])).contact);
        assert!(!drive(&rectangle, quarter, &wall([-1.0, corner + 2e-4], [1.0, corner + 2e-4])).contact);
    }

    #[test]
    fn sliding_along_a_wall_ends() {
        let arc = Arc { start: Pose::new(0.0, 0.25 + 4e-5, 0.0), v: 0.5, omega: 0.0 };
        assert!(!drive(&DISC, arc, &wall([-1.0, 0.0], [1.0, 0.0])).contact);
        let standing = Arc { v: 0.0, ..arc };
        let end = drive(&DISC, standing, &wall([-1.0, 0.0], [1.0, 0.0]));
        assert!(!end.contact && end.pose == arc.start && end.time == 0.1);
    }
}
