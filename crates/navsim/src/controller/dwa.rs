//! The dynamic window (Fox, Burgard and Thrun, "The dynamic window approach to collision avoidance", 1997): of the
//! commands that can be reached in a period, and from which the robot can stop in time, the best by heading, clearance
//! and speed.

use super::scene::{Arcs, wrap};
use super::settings::DwaConfig;
use super::{Limits, Sight};
use std::f32::consts::PI;

impl DwaConfig {
    /// The original weights: 2 for the heading and 0.2 for the speed, each in [0, 1], and 0.2 for the free way, in
    /// metres as far as the lidar sees (`range_max`). Shares of a way would let the robot turn 18 degrees from its goal
    /// at most. The window is that of the original interval, 0.25 s; the heading is judged after 1 s. The rest is as it
    /// was.
    pub(super) fn of_1997(self, range_max: f64) -> Self {
        let (clearance, clearance_max) = (0.2 * range_max, range_max);
        Self { heading: 2.0, clearance, speed: 0.2, horizon: 1.0, clearance_max, interval: 0.25, ..self }
    }
}

/// The controller, with the memory that it works in.
#[derive(Debug, Clone)]
pub(super) struct Dwa {
    config: DwaConfig,
    arcs: Arcs,
}

/// Commands that the robot can reach within the interval.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Window {
    /// Smallest and largest forward speed, m/s.
    pub v: [f32; 2],
    /// Smallest and largest turning speed, rad/s.
    pub omega: [f32; 2],
}

impl Window {
    /// What the acceleration limits leave of the rectangle [0, v_max] x [-omega_max, omega_max] in `interval` seconds;
    /// a limit of 0 is none.
    pub fn new(limits: &Limits, [v, omega]: [f32; 2], interval: f32) -> Self {
        let reachable = |now: f32, acceleration: f32, least: f32, most: f32| {
            let change = if acceleration > 0.0 { acceleration * interval } else { f32::INFINITY };
            [(now - change).clamp(least, most), (now + change).clamp(least, most)]
        };
        Self {
            v: reachable(v, limits.acceleration, 0.0, limits.v_max),
            omega: reachable(omega, limits.angular_acceleration, -limits.omega_max, limits.omega_max),
        }
    }
}

/// Whether the robot can still stop on a free way (m).
fn admissible(limits: &Limits, v: f32, way: f32, reaction: f32) -> bool {
    v == 0.0 || limits.stopping_way(v, reaction) <= way
}

impl Dwa {
    pub fn new(config: &DwaConfig) -> Self {
        Self { config: config.clone(), arcs: Arcs::default() }
    }

    /// The best admissible command, of which a period drives what the limits allow; if none is, the slowest one with
    /// the longest free way.
    pub fn command(&mut self, limits: &Limits, sight: &Sight) -> [f32; 2] {
        let DwaConfig { v_samples, omega_samples, .. } = self.config;
        let Window { v: [v_low, v_high], omega: [omega_low, omega_high] } =
            Window::new(limits, sight.velocity, self.config.interval as f32);
        // What lies beyond the goal does not matter.
        let reach = (self.config.clearance_max as f32).min(sight.goal_distance).max(1e-3);
        let reaction = self.config.reaction as f32;
        let farthest = reach.max(limits.stopping_way(v_high, reaction));
        self.arcs.prepare(sight.scene, limits.radius + self.config.margin as f32, farthest);
        let mut best = (f32::NEG_INFINITY, [0.0; 2]);
        let mut slowest = (f32::NEG_INFINITY, [v_low, 0.0]);
        for i in 0..v_samples {
            let v = sample(v_low, v_high, i, v_samples);
            for j in 0..omega_samples {
                let omega = sample(omega_low, omega_high, j, omega_samples);
                let way = self.free_way([v, omega]);
                if i == 0 && way > slowest.0 {
                    slowest = (way, [v, omega]);
                }
                if admissible(limits, v, way, reaction) {
                    let value = self.objective(limits, sight, [v, omega], way.min(reach) / reach);
                    if value > best.0 {
                        best = (value, [v, omega]);
                    }
                }
            }
        }
        if best.0 == f32::NEG_INFINITY { slowest.1 } else { best.1 }
    }

    /// Way (m) that is free along the arc of a command; of a turn in place, which is always admissible, the way
    /// straight ahead at the horizon. (To call that endless, as one may read the original, makes standing still
    /// attractive.)
    fn free_way(&self, [v, omega]: [f32; 2]) -> f32 {
        if v > 0.0 {
            self.arcs.free_way(omega / v)
        } else {
            self.arcs.free_way_after_turn(omega * self.config.horizon as f32)
        }
    }

    fn objective(&self, limits: &Limits, sight: &Sight, [v, omega]: [f32; 2], clearance: f32) -> f32 {
        let DwaConfig { heading, clearance: clearance_weight, speed, horizon, .. } = self.config;
        // Half the way to the goal at most: beyond it the goal would lie behind.
        let time = (horizon as f32).min(0.5 * sight.goal_distance / v.max(1e-6));
        let half_turn = 0.5 * omega * time;
        let (sin, cos) = libm::sincosf(half_turn);
        let chord = v * time * if half_turn.abs() < 1e-3 { 1.0 } else { sin / half_turn };
        let [x, y] = sight.goal;
        let bearing = libm::atan2f(y - chord * sin, x - chord * cos);
        let off = wrap(bearing - 2.0 * half_turn).abs();
        heading as f32 * (1.0 - off / PI) + clearance_weight as f32 * clearance + speed as f32 * v / limits.v_max
    }
}

/// Sample `i` of `count` from `low` to `high`, both included.
fn sample(low: f32, high: f32, i: usize, count: usize) -> f32 {
    let share = i as f32 / (count - 1) as f32;
    low + (high - low) * share
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(acceleration: f32, angular_acceleration: f32) -> Limits {
        Limits { radius: 0.25, v_max: 0.5, omega_max: 1.0, acceleration, angular_acceleration, period: 0.1 }
    }

    /// 1 m/s^2 and 2.5 rad/s^2 for 0.1 s: 0.1 m/s and 0.25 rad/s to either side, within the rectangle.
    #[test]
    fn the_window_by_hand() {
        let close = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6;
        let window = Window::new(&limits(1.0, 2.5), [0.45, -0.9], 0.1);
        assert!(close(window.v, [0.35, 0.5]) && close(window.omega, [-1.0, -0.65]), "{window:?}");
        // Twice the time, twice the change.
        let window = Window::new(&limits(1.0, 2.5), [0.1, 0.2], 0.2);
        assert!(close(window.v, [0.0, 0.3]) && close(window.omega, [-0.3, 0.7]), "{window:?}");
        assert_eq!(Window::new(&limits(0.0, 0.0), [0.45, -0.9], 0.1), Window { v: [0.0, 0.5], omega: [-1.0, 1.0] });
        // A speed beyond the limits still gives a window within them.
        let window = Window::new(&limits(1.0, 2.5), [0.9, 0.0], 0.1);
        assert_eq!(window.v, [0.5, 0.5]);
    }

    /// At 0.5 m/s, 0.1 s of reaction are 0.05 m and braking at 1 m/s^2 takes 0.125 m.
    #[test]
    fn the_braking_rule_by_hand() {
        let (slow, sudden) = (limits(1.0, 2.5), limits(0.0, 0.0));
        assert!(admissible(&slow, 0.5, 0.1751, 0.1) && !admissible(&slow, 0.5, 0.1749, 0.1));
        assert!(admissible(&sudden, 0.5, 0.0501, 0.1) && !admissible(&sudden, 0.5, 0.0499, 0.1));
        assert!(admissible(&slow, 0.0, 0.0, 0.1));
    }

    #[test]
    fn samples_include_both_ends() {
        let samples: Vec<f32> = (0..5).map(|i| sample(-1.0, 1.0, i, 5)).collect();
        assert_eq!(samples, [-1.0, -0.5, 0.0, 0.5, 1.0]);
    }
}
