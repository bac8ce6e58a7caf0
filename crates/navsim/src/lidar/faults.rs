//! Faults of a real lidar: the step in which it counts, and beams that never come back.

use super::noise::{Noise, ROUND};
use crate::rng::{Purpose, StreamName};

/// From here on every single-precision number is whole.
const WHOLE: f32 = (1 << 23) as f32;

/// Rounds every hit between the limits to the nearest multiple of the resolution, and clips it to the limits again.
#[inline(always)]
pub(super) fn round_hits(noise: &Noise, ranges: &mut [f32]) {
    let Noise { resolution, range_min, range_max, .. } = *noise;
    for range in ranges.iter_mut() {
        let steps = *range / resolution;
        // Adding 2^23 leaves no place for a fraction. Not `round`, which the baseline calls for one number at a time.
        let rounded = if steps < WHOLE { ((steps + WHOLE) - WHOLE) * resolution } else { *range };
        let rounded = if rounded > range_min { rounded } else { range_min };
        let rounded = if rounded < range_max { rounded } else { range_max };
        *range = if (*range > range_min) & (*range < range_max) { rounded } else { *range };
    }
}

/// Loses `lost` of 2^24 beams, each for itself: they report NaN. Draws from the stream of lost beams that bears the
/// name of the noise's `stream`, from `first_block` on.
#[inline(always)]
pub(super) fn lose_beams(lost: u32, stream: &StreamName, first_block: u32, ranges: &mut [f32]) {
    let stream = stream.with_purpose(Purpose::LostBeams);
    let blocks = ROUND as u32 / 4;
    for (round, chunk) in (0..).zip(ranges.chunks_mut(ROUND)) {
        let words = stream.sixteen_blocks(first_block.wrapping_add(round * blocks));
        for (range, word) in chunk.iter_mut().zip(words.as_flattened()) {
            *range = if word >> 8 < lost { f32::NAN } else { *range };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::noise::disturb;
    use super::super::noise::tests::{NONE, name};
    use super::*;

    #[test]
    fn hits_lie_on_the_grid_and_nothing_else_moves() {
        let noise = Noise { resolution: 0.25, range_min: 0.4, range_max: 3.1, ..NONE };
        let mut ranges = vec![0.0, 0.3, 0.45, 0.62, 0.63, 1.0, 1.124, 1.126, 3.0, 3.09, 3.1, 0.5, 0.5, 0.5, 0.5, 0.5];
        disturb(&noise, &name(0, 0), &mut ranges);
        // Below range_min: range_min. Rounded beyond range_max: range_max. Nothing met: range_max, on the grid or not.
        assert_eq!(ranges[..11], [0.4, 0.4, 0.5, 0.5, 0.75, 1.0, 1.0, 1.25, 3.0, 3.0, 3.1]);
        let fine = Noise { resolution: 0.001, sigma: 0.02, range_max: 10.0, ..NONE };
        let mut ranges: Vec<f32> = (0..1600).map(|i| 0.006 * i as f32).collect();
        let exact = ranges.clone();
        disturb(&fine, &name(0, 1), &mut ranges);
        for (range, exact) in ranges.iter().zip(exact) {
            assert_eq!(*range, (range / 0.001).round() * 0.001);
            assert!((range - exact).abs() < 0.12);
        }
    }

    #[test]
    fn a_resolution_too_fine_for_single_precision_changes_nothing() {
        let noise = Noise { resolution: 1e-37, range_max: 1000.0, ..NONE };
        let exact: Vec<f32> = (0..1600).map(|i| 0.6 * i as f32).collect();
        let mut ranges = exact.clone();
        disturb(&noise, &name(0, 0), &mut ranges);
        assert_eq!(ranges, exact);
    }

    #[test]
    fn beams_are_lost_at_the_rate_given_whether_they_meet_something_or_not() {
        for (lost, rate) in [(1 << 24, 1.0), (1 << 23, 0.5), (167_772, 0.01), (1, 0.0)] {
            let noise = Noise { lost, ..NONE };
            let (mut count, mut pairs, mut total) = (0.0, 0.0, 0.0);
            for scan in 0..2000 {
                let mut ranges = [[5.0_f32, 100.0]; 96];
                disturb(&noise, &name(5, scan), ranges.as_flattened_mut());
                let gone: Vec<f64> = ranges.as_flattened().iter().map(|r| f64::from(u8::from(r.is_nan()))).collect();
                assert!(ranges.as_flattened().iter().all(|r| r.is_nan() || *r == 5.0 || *r == 100.0));
                count += gone.iter().sum::<f64>();
                pairs += gone.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
                total += gone.len() as f64;
            }
            // Five standard errors of a frequency; one beam says nothing about its neighbour.
            let close = |got: f64, p: f64| (got / total - p).abs() <= 5.0 * (p * (1.0 - p) / total).sqrt() + 0.006 * p;
            assert!(close(count, rate), "{lost}: {count} of {total}");
            assert!(close(pairs, rate * rate), "{lost}: {pairs} pairs of {total}");
        }
    }

    /// Losing beams leaves the noise of the others as it was.
    #[test]
    fn lost_beams_have_a_stream_of_their_own() {
        let noise = Noise { sigma: 0.1, ..NONE };
        let scan = |noise: Noise| {
            let mut ranges = vec![5.0; 192];
            disturb(&noise, &name(2, 9), &mut ranges);
            ranges
        };
        let (all, some) = (scan(noise), scan(Noise { lost: 1 << 22, ..noise }));
        assert!(some.iter().any(|r| r.is_nan()));
        assert!(all.iter().zip(&some).all(|(a, b)| a == b || b.is_nan()));
    }
}
