//! The artificial potential field (Khatib, "Real-time obstacle avoidance for manipulators and mobile robots", 1986):
//! the goal pulls, what the beams meet pushes. Where both cancel, the robot stands: its local minima are known.

use super::settings::ApfConfig;
use super::{Limits, Sight};

/// Nearest clearance (m) that the repulsion knows.
const CLEARANCE_MIN: f32 = 0.01;

/// Force in the robot's frame: attraction of size 1, and the repulsion of every beam for the angle that it stands for.
pub(super) fn force(config: &ApfConfig, limits: &Limits, sight: &Sight) -> [f32; 2] {
    let (sin, cos) = libm::sincosf(sight.goal_angle);
    let (repulsion, reach) = (config.repulsion as f32, config.reach as f32);
    sight.scene.points().fold([cos, sin], |[ahead, left], [x, y]| {
        let distance = libm::sqrtf(x * x + y * y);
        let clearance = (distance - limits.radius).max(CLEARANCE_MIN);
        if clearance >= reach || distance == 0.0 {
            return [ahead, left];
        }
        // -grad of 1/2 (1/d - 1/reach)^2
        let push = repulsion * sight.increment * (1.0 / clearance - 1.0 / reach) / (clearance * clearance);
        [ahead - push * x / distance, left - push * y / distance]
    })
}

/// Turns to the force; drives as far as the force is large and ahead.
pub(super) fn command(config: &ApfConfig, limits: &Limits, sight: &Sight) -> [f32; 2] {
    let [ahead, left] = force(config, limits, sight);
    let (size, angle) = (libm::sqrtf(ahead * ahead + left * left), libm::atan2f(left, ahead));
    let cos = if size > 0.0 { ahead / size } else { 0.0 };
    [limits.v_max * size.min(1.0) * cos.max(0.0), config.turn_gain as f32 * angle]
}
