//! Regulated pure pursuit (Macenski et al., "Regulated pure pursuit for robot path tracking", 2023; pure pursuit by
//! Coulter, 1992): the arc to a point ahead on the path, slower on tight arcs, near the goal and towards obstacles.
//! Where an obstacle stands on the arc it takes the nearest arc beside it, and stops if there is none.

use super::scene::{Arcs, wrap};
use super::settings::PursuitConfig;
use super::{Limits, Sight};

/// Angle (rad) between the arcs that are tried beside a blocked one.
const DETOUR_STEP: f32 = 0.1;

/// The controller, with the memory that it works in.
#[derive(Debug, Clone)]
pub(super) struct Pursuit {
    config: PursuitConfig,
    arcs: Arcs,
    /// Whether an obstacle is within the margin now.
    is_within: bool,
}

impl Pursuit {
    pub fn new(config: &PursuitConfig) -> Self {
        Self { config: config.clone(), arcs: Arcs::default(), is_within: false }
    }

    /// Towards the goal of `sight`, which is a point ahead on a path, or its end: to it, or else to the nearest direction
    /// beside it that is free as far, on an arc or, where that is not or too tight, after a turn on the spot.
    pub fn command(&mut self, limits: &Limits, sight: &Sight) -> [f32; 2] {
        self.look(limits, sight);
        let (angle, distance) = (sight.goal_angle, sight.goal_distance.max(1e-3));
        let tried = (self.config.detour as f32 / DETOUR_STEP) as i32;
        let sides = (1..=tried).flat_map(|k| [k, -k]);
        for direction in std::iter::once(0).chain(sides).map(|k| angle + k as f32 * DETOUR_STEP) {
            if !self.is_sharp(direction) {
                let (command, way) = self.arc(limits, distance, direction);
                if way >= distance {
                    return command;
                }
            }
            // What it does not see may be full: it would turn there, see, and turn back.
            let is_seen = wrap(direction - sight.middle).abs() <= sight.half_fov;
            if tried > 0 && is_seen && self.arcs.free_way_after_turn(direction) >= distance {
                return self.turn(direction);
            }
        }
        if self.is_sharp(angle) { self.turn(angle) } else { self.arc(limits, distance, angle).0 }
    }

    /// Whether an angle is turned away on the spot.
    fn is_sharp(&self, angle: f32) -> bool {
        angle.abs() > self.config.turn_in_place as f32
    }

    /// On the spot to an angle.
    fn turn(&self, angle: f32) -> [f32; 2] {
        [0.0, self.config.turn_gain as f32 * angle]
    }

    /// The command for the arc through the point at a distance (m) and an angle, and the way (m) that is free on it.
    fn arc(&self, limits: &Limits, distance: f32, angle: f32) -> ([f32; 2], f32) {
        let config = &self.config;
        // Coulter: the arc through a point at distance L and angle a has curvature 2 sin(a) / L.
        let curvature = 2.0 * libm::sinf(angle) / distance;
        let tight = (config.radius_min as f32 * curvature.abs()).max(1.0);
        let near = if distance < config.approach as f32 { distance / config.approach as f32 } else { 1.0 };
        let slowed = (limits.v_max / tight * near).max(config.v_min as f32).min(limits.v_max);
        // Eq. 6's limit on omega, on the arc.
        let turning = if curvature == 0.0 { f32::INFINITY } else { limits.omega_max / curvature.abs() };
        let v = slowed.min(turning);
        let way = self.arcs.free_way(curvature);
        let way =
            if self.is_within && way <= limits.stopping_way(limits.v_max, self.reaction(limits)) { 0.0 } else { way };
        // What lies beyond the goal does not matter.
        let v = if way < distance { v.min(limits.stopping_speed(way, self.reaction(limits))) } else { v };
        ([v, v * curvature], way)
    }

    /// Time (s) that passes before the robot brakes.
    fn reaction(&self, limits: &Limits) -> f32 {
        limits.period + self.config.stop_time as f32
    }

    /// Prepares the points that matter. A robot that is within the margin of an obstacle already drives on where its
    /// arc passes everything at half of the clearance that it has, as one that starts beside a wall.
    fn look(&mut self, limits: &Limits, sight: &Sight) {
        let square = sight.scene.points().fold(f32::INFINITY, |least: f32, [x, y]| least.min(x * x + y * y));
        let clearance = (libm::sqrtf(square) - limits.radius).max(0.0);
        let margin = self.config.margin as f32;
        self.is_within = clearance < margin;
        let kept = limits.radius + if self.is_within { 0.5 * clearance } else { margin };
        let reach = limits.stopping_way(limits.v_max, self.reaction(limits)).max(sight.goal_distance);
        self.arcs.prepare(sight.scene, kept, reach);
    }
}
