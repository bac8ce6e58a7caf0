//! The packed parameters of a network, in the pieces that two threads step.

use crate::layer::Layer;
use std::ops::Range;

/// Rows of a weight that stay together, as many as a tile of a product has at most.
const ROWS: usize = 8;

/// One vector in pieces, each with its place. A hidden layer's weight may begin in one piece and end in the next one, cut
/// between two of its rows; everything else lies in a piece as a whole.
#[derive(Debug, Clone, Copy)]
pub struct Packed<'a, T>(&'a [(usize, &'a [T])]);

impl<'a, T> Packed<'a, T> {
    /// Of pieces in the order in which they follow each other, wherever one continues another one.
    pub fn new(pieces: &'a [(usize, &'a [T])]) -> Self {
        Self(pieces)
    }

    /// The numbers of a range that lies in one piece.
    ///
    /// # Panics
    /// If it lies in none.
    pub fn at(self, range: Range<usize>) -> &'a [T] {
        let mut parts = self.parts(range.clone());
        let numbers = parts.next().unwrap_or_default();
        assert!(numbers.len() == range.len(), "parameters {range:?} of one piece");
        numbers
    }

    /// The numbers of a range, piece by piece.
    pub fn parts(self, range: Range<usize>) -> impl Iterator<Item = &'a [T]> {
        self.0.iter().filter_map(move |&(place, numbers)| {
            let first = range.start.max(place);
            let end = range.end.min(place + numbers.len());
            (first < end).then(|| &numbers[first - place..end - place])
        })
    }
}

/// The numbers of a packed vector that each of two threads steps: ranges, in order.
pub type Shares = [Vec<Range<usize>>; 2];

/// Two halves of a vector of `size` numbers with these hidden layers, cut so that both are about equal.
pub fn halves(hidden: &[Layer], size: usize) -> Shares {
    let nearest = |layer: &Layer| {
        let weights = layer.weights();
        let rows = (size / 2).clamp(weights.start, weights.end) - weights.start;
        let step = ROWS * layer.inputs;
        (weights.start + (rows + step / 2) / step * step).min(weights.end)
    };
    shares(hidden.iter().map(nearest).min_by_key(|place| place.abs_diff(size / 2)).unwrap_or(size), size)
}

/// A vector of `size` numbers, cut at a place, which may be its end.
pub fn shares(cut: usize, size: usize) -> Shares {
    [0..cut, cut..size].map(|range| Some(range).into_iter().filter(|range| !range.is_empty()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_ranges_before_across_and_behind_the_cut() {
        let numbers: Vec<usize> = (0..10).collect();
        let (first, second) = numbers.split_at(6);
        let pieces = [(0, first), (6, second)];
        let packed = Packed::new(&pieces);
        for (range, expected) in [(1..4, 3), (4..9, 2), (6..9, 3), (3..6, 3), (0..10, 6)] {
            let parts: Vec<_> = packed.parts(range.clone()).collect();
            assert_eq!(parts.concat(), numbers[range.clone()]);
            assert_eq!(parts[0].len(), expected, "{range:?}");
        }
        assert_eq!((packed.at(2..6), packed.at(6..8)), (&numbers[2..6], &numbers[6..8]));
    }

    #[test]
    #[should_panic(expected = "of one piece")]
    fn what_is_cut_is_not_one() {
        let pieces: [(usize, &[u8]); 2] = [(0, &[1, 2]), (2, &[3])];
        Packed::new(&pieces).at(1..3);
    }

    #[test]
    fn the_cut_is_a_row_near_the_middle() {
        let first = Layer { inputs: 26, outputs: 128, weight: 0, bias: 3328 };
        let second = Layer { inputs: 128, outputs: 128, weight: 3456, bias: 19_840 };
        let [before, behind] = halves(&[first, second], 20_226);
        let cut = before[0].end;
        assert_eq!((before.len(), before[0].start, behind.len()), (1, 0, 1));
        assert_eq!(behind[0], cut..20_226);
        assert_eq!((cut - second.weight) % (ROWS * 128), 0);
        assert!(cut.abs_diff(10_113) <= ROWS * 64, "{cut}");
    }
}
