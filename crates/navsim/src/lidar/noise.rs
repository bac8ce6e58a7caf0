//! What a real lidar does to a scan, for all beams at once: noise, resolution, limits and lost beams.
//!
//! Gaussian noise comes from Philox words by Box and Muller, in blocks; the same source serves every instruction set
//! (see `cpu`) and gives the same bits on all of them.

use super::NoiseName;
use super::faults;
use crate::config::LidarConfig;
use crate::cpu::Kernel;
use crate::rng::StreamName;
use crate::world::BLOCK;

/// Words of a random block.
const WORDS: usize = 4;
/// Random numbers of one round of the loops: a random block for each lane.
pub(crate) const ROUND: usize = BLOCK * WORDS;

/// How a lidar departs from exact ranges. 0 switches each part off.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    /// Standard deviation of what is independent of the range, m.
    pub sigma: f32,
    /// Standard deviation of what grows with the range, m per m.
    pub sigma_per_meter: f32,
    /// Hits are rounded to multiples of this, m.
    pub resolution: f32,
    /// Of 2^24 beams, how many are lost.
    pub lost: u32,
    /// Hits are clipped to at least this, m.
    pub range_min: f32,
    /// Largest range, m: a beam that met nothing, left as it is.
    pub range_max: f32,
}

impl Noise {
    /// The noise and the limits of a checked configuration.
    pub fn new(lidar: &LidarConfig) -> Self {
        Self {
            sigma: lidar.noise as f32,
            sigma_per_meter: lidar.noise_per_meter as f32,
            resolution: lidar.resolution as f32,
            lost: libm::round(lidar.drop_probability * f64::from(1 << 24)) as u32,
            range_min: lidar.range_min as f32,
            range_max: lidar.range_max as f32,
        }
    }
}

/// Turns exact ranges into those that the lidar reports: noise on hits, rounded to the resolution and clipped to the
/// limits; lost beams are NaN.
pub(super) struct Disturb<'a> {
    pub noise: &'a Noise,
    pub name: &'a NoiseName,
    /// Range of every beam, m, padded to whole blocks of 16, at most `range_max`.
    pub ranges: &'a mut [f32],
}

impl Kernel for Disturb<'_> {
    #[inline(always)]
    fn run(self) {
        disturb(self.noise, self.name, self.ranges);
    }
}

#[inline(always)]
pub(super) fn disturb(noise: &Noise, name: &NoiseName, ranges: &mut [f32]) {
    let first_block = name.scan.wrapping_mul((ranges.len().div_ceil(ROUND) * BLOCK) as u32);
    let Noise { sigma, sigma_per_meter, range_min, .. } = *noise;
    if sigma_per_meter > 0.0 {
        // Two independent errors: their variances add up.
        let total = |range: f32| {
            let growing = sigma_per_meter * range;
            (sigma * sigma + growing * growing).sqrt()
        };
        add_normals(noise, &name.stream, first_block, total, ranges);
    } else if sigma > 0.0 {
        add_normals(noise, &name.stream, first_block, |_| sigma, ranges);
    } else if range_min > 0.0 {
        for range in ranges.iter_mut() {
            *range = if *range < range_min { range_min } else { *range };
        }
    }
    if noise.resolution > 0.0 {
        faults::round_hits(noise, ranges);
    }
    if noise.lost > 0 {
        faults::lose_beams(noise.lost, &name.stream, first_block, ranges);
    }
}

/// Adds noise of standard deviation `sigma(range)` to every hit and clips it; draws from `first_block` on.
#[inline(always)]
fn add_normals(noise: &Noise, stream: &StreamName, first_block: u32, sigma: impl Fn(f32) -> f32, ranges: &mut [f32]) {
    let mut normals = [0.0; ROUND];
    for (round, chunk) in ranges.chunks_mut(ROUND).enumerate() {
        draw_normals(stream, first_block.wrapping_add((round * BLOCK) as u32), &mut normals);
        for (range, normal) in chunk.iter_mut().zip(&normals) {
            let noisy = *range + sigma(*range) * normal;
            let noisy = if noisy > noise.range_min { noisy } else { noise.range_min };
            let noisy = if noisy < noise.range_max { noisy } else { noise.range_max };
            *range = if *range < noise.range_max { noisy } else { noise.range_max };
        }
    }
}

/// 64 normal numbers from 16 random blocks.
#[inline(always)]
pub(crate) fn draw_normals(stream: &StreamName, first_block: u32, normals: &mut [f32; ROUND]) {
    let words = stream.sixteen_blocks(first_block);
    for pair in 0..2 {
        let (radii, turns) = (words[2 * pair], words[2 * pair + 1]);
        for lane in 0..BLOCK {
            let radius = (-2.0 * ln_unit(radii[lane])).sqrt();
            let turn = (turns[lane] >> 8) as f32 * (1.0 / (1 << 24) as f32) - 0.5;
            normals[2 * pair * BLOCK + lane] = radius * sin_turn(turn);
            normals[(2 * pair + 1) * BLOCK + lane] =
                radius * sin_turn(if turn < 0.25 { turn + 0.25 } else { turn - 0.75 });
        }
    }
}

/// Natural logarithm of a number uniform in (0, 1] made from `word`, within 3e-7 of its size.
#[inline(always)]
fn ln_unit(word: u32) -> f32 {
    let unit = ((word >> 8) + 1) as f32 * (1.0 / (1 << 24) as f32);
    // unit = 2^exponent * mantissa with mantissa in [sqrt(1/2), sqrt(2))
    let bits = unit.to_bits() as i32;
    let exponent = (bits - 0x3f35_04f3) >> 23;
    let mantissa = f32::from_bits((bits - (exponent << 23)) as u32);
    // ln m = 2 artanh(z), z = (m - 1) / (m + 1), |z| <= 0.172
    let z = (mantissa - 1.0) / (mantissa + 1.0);
    let s = z * z;
    let series = 2.0 * z * (1.0 + s * (1.0 / 3.0 + s * (0.2 + s * (1.0 / 7.0 + s * (1.0 / 9.0)))));
    exponent as f32 * std::f32::consts::LN_2 + series
}

/// sin(2 pi turn) for turn in [-1/2, 1/2], within 5e-6.
#[inline(always)]
pub(crate) fn sin_turn(turn: f32) -> f32 {
    let folded = if turn > 0.25 { 0.5 - turn } else { turn };
    let folded = if folded < -0.25 { -0.5 - folded } else { folded };
    let x = folded * (2.0 * std::f32::consts::PI);
    let s = x * x;
    x * (1.0 + s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0 + s * (1.0 / 362_880.0)))))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::rng::{Purpose, Split};

    #[test]
    fn the_series_are_as_good_as_they_say() {
        for i in 0..(1 << 16) {
            let word: u32 = i << 16 | 0x1234;
            let exact = libm::log(f64::from((word >> 8) + 1) / f64::from(1 << 24));
            assert!((f64::from(ln_unit(word)) - exact).abs() <= 3e-7 * exact.abs() + 1e-7, "{word:x}");
            let turn = f64::from(i) / f64::from(1 << 16) - 0.5;
            let exact = libm::sin(2.0 * std::f64::consts::PI * turn);
            assert!((f64::from(sin_turn(turn as f32)) - exact).abs() < 5e-6, "{turn}");
        }
    }

    #[test]
    fn noise_is_standard_normal() {
        let stream = StreamName::new(3, Purpose::Noise, Split::Train, 0, 0);
        let mut normals = Vec::new();
        let mut chunk = [0.0; ROUND];
        for block in 0..4_000 {
            draw_normals(&stream, block * BLOCK as u32, &mut chunk);
            normals.extend(chunk.map(f64::from));
        }
        let n = normals.len() as f64;
        let moment = |power: i32| normals.iter().map(|z| z.powi(power)).sum::<f64>() / n;
        // Five standard errors of each moment of 256,000 normal numbers: sqrt(1, 2, 15, 96 / n).
        let error = |variance: f64| 5.0 * (variance / n).sqrt();
        assert!(moment(1).abs() < error(1.0));
        assert!((moment(2) - 1.0).abs() < error(2.0));
        assert!(moment(3).abs() < error(15.0));
        assert!((moment(4) - 3.0).abs() < error(96.0));
        let tail = normals.iter().filter(|z| z.abs() > 3.0).count() as f64 / n;
        assert!((tail - 0.0027).abs() < error(0.0027));
        // No number twice in a row of lanes: the four normals of a block and neighbouring lanes are uncorrelated.
        for lag in [1, BLOCK, 2 * BLOCK, 3 * BLOCK] {
            let correlation = normals.iter().zip(&normals[lag..]).map(|(a, b)| a * b).sum::<f64>() / n;
            assert!(correlation.abs() < error(1.0), "lag {lag}: {correlation}");
        }
    }

    /// A noise that is off but for the limits.
    pub(in crate::lidar) const NONE: Noise =
        Noise { sigma: 0.0, sigma_per_meter: 0.0, resolution: 0.0, lost: 0, range_min: 0.0, range_max: 100.0 };

    pub(in crate::lidar) fn name(episode: u64, scan: u32) -> NoiseName {
        NoiseName { stream: StreamName::new(3, Purpose::Noise, Split::Train, 0, episode), scan }
    }

    #[test]
    fn only_hits_are_noisy_and_stay_within_the_range() {
        let noise = Noise { sigma: 1.0, range_min: 0.5, range_max: 2.0, ..NONE };
        let mut ranges: Vec<f32> = (0..160).map(|i| if i % 2 == 0 { 2.0 } else { 1.0 }).collect();
        disturb(&noise, &name(0, 0), &mut ranges);
        assert!(ranges.iter().step_by(2).all(|r| *r == 2.0));
        let hits: Vec<f32> = ranges.iter().skip(1).step_by(2).copied().collect();
        assert!(hits.iter().all(|r| (0.5..=2.0).contains(r)));
        assert!(hits.contains(&0.5) && hits.contains(&2.0) && hits.iter().any(|r| *r != 0.5 && *r != 2.0));
    }

    /// sigma^2 = 0.03^2 + (0.01 r)^2: 0.05 m at 4 m, 0.03162 m at 1 m.
    #[test]
    fn variances_of_both_kinds_add_up() {
        let noise = Noise { sigma: 0.03, sigma_per_meter: 0.01, ..NONE };
        for (range, sigma) in [(4.0, 0.05), (1.0, 0.031_622_8)] {
            let errors = |scan| {
                let mut ranges = vec![range; 1600];
                disturb(&noise, &name(1, scan), &mut ranges);
                ranges.into_iter().map(move |r| f64::from(r - range))
            };
            let all: Vec<f64> = (0..100).flat_map(errors).collect();
            let n = all.len() as f64;
            let mean = all.iter().sum::<f64>() / n;
            let variance = all.iter().map(|e| e * e).sum::<f64>() / n;
            // Five standard errors.
            assert!(mean.abs() < 5.0 * sigma / n.sqrt(), "{range}: {mean}");
            assert!((variance / (sigma * sigma) - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{range}: {variance}");
        }
    }

    #[test]
    fn the_name_decides_the_noise() {
        let noise = Noise { sigma: 0.1, lost: 1 << 22, resolution: 0.001, ..NONE };
        let scan = |name: NoiseName| {
            let mut ranges = vec![5.0; 192];
            disturb(&noise, &name, &mut ranges);
            ranges.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        };
        let first = scan(name(7, 3));
        assert_eq!(first, scan(name(7, 3)));
        let robot =
            |seed, index| NoiseName { stream: StreamName::new(seed, Purpose::Noise, Split::Train, index, 7), scan: 3 };
        for other in [name(8, 3), name(7, 4), robot(4, 0), robot(3, 1)] {
            let same = scan(other).iter().zip(&first).filter(|(a, b)| a == b).count();
            // Both lost in 1/16 of the beams, on the same millimetre in few.
            assert!(same < 40, "{same} of 192 beams agree");
        }
    }
}
