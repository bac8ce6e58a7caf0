//! Where a robot believes to be: its wheels measure distance and rotation, each with a scale error.

use crate::lidar::draw_normals;
use crate::pose::Pose;
use crate::rng::StreamName;
use crate::robot::Arc;
use serde::{Deserialize, Serialize};

/// A pose that is reckoned from the start on, and drifts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// Pose in the world, as reckoned.
    pub pose: Pose,
    /// Measured over true distance, and measured over true rotation.
    scales: [f64; 2],
}

impl Odometry {
    /// At the start of an episode, where the pose is known. The scale errors are 1 + N(0, `noise`) each, drawn from
    /// `stream` once.
    pub fn new(start: Pose, noise: f64, stream: &StreamName) -> Self {
        let mut normals = [0.0; 64];
        draw_normals(stream, 0, &mut normals);
        Self { pose: start, scales: [0, 1].map(|i| 1.0 + noise * f64::from(normals[i])) }
    }

    /// All its numbers: the pose (m, rad) and the scales.
    pub fn numbers(&self) -> [f64; 5] {
        let (pose, [distance, rotation]) = (self.pose, self.scales);
        [pose.x, pose.y, pose.yaw, distance, rotation]
    }

    /// Adds what was driven: `time` seconds along `arc`.
    pub fn follow(&mut self, arc: &Arc, time: f64) {
        let [distance, rotation] = self.scales;
        self.pose = Arc { start: self.pose, v: distance * arc.v, omega: rotation * arc.omega }.at(time);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Purpose, Split};

    fn stream(robot: u32) -> StreamName {
        StreamName::new(5, Purpose::Odometry, Split::Given, robot, 0)
    }

    #[test]
    fn distance_and_rotation_are_scaled_along_the_way() {
        let mut odometry = Odometry { pose: Pose::new(1.0, 2.0, 0.0), scales: [1.1, 0.5] };
        // 2 m straight on count 2.2 m; a turn of pi on the spot counts pi / 2; then 1 m counts 1.1 m to the left.
        for (v, omega) in [(2.0, 0.0), (0.0, std::f64::consts::PI), (1.0, 0.0)] {
            odometry.follow(&Arc { start: Pose::default(), v, omega }, 1.0);
        }
        let Pose { x, y, yaw } = odometry.pose;
        assert!((x - 3.2).abs() < 1e-12 && (y - 3.1).abs() < 1e-12, "{x} {y}");
        assert!((yaw - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn scale_errors_are_normal_and_named() {
        let draws: Vec<f64> = (0..20_000)
            .flat_map(|robot| Odometry::new(Pose::default(), 0.02, &stream(robot)).scales)
            .map(|scale| (scale - 1.0) / 0.02)
            .collect();
        let n = draws.len() as f64;
        let mean = draws.iter().sum::<f64>() / n;
        let variance = draws.iter().map(|z| z * z).sum::<f64>() / n;
        let product = draws.chunks(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / (n / 2.0);
        // Five standard errors.
        assert!(mean.abs() < 5.0 / n.sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance}");
        assert!(product.abs() < 5.0 / (n / 2.0).sqrt(), "{product}");
        let start = Pose::new(1.0, 2.0, 0.5);
        assert_eq!(Odometry::new(start, 0.02, &stream(3)), Odometry::new(start, 0.02, &stream(3)));
        assert_ne!(Odometry::new(start, 0.02, &stream(3)), Odometry::new(start, 0.02, &stream(4)));
    }
}
