//! The reward of a step: equations 3 and 5, and the progress term.

use super::Outcome;
use crate::config::{RewardConfig, RewardForm, RobotConfig};

/// Below this range (m) of the nearest bin equation 5 takes effect.
const REPULSION_RANGE: f64 = 1.0;

/// What a reward depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// How the step ended.
    pub outcome: Outcome,
    /// Velocity of the step: v (m/s), omega (rad/s).
    pub velocity: [f64; 2],
    /// Nearest bin after the step, m.
    pub nearest: f64,
    /// By how much the goal came nearer in the step, m.
    pub progress: f64,
}

/// The reward that the learner sees, before its scale.
pub fn reward(step: &Step, reward: &RewardConfig, robot: &RobotConfig) -> f64 {
    let [v, omega] = step.velocity;
    let motion = match reward.form {
        RewardForm::Paper => v - omega.abs(),
        RewardForm::Halves => 0.5 * (v / robot.v_max - omega.abs() / robot.omega_max),
    };
    // Eq. 3: r = r_g at the goal, r_c on collision, else v - |omega|
    // Eq. 5: - (1 - nearest) / 2 when the nearest bin is under 1 m
    let immediate = match step.outcome {
        Outcome::Goal => reward.goal,
        Outcome::Collision => reward.collision,
        Outcome::Running | Outcome::Timeout => motion - 0.5 * (REPULSION_RANGE - step.nearest).max(0.0),
    };
    immediate + reward.progress * step.progress
}

/// The paper's own reward, in which returns are reported whatever the learner is trained on: r_g 100, r_c -100, v in
/// m/s, no progress term.
pub fn paper_reward(step: &Step, robot: &RobotConfig) -> f64 {
    let paper = RewardConfig { goal: 100.0, collision: -100.0, form: RewardForm::Paper, progress: 0.0 };
    reward(step, &paper, robot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::FootprintKind;

    fn robot() -> RobotConfig {
        RobotConfig {
            footprint: FootprintKind::Disc,
            radius: 0.25,
            length: 0.5,
            width: 0.4,
            v_max: 0.5,
            omega_max: 2.0,
            acceleration_max: 0.0,
            angular_acceleration_max: 0.0,
            delay_steps: 0,
            odometry_noise: 0.0,
        }
    }

    fn step(outcome: Outcome) -> Step {
        Step { outcome, velocity: [0.4, -0.3], nearest: 0.6, progress: 0.03 }
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-12
    }

    /// Eq. 3 and 5 by hand: 0.4 - 0.3 - (1 - 0.6) / 2 = -0.1.
    #[test]
    fn motion_and_repulsion() {
        let config = RewardConfig { goal: 100.0, collision: -100.0, form: RewardForm::Paper, progress: 0.0 };
        assert!(close(reward(&step(Outcome::Running), &config, &robot()), -0.1));
        assert!(close(reward(&step(Outcome::Timeout), &config, &robot()), -0.1));
        let far = Step { nearest: 1.0, ..step(Outcome::Running) };
        assert!(close(reward(&far, &config, &robot()), 0.1));
        // halves: (0.4 / 0.5 - 0.3 / 2) / 2 - 0.2 = 0.125
        let halves = RewardConfig { form: RewardForm::Halves, ..config };
        assert!(close(reward(&step(Outcome::Running), &halves, &robot()), 0.125));
    }

    #[test]
    fn goal_and_collision_replace_the_motion_term() {
        let config = RewardConfig { goal: 90.0, collision: -445.0, form: RewardForm::Paper, progress: 35.0 };
        assert!(close(reward(&step(Outcome::Goal), &config, &robot()), 90.0 + 1.05));
        assert!(close(reward(&step(Outcome::Collision), &config, &robot()), -445.0 + 1.05));
        assert!(close(paper_reward(&step(Outcome::Goal), &robot()), 100.0));
        assert!(close(paper_reward(&step(Outcome::Collision), &robot()), -100.0));
        assert!(close(paper_reward(&step(Outcome::Running), &robot()), -0.1));
    }
}
