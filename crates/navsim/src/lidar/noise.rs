//! Gaussian noise for a whole scan at once: Philox words to normal numbers by Box and Muller, in blocks.

use crate::rng::StreamName;
use crate::world::BLOCK;

/// Random blocks of four words that one round of the loop draws: one for each lane.
const WORDS: usize = 4;
/// Normal numbers of one round of the loop.
const ROUND: usize = BLOCK * WORDS;

/// Noise of one episode's scans.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    /// Stream of the episode.
    pub stream: StreamName,
    /// Standard deviation, m.
    pub sigma: f32,
    /// Ranges are clipped to at least this, m.
    pub range_min: f32,
    /// Largest range, m: a beam that met nothing, left as it is.
    pub range_max: f32,
}

/// Random blocks that one scan of `beams` uses.
pub(crate) fn blocks_per_scan(beams: usize) -> u32 {
    (beams.div_ceil(ROUND) * BLOCK) as u32
}

/// Adds noise to every hit in `ranges` (padded to whole blocks of 16) and clips it; draws from `first_block` on.
#[inline(always)]
pub(super) fn add(noise: &Noise, first_block: u32, ranges: &mut [f32]) {
    let mut normals = [0.0; ROUND];
    for (round, chunk) in ranges.chunks_mut(ROUND).enumerate() {
        draw(&noise.stream, first_block.wrapping_add((round * BLOCK) as u32), &mut normals);
        for (range, normal) in chunk.iter_mut().zip(&normals) {
            let noisy = *range + noise.sigma * normal;
            let noisy = if noisy > noise.range_min { noisy } else { noise.range_min };
            let noisy = if noisy < noise.range_max { noisy } else { noise.range_max };
            *range = if *range < noise.range_max { noisy } else { noise.range_max };
        }
    }
}

/// 64 normal numbers from 16 random blocks.
#[inline(always)]
fn draw(stream: &StreamName, first_block: u32, normals: &mut [f32; ROUND]) {
    let mut words = [[0u32; BLOCK]; WORDS];
    for lane in 0..BLOCK {
        let block = stream.block(first_block.wrapping_add(lane as u32));
        for (row, word) in words.iter_mut().zip(block) {
            row[lane] = word;
        }
    }
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
fn sin_turn(turn: f32) -> f32 {
    let folded = if turn > 0.25 { 0.5 - turn } else { turn };
    let folded = if folded < -0.25 { -0.5 - folded } else { folded };
    let x = folded * (2.0 * std::f32::consts::PI);
    let s = x * x;
    x * (1.0 + s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0 + s * (1.0 / 362_880.0)))))
}

#[cfg(test)]
mod tests {
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
            draw(&stream, block * BLOCK as u32, &mut chunk);
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

    #[test]
    fn only_hits_are_noisy_and_stay_within_the_range() {
        let stream = StreamName::new(3, Purpose::Noise, Split::Train, 0, 0);
        let noise = Noise { stream, sigma: 1.0, range_min: 0.5, range_max: 2.0 };
        let mut ranges: Vec<f32> = (0..160).map(|i| if i % 2 == 0 { 2.0 } else { 1.0 }).collect();
        add(&noise, 0, &mut ranges);
        assert!(ranges.iter().step_by(2).all(|r| *r == 2.0));
        let hits: Vec<f32> = ranges.iter().skip(1).step_by(2).copied().collect();
        assert!(hits.iter().all(|r| (0.5..=2.0).contains(r)));
        assert!(hits.contains(&0.5) && hits.contains(&2.0) && hits.iter().any(|r| *r != 0.5 && *r != 2.0));
    }
}
