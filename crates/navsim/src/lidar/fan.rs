//! The directions and reach of the beams, and which of them an interval of angles covers.

use crate::config::LidarConfig;
use crate::cpu::whole;
use crate::world::{BLOCK, Lanes};
use std::f32::consts::{FRAC_PI_2, PI};

/// Half width (rad) of the band by which an interval of beams is widened: twice the error of `angle`. The exact test of
/// each beam decides; the interval only saves work.
pub(crate) const GUARD: f32 = 5e-4;

/// Beams to blocks.
const SHIFT: u32 = BLOCK.trailing_zeros();

/// All beams in the lidar's frame, in blocks; the last block is filled up with the last beam.
#[derive(Debug, Clone)]
pub(crate) struct Fan {
    /// Number of beams.
    pub beams: usize,
    /// Cosine and sine of each beam's angle.
    pub directions: Vec<[Lanes; 2]>,
    /// How far a beam reaches, m.
    pub range_max: f32,
    /// Angle of beam 0, rad.
    first_angle: f32,
    /// Beams per radian.
    density: f32,
    /// Beams that a full turn would hold.
    turn: f32,
    /// What is ahead + |aside| spread < 0 lies behind the lidar, in the sector that no beam enters.
    spread: f32,
}

/// Blocks of beams: `count` from `start` on, twice, as an interval may go on at beam 0.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Runs {
    /// First block of each run.
    pub start: [i32; 2],
    /// Number of blocks, may be zero.
    pub count: [i32; 2],
}

impl Fan {
    /// The fan of a lidar: beam i at -fov/2 + (i + 1/2) fov/beams, counter-clockwise.
    pub fn new(lidar: &LidarConfig) -> Self {
        let step = lidar.fov / lidar.beams as f64;
        let direction = |i: usize| libm::sincos(beam_angle(lidar, i.min(lidar.beams - 1)));
        let block = |start: usize| {
            let cos = std::array::from_fn(|lane| direction(start + lane).1 as f32);
            let sin = std::array::from_fn(|lane| direction(start + lane).0 as f32);
            [Lanes(cos), Lanes(sin)]
        };
        // Half the angle that the field of view leaves, and at most a quarter turn: a larger sector is not convex.
        let behind = (std::f64::consts::PI - 0.5 * lidar.fov).clamp(1e-9, std::f64::consts::FRAC_PI_2);
        Self {
            beams: lidar.beams,
            directions: (0..lidar.beams).step_by(BLOCK).map(block).collect(),
            range_max: lidar.range_max as f32,
            first_angle: beam_angle(lidar, 0) as f32,
            density: (1.0 / step) as f32,
            turn: (2.0 * std::f64::consts::PI / step) as f32,
            spread: (libm::cos(behind) / libm::sin(behind)) as f32,
        }
    }

    /// Number of beams with the padding of the last block.
    pub fn padded(&self) -> usize {
        self.directions.len() * BLOCK
    }

    /// Whether the point (ahead, aside) lies in a convex sector that no beam enters.
    #[inline(always)]
    pub fn is_behind(&self, ahead: f32, aside: f32) -> bool {
        ahead + aside.abs() * self.spread < 0.0
    }

    /// The beam, as a fraction, that points to (x, y), less the guard band: in [0, turn).
    #[inline(always)]
    pub fn beam_at(&self, x: f32, y: f32) -> f32 {
        let beam = (angle(x, y) - self.first_angle - GUARD) * self.density;
        if beam < 0.0 { beam + self.turn } else { beam }
    }

    /// Blocks from the one of beam `right` to that of beam `left`, two results of `beam_at`: those met first, and those
    /// met on the way from the last beam round to the first.
    #[inline(always)]
    pub fn between(&self, right: f32, left: f32) -> Runs {
        let span = left - right;
        let span = if span < 0.0 { span + self.turn } else { span };
        self.runs(right, right + span + 2.0 * GUARD * self.density)
    }

    /// Blocks within `half_width` (rad) of the direction of (x, y), as in `between`.
    #[inline(always)]
    pub fn around(&self, x: f32, y: f32, half_width: f32) -> Runs {
        let half_width = (half_width + GUARD) * self.density;
        let middle = self.beam_at(x, y) + GUARD * self.density;
        let first = middle - half_width;
        let shift = if first < 0.0 { self.turn } else { 0.0 };
        self.runs(first + shift, middle + half_width + shift)
    }

    /// Blocks of the beams `first` to `last` (fractions, 0 <= first < turn).
    #[inline(always)]
    fn runs(&self, first: f32, last: f32) -> Runs {
        let end = (self.beams - 1) as f32;
        let mut runs = Runs::default();
        for (k, shift) in [0.0, self.turn].into_iter().enumerate() {
            let (low, high) = (first - shift, last - shift);
            let (low, high) = (if low > 0.0 { low } else { 0.0 }, if high < end { high } else { end });
            let (start, stop) = (whole(low) >> SHIFT, whole(high) >> SHIFT);
            runs.start[k] = start;
            runs.count[k] = if low <= high { stop - start + 1 } else { 0 };
        }
        runs
    }
}

/// Angle (rad) of beam `i` in the lidar's frame.
pub fn beam_angle(lidar: &LidarConfig, i: usize) -> f64 {
    -0.5 * lidar.fov + (i as f64 + 0.5) * lidar.fov / lidar.beams as f64
}

/// Angle (rad) of (x, y), within 2.5e-4.
#[inline(always)]
fn angle(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = if ax > ay { (ay, ax) } else { (ax, ay) };
    // The smallest positive normal number keeps 0/0 out.
    let a = small / (large + f32::MIN_POSITIVE);
    let s = a * a;
    let octant = ((-0.046_496_475 * s + 0.159_314_22) * s - 0.327_622_77) * s * a + a;
    let quadrant = if ay > ax { FRAC_PI_2 - octant } else { octant };
    let half = if x < 0.0 { PI - quadrant } else { quadrant };
    if y < 0.0 { -half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angle_is_good_enough_for_the_guard_band() {
        for i in 0..100_000 {
            let exact = f64::from(i) / 100_000.0 * 2.0 * std::f64::consts::PI - std::f64::consts::PI;
            let (sin, cos) = libm::sincos(exact);
            for scale in [1e-6, 1.0, 1e3] {
                let error = f64::from(angle((scale * cos) as f32, (scale * sin) as f32)) - exact;
                assert!(error.abs() < f64::from(GUARD) / 2.0, "{exact}: {error}");
            }
        }
        assert_eq!(angle(0.0, 0.0), 0.0);
    }
}
