//! Pooling of beams into bins by minimum.

use crate::cpu::Kernel;
use crate::world::BLOCK;

/// Which beams belong to which bin: bin k holds the beams whose angle falls into the k-th of equal parts of the field
/// of view, right to left. A beam exactly on a border belongs to the bin on its left.
#[derive(Debug, Clone, PartialEq)]
pub struct Bins {
    /// Beams `starts[k] .. starts[k + 1]` belong to bin k.
    starts: Vec<usize>,
}

impl Bins {
    /// `bins` equal parts for `beams` beams; `1 <= bins <= beams` leaves no bin empty.
    pub fn new(beams: usize, bins: usize) -> Self {
        // Beam i stands at the fraction (2i + 1) / (2 beams) of the field of view: the first beam of bin k is the
        // smallest i with (2i + 1) bins >= 2 k beams.
        let first = |k: usize| (2 * k * beams).div_ceil(bins) / 2;
        Self { starts: (0..=bins).map(first).collect() }
    }

    /// Number of bins.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is no bin: never, bins are at least one.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Writes the smallest range of each bin. Lost beams (NaN) count for nothing: a bin without any other gets infinity.
pub(super) struct Pool<'a> {
    pub bins: &'a Bins,
    /// Range of every beam, m.
    pub ranges: &'a [f32],
    /// Result, m, one place for each bin.
    pub pooled: &'a mut [f32],
}

impl Kernel for Pool<'_> {
    #[inline(always)]
    fn run(self) {
        for (bin, nearest) in self.bins.starts.windows(2).zip(self.pooled) {
            let beams = &self.ranges[bin[0]..bin[1]];
            *nearest = match beams.last_chunk::<BLOCK>() {
                Some(last) => smallest(&smallest_lanes(beams, last)),
                None => smallest(beams),
            };
        }
    }
}

/// Lane by lane the smallest of the whole blocks of `beams` and of its last sixteen, which overlap them.
#[inline(always)]
fn smallest_lanes(beams: &[f32], last: &[f32; BLOCK]) -> [f32; BLOCK] {
    let mut nearest = [f32::INFINITY; BLOCK];
    let (blocks, _) = beams.as_chunks();
    for block in blocks.iter().chain([last]) {
        for (nearest, range) in nearest.iter_mut().zip(block) {
            *nearest = nearer(*nearest, *range);
        }
    }
    nearest
}

/// The smallest of `ranges`, NaN left out; infinity without any.
#[inline(always)]
fn smallest(ranges: &[f32]) -> f32 {
    ranges.iter().fold(f32::INFINITY, |nearest, range| nearer(nearest, *range))
}

/// The smaller number; `a` if `b` is NaN.
#[inline(always)]
fn nearer(a: f32, b: f32) -> f32 {
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
            Pool { bins: &bins, ranges: &ranges, pooled: &mut pooled }.run();
            pooled
        };
        // Beam 2 looks exactly along the border between the bins: it belongs to the left one.
        assert_eq!(pool([3.0, 2.0, 9.0, 1.0, 4.0]), [2.0, 1.0]);
        assert_eq!(pool([f32::NAN, 2.0, f32::NAN, f32::NAN, f32::NAN]), [2.0, f32::INFINITY]);
        for (beams, count) in [(1, 1), (180, 20), (180, 180), (271, 19), (1080, 40), (97, 1), (64, 9), (4096, 31)] {
            let mut random = crate::rng::Stream::new(StreamName::new(1, Purpose::Noise, Split::Given, beams as u32, 0));
            let ranges: Vec<f32> = (0..beams).map(|_| random.uniform(0.0, 10.0) as f32).collect();
            let (bins, mut pooled) = (Bins::new(beams, count), vec![0.0; count]);
            Pool { bins: &bins, ranges: &ranges, pooled: &mut pooled }.run();
            for (k, nearest) in pooled.iter().enumerate() {
                let own = &ranges[bins.starts[k]..bins.starts[k + 1]];
                assert_eq!(*nearest, own.iter().copied().fold(f32::INFINITY, f32::min), "bin {k} of {count}");
            }
        }
    }
}
