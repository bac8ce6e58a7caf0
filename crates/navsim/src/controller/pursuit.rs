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
