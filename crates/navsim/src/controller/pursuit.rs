//! Regulated pure pursuit (Macenski et al., "Regulated pure pursuit for robot path tracking", 2023; pure pursuit by
//! Coulter, 1992): the arc to a point ahead on the path, slower on tight arcs and near the goal, and a stop before
//! obstacles. It does not avoid.

use super::scene::Arcs;
use super::settings::PursuitConfig;
use super::{Limits, Sight};

/// The controller, with the memory that it works in.
#[derive(Debug, Clone)]
pub(super) struct Pursuit {
    config: PursuitConfig,
    arcs: Arcs,
}

impl Pursuit {
    pub fn new(config: &PursuitConfig) -> Self {
        Self { config: config.clone(), arcs: Arcs::default() }
    }

    /// Towards the goal of `sight`, which is a point ahead on a path, or its end.
    pub fn command(&mut self, limits: &Limits, sight: &Sight) -> [f32; 2] {
        let config = &self.config;
        if sight.goal_angle.abs() > config.turn_in_place as f32 {
            return [0.0, config.turn_gain as f32 * sight.goal_angle];
        }
        // Coulter: the arc through a point at distance L and angle a has curvature 2 sin(a) / L.
        let distance = sight.goal_distance.max(1e-3);
        let curvature = 2.0 * libm::sinf(sight.goal_angle) / distance;
        let tight = (config.radius_min as f32 * curvature.abs()).max(1.0);
        let near = if distance < config.approach as f32 { distance / config.approach as f32 } else { 1.0 };
        let slowed = (limits.v_max / tight * near).max(config.v_min as f32).min(limits.v_max);
        // Eq. 6's limit on omega, on the arc.
        let turning = if curvature == 0.0 { f32::INFINITY } else { limits.omega_max / curvature.abs() };
        let v = slowed.min(turning);
        let reach = limits.v_max * config.stop_time as f32 + limits.v_max * limits.period;
        self.arcs.prepare(sight.scene, limits.radius + config.margin as f32, reach);
        // The way left once the period is over must last for `stop_time`, or end at the goal.
        let way = self.arcs.free_way(curvature) - v * limits.period;
        if way < (v * config.stop_time as f32).min(distance) { [0.0, 0.0] } else { [v, v * curvature] }
    }
}

/// The point of a path that is pursued, in polar coordinates (m, rad): the first after the path's nearest point to the
/// robot that lies `lookahead` metres from the robot, or the path's end where that is nearer.
///
/// `path` holds points (m) in the robot's frame, at least one.
pub fn lookahead_point(path: &[[f64; 2]], lookahead: f64) -> [f64; 2] {
    let (mut nearest, mut first, mut from) = (f64::INFINITY, 0, path[0]);
    for (i, pair) in path.windows(2).enumerate() {
        let foot = nearest_on(pair[0], pair[1]);
        let distance = libm::hypot(foot[0], foot[1]);
        if distance < nearest {
            (nearest, first, from) = (distance, i, foot);
        }
    }
    let mut target = path[path.len() - 1];
    for &to in path.iter().skip(first + 1) {
        if libm::hypot(to[0], to[1]) >= lookahead {
            target = crossing(from, to, lookahead);
            break;
        }
        from = to;
    }
    [libm::hypot(target[0], target[1]), libm::atan2(target[1], target[0])]
}

/// The point of a segment that is nearest to the origin.
fn nearest_on(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let square = dx * dx + dy * dy;
    let share = if square > 0.0 { (-(a[0] * dx + a[1] * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
    [a[0] + share * dx, a[1] + share * dy]
}

/// Where the segment from `a` to `b`, which ends outside, leaves the circle of `radius` about the origin; `a` if that
/// lies outside too.
fn crossing(a: [f64; 2], b: [f64; 2], radius: f64) -> [f64; 2] {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    // |a + t d|^2 = radius^2
    let (square, half, rest) = (dx * dx + dy * dy, a[0] * dx + a[1] * dy, a[0] * a[0] + a[1] * a[1] - radius * radius);
    if rest >= 0.0 || square == 0.0 {
        return a;
    }
    let t = (libm::sqrt(half * half - square * rest) - half) / square;
    [a[0] + t * dx, a[1] + t * dy]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: [f64; 2], b: [f64; 2]) -> bool {
        (a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12
    }

    #[test]
    fn the_point_ahead_by_hand() {
        // Straight on: at the look-ahead distance itself.
        assert!(close(lookahead_point(&[[-1.0, 0.0], [5.0, 0.0]], 0.6), [0.6, 0.0]));
        // A path 0.3 m to the left: 0.4 m along it, at 0.5 m.
        let [distance, angle] = lookahead_point(&[[-1.0, 0.3], [5.0, 0.3]], 0.5);
        assert!(close([distance, angle], [0.5, libm::atan2(0.3, 0.4)]));
        // Round a corner: 0.8 m up from (0.6, 0) is 1 m away.
        let [distance, angle] = lookahead_point(&[[0.0, 0.0], [0.6, 0.0], [0.6, 3.0]], 1.0);
        assert!(close([distance, angle], [1.0, libm::atan2(0.8, 0.6)]));
        // The end is nearer.
        assert!(close(lookahead_point(&[[0.0, 0.0], [0.4, 0.0]], 1.0), [0.4, 0.0]));
        // Far off the path: its nearest point.
        assert!(close(lookahead_point(&[[-1.0, 2.0], [5.0, 2.0]], 0.5), [2.0, std::f64::consts::FRAC_PI_2]));
        // One point, and one that stands twice.
        assert!(close(lookahead_point(&[[0.0, 2.0]], 0.5), [2.0, std::f64::consts::FRAC_PI_2]));
        assert!(close(lookahead_point(&[[2.0, 0.0], [2.0, 0.0]], 0.5), [2.0, 0.0]));
    }

    /// What lies behind the robot on a path that comes back is not pursued.
    #[test]
    fn the_path_behind_is_left_behind() {
        let [distance, angle] = lookahead_point(&[[-3.0, 0.0], [0.0, 0.0], [0.0, 3.0]], 1.0);
        assert!(close([distance, angle], [1.0, std::f64::consts::FRAC_PI_2]));
    }
}
