//! What the benches share: the configuration of the paper's robot in a built-in world.

use navsim::config::*;

/// The default robot, lidar and task in the world `name`, with `beams` beams and noise of `noise` metres.
pub fn config(name: &str, beams: usize, noise: f64) -> SimConfig {
    SimConfig {
        world: WorldConfig {
            name: name.into(),
            boxes: 8,
            random_yaw: true,
            goal_range_start: 10.0,
            goal_range_growth: 0.004,
            goal_range_max: 10.0,
        },
        robot: RobotConfig {
            footprint: FootprintKind::Disc,
            radius: 0.25,
            length: 0.5,
            width: 0.4,
            v_max: 0.5,
            omega_max: 1.0,
            acceleration_max: 0.0,
            angular_acceleration_max: 0.0,
        },
        lidar: LidarConfig {
            beams,
            fov: std::f64::consts::PI,
            range_min: 0.0,
            range_max: 10.0,
            noise,
            mount: [0.0; 3],
            bins: 20.min(beams),
            caster: Caster::Auto,
        },
        task: TaskConfig {
            period: 0.1,
            time_limit: 50.0,
            goal_radius: 0.3,
            collision: CollisionRule::Footprint,
            sensor_range: 0.35,
        },
        reward: RewardConfig { goal: 100.0, collision: -445.0, form: RewardForm::Paper, progress: 35.0 },
    }
}
