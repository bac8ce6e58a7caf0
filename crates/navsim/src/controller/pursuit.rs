//! Regulated pure pursuit (Macenski et al., "Regulated pure pursuit for robot path tracking", 2023; pure pursuit by
//! Coulter, 1992): the arc to a point ahead on the path, slower on tight arcs, near the goal and towards obstacles,
//! before which it stops. It does not avoid.

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
        let way = self.free_way(limits, sight, curvature);
        // What lies beyond the goal does not matter.
        let v = if way < distance { v.min(limits.stopping_speed(way, self.reaction(limits))) } else { v };
        [v, v * curvature]
    }

    /// Time (s) that passes before the robot brakes.
    fn reaction(&self, limits: &Limits) -> f32 {
        limits.period + self.config.stop_time as f32
    }

    /// Way (m) that is free along the arc, as far as it matters. A robot that is within the margin of an obstacle
    /// already drives on where its arc passes everything at half of the clearance that it has, as one that starts
    /// beside a wall.
    fn free_way(&mut self, limits: &Limits, sight: &Sight, curvature: f32) -> f32 {
        let square = sight.scene.points().fold(f32::INFINITY, |least: f32, [x, y]| least.min(x * x + y * y));
        let clearance = (libm::sqrtf(square) - limits.radius).max(0.0);
        let margin = self.config.margin as f32;
        let is_within = clearance < margin;
        let kept = limits.radius + if is_within { 0.5 * clearance } else { margin };
        self.arcs.prepare(sight.scene, kept, limits.stopping_way(limits.v_max, self.reaction(limits)));
        let way = self.arcs.free_way(curvature);
        if is_within && way.is_finite() { 0.0 } else { way }
    }
}
