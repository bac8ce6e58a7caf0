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

    /// Working memory of `pool`: a place for each beam, and for what the last block of them reads beyond.
    pub(super) fn memory(&self) -> Vec<f32> {
        let beams = self.starts[self.len()];
        vec![f32::INFINITY; beams.next_multiple_of(BLOCK) + BLOCK]
    }

    /// Writes the smallest range (m) of each bin to `pooled`, which has one place per bin. Lost beams (NaN) count for
    /// nothing: a bin without any other gets infinity.
    #[inline(always)]
    pub(super) fn pool(&self, ranges: &[f32], memory: &mut [f32], pooled: &mut [f32]) {
        let smaller = |a: f32, b: f32| if b < a { b } else { a };
        for (place, range) in memory.iter_mut().zip(ranges) {
            *place = smaller(f32::INFINITY, *range);
        }
        // Place i comes to hold the smallest of twice as many beams from i on, until they are `window`. A block is read
        // before it is written, so that it takes one operation.
        let mut covered = 1;
        while covered < self.window {
            let last = self.starts[self.len()] - 2 * covered;
            for start in (0..=last).step_by(BLOCK) {
                let (mut near, mut far) = ([0.0; BLOCK], [0.0; BLOCK]);
                near.copy_from_slice(&memory[start..start + BLOCK]);
                far.copy_from_slice(&memory[start + covered..start + covered + BLOCK]);
                for lane in 0..BLOCK {
                    near[lane] = smaller(near[lane], far[lane]);
                }
                memory[start..start + BLOCK].copy_from_slice(&near);
            }
            covered *= 2;
        }
        for (bin, nearest) in self.starts.windows(2).zip(pooled) {
            *nearest = smaller(memory[bin[0]], memory[bin[1] - covered]);
        }
    }
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
        bins.pool(&[3.0, 2.0, 9.0, 1.0, 4.0], &mut bins.memory(), &mut pooled);
        // Beam 2 looks exactly along the border between the bins: it belongs to the left one.
        assert_eq!(pooled, [2.0, 1.0]);
        bins.pool(&[f32::NAN, 2.0, f32::NAN, f32::NAN, f32::NAN], &mut bins.memory(), &mut pooled);
        assert_eq!(pooled, [2.0, f32::INFINITY]);
        for (beams, count) in [(1, 1), (180, 20), (180, 180), (271, 19), (1080, 40), (97, 1), (64, 9), (4096, 31)] {
            let mut random = crate::rng::Stream::new(StreamName::new(1, Purpose::Noise, Split::Given, beams as u32, 0));
            let ranges: Vec<f32> = (0..beams).map(|_| random.uniform(0.0, 10.0) as f32).collect();
            let (bins, mut pooled) = (Bins::new(beams, count), vec![0.0; count]);
            bins.pool(&ranges, &mut bins.memory(), &mut pooled);
            for (k, nearest) in pooled.iter().enumerate() {
                let own = &ranges[bins.starts[k]..bins.starts[k + 1]];
                assert_eq!(*nearest, own.iter().copied().fold(f32::INFINITY, f32::min), "bin {k} of {count}");
            }
        }
    }
}
