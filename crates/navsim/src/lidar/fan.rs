//! The directions of the beams.

use crate::config::LidarConfig;
use std::f64::consts::PI;

/// Beams are handled in blocks of this many: one AVX-512 register, two of AVX2, four of the baseline.
pub(crate) const BLOCK: usize = 16;

/// Directions of all beams in the lidar's frame, in blocks; the last block is filled up with the last beam.
#[derive(Debug, Clone)]
pub(crate) struct Fan {
    /// Number of beams.
    pub beams: usize,
    /// Cosine of each beam's angle, padded to whole blocks.
    pub cos: Vec<f32>,
    /// Sine of each beam's angle, padded to whole blocks.
    pub sin: Vec<f32>,
    /// Angle of beam 0, rad.
    pub first_angle: f32,
    /// Beams per radian.
    pub density: f32,
    /// Beams that a full turn would hold.
    pub turn: f32,
}

impl Fan {
    /// The fan of a lidar: beam i at -fov/2 + (i + 1/2) fov/beams, counter-clockwise.
    pub fn new(lidar: &LidarConfig) -> Self {
        let step = lidar.fov / lidar.beams as f64;
        let angles = (0..lidar.beams.next_multiple_of(BLOCK)).map(|i| beam_angle(lidar, i.min(lidar.beams - 1)));
        let (sin, cos) = angles.map(libm::sincos).map(|(sin, cos)| (sin as f32, cos as f32)).unzip();
        Self {
            beams: lidar.beams,
            cos,
            sin,
            first_angle: beam_angle(lidar, 0) as f32,
            density: (1.0 / step) as f32,
            turn: (2.0 * PI / step) as f32,
        }
    }

    /// Number of beams with the padding of the last block.
    pub fn padded(&self) -> usize {
        self.cos.len()
    }
}

/// Angle (rad) of beam `i` in the lidar's frame.
pub fn beam_angle(lidar: &LidarConfig, i: usize) -> f64 {
    -0.5 * lidar.fov + (i as f64 + 0.5) * lidar.fov / lidar.beams as f64
}
