//! Pooling of beams into bins by minimum.

use crate::world::BLOCK;

/// Which beams belong to which bin: bin k holds the beams whose angle falls into the k-th of equal parts of the field
/// of view, right to left. A beam exactly on a border belongs to the bin on its left.
#[derive(Debug, Clone, PartialEq)]
pub struct Bins {
    /// Beams `starts[k] .. starts[k + 1]` belong to bin k.
    starts: Vec<usize>,
    /// The largest power of two that no bin is narrower than: two windows of so many beams cover a bin.
    window: usize,
}

impl Bins {
    /// `bins` equal parts for `beams` beams; `1 <= bins <= beams` leaves no bin empty.
    pub fn new(beams: usize, bins: usize) -> Self {
        // Beam i stands at the fraction (2i + 1) / (2 beams) of the field of view: the first beam of bin k is the
        // smallest i with (2i + 1) bins >= 2 k beams.
        let first = |k: usize| (2 * k * beams).div_ceil(bins) / 2;
        Self { starts: (0..=bins).map(first).collect(), window: 1 << (beams / bins).ilog2() }
    }

    /// Number of bins.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is no bin: never, bins are at least one.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Working memory of `pool`: a place for each beam.
    pub(super) fn memory(&self) -> Vec<f32> {
        vec![f32::INFINITY; padded(self.beams())]
    }

    fn beams(&self) -> usize {
        self.starts[self.len()]
    }

    /// Writes the smallest range (m) of each bin to `pooled`, which has one place per bin. Lost beams (NaN) count for
    /// nothing: a bin without any other gets infinity. `ranges` and `memory` have the length `padded`.
    #[inline(always)]
    pub(super) fn pool(&self, ranges: &[f32], memory: &mut [f32], pooled: &mut [f32]) {
        // Place i comes to hold the smallest of the ranges i, i + 1 .. i + `covered`, until those are `window`. Eight at
        // once: what has just been written is slow to read at other offsets.
        let mut covered = self.window.min(8);
        for start in (0..=self.beams() - covered).step_by(BLOCK) {
            let nearest = smallest_of(ranges, start, 1, covered);
            memory[start..start + BLOCK].copy_from_slice(&nearest);
        }
        while covered < self.window {
            let count = (self.window / covered).min(8);
            for start in (0..=self.beams() - count * covered).step_by(BLOCK) {
                let nearest = smallest_of(memory, start, covered, count);
                memory[start..start + BLOCK].copy_from_slice(&nearest);
            }
            covered *= count;
        }
        for (bin, nearest) in self.starts.windows(2).zip(pooled) {
            *nearest = smaller(memory[bin[0]], memory[bin[1] - covered]);
        }
    }
}

/// Places for `beams` beams in whole blocks, and one block more, which the last of them reads into.
pub(super) fn padded(beams: usize) -> usize {
    beams.next_multiple_of(BLOCK) + BLOCK
}

/// For each lane i of a block, the smallest of `count` values from `start` + i on in steps of `stride`, NaN left out.
#[inline(always)]
fn smallest_of(values: &[f32], start: usize, stride: usize, count: usize) -> [f32; BLOCK] {
    let mut nearest = [f32::INFINITY; BLOCK];
    for k in 0..count {
        let others = &values[start + k * stride..start + k * stride + BLOCK];
        for (nearest, other) in nearest.iter_mut().zip(others) {
            *nearest = smaller(*nearest, *other);
        }
    }
    nearest
}

/// The smaller number; `a` if `b` is NaN.
#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Purpose, Split, StreamName};

    #[test]
    fn nine_beams_to_a_bin_for_180_beams_and_20_bins() {
        let bins = Bins::new(180, 20);
        assert_eq!(bins.starts, (0..=20).map(|k| 9 * k).collect::<Vec<_>>());
    }

    #[test]
    fn every_beam_is_in_the_bin_of_its_angle() {
        for beams in 1..=97 {
            for count in 1..=beams {
                let bins = Bins::new(beams, count);
                assert_eq!((bins.starts[0], bins.starts[count]), (0, beams));
                for k in 0..count {
                    assert!(bins.starts[k] < bins.starts[k + 1], "{beams} beams, {count} bins: bin {k} is empty");
                    for beam in bins.starts[k]..bins.starts[k + 1] {
                        // floor of the beam's fraction of the field of view times the number of bins, in integers
                        assert_eq!((2 * beam + 1) * count / (2 * beams), k);
                    }
                }
            }
        }
    }

    #[test]
    fn a_bin_holds_its_nearest_beam() {
        let mut pooled = [0.0; 2];
        let bins = Bins::new(5, 2);
        let mut pool = |ranges: [f32; 5]| {
            let mut places = vec![0.0; padded(5)];
            places[..5].copy_from_slice(&ranges);
            bins.pool(&places, &mut bins.memory(), &mut pooled);
            pooled
        };
        // Beam 2 looks exactly along the border between the bins: it belongs to the left one.
        assert_eq!(pool([3.0, 2.0, 9.0, 1.0, 4.0]), [2.0, 1.0]);
        assert_eq!(pool([f32::NAN, 2.0, f32::NAN, f32::NAN, f32::NAN]), [2.0, f32::INFINITY]);
        for (beams, count) in [(1, 1), (180, 20), (180, 180), (271, 19), (1080, 40), (97, 1), (64, 9), (4096, 31)] {
            let mut random = crate::rng::Stream::new(StreamName::new(1, Purpose::Noise, Split::Given, beams as u32, 0));
            let ranges: Vec<f32> = (0..padded(beams)).map(|_| random.uniform(0.0, 10.0) as f32).collect();
            let (bins, mut pooled) = (Bins::new(beams, count), vec![0.0; count]);
            bins.pool(&ranges, &mut bins.memory(), &mut pooled);
            for (k, nearest) in pooled.iter().enumerate() {
                let own = &ranges[bins.starts[k]..bins.starts[k + 1]];
                assert_eq!(*nearest, own.iter().copied().fold(f32::INFINITY, f32::min), "bin {k} of {count}");
            }
        }
    }
}
