//! The packed parameters of a network, in the two pieces that two threads step.

use crate::layer::Layer;
use std::ops::Range;

/// Rows of a weight that stay together, as many as a tile of a product has at most.
const ROWS: usize = 8;

/// One vector, in one slice or in two that follow each other. The second begins at a row of a hidden layer's weight;
/// everything else lies in one of the two as a whole.
#[derive(Debug, Clone, Copy)]
pub struct Packed<'a, T>([&'a [T]; 2]);

impl<'a, T> Packed<'a, T> {
    /// Of two pieces, of which the second may be empty.
    pub fn new(pieces: [&'a [T]; 2]) -> Self {
        Self(pieces)
    }

    /// The numbers of a range that lies in one piece.
    ///
    /// # Panics
    /// If it lies in both, or beyond the end.
    pub fn at(self, range: Range<usize>) -> &'a [T] {
        let cut = self.0[0].len();
        if range.end <= cut { &self.0[0][range] } else { &self.0[1][range.start - cut..range.end - cut] }
    }

    /// The numbers of a range that lie in the first piece, and those that lie in the second.
    ///
    /// # Panics
    /// If the range ends beyond both.
    pub fn parts(self, range: Range<usize>) -> [&'a [T]; 2] {
        let [first, second] = self.0;
        let cut = first.len().clamp(range.start, range.end);
        let in_first = range.start.min(first.len())..cut.min(first.len());
        let in_second = cut.saturating_sub(first.len())..range.end.saturating_sub(first.len());
        [&first[in_first], &second[in_second]]
    }
}

/// Where the second piece of a vector of `size` numbers with these hidden layers begins, so that both are about equal.
pub fn cut(hidden: &[Layer], count: usize, size: usize) -> usize {
    let nearest = |layer: &Layer| {
        let weights = layer.of_critics(count).weights();
        let rows = (size / 2).clamp(weights.start, weights.end) - weights.start;
        let step = ROWS * layer.inputs;
        (weights.start + (rows + step / 2) / step * step).min(weights.end)
    };
    hidden.iter().map(nearest).min_by_key(|place| place.abs_diff(size / 2)).unwrap_or(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_ranges_before_across_and_behind_the_cut() {
        let numbers: Vec<usize> = (0..10).collect();
        let (first, second) = numbers.split_at(6);
        let packed = Packed::new([first, second]);
        for (range, expected) in [(1..4, 3), (4..9, 2), (6..9, 0), (8..10, 0), (3..6, 3), (0..10, 6)] {
            let [a, b] = packed.parts(range.clone());
            assert_eq!([a, b].concat(), numbers[range.clone()]);
            assert_eq!(a.len(), expected, "{range:?}");
        }
        assert_eq!((packed.at(2..6), packed.at(6..8)), (&numbers[2..6], &numbers[6..8]));
    }

    #[test]
    fn the_cut_is_a_row_near_the_middle() {
        let first = Layer { inputs: 26, outputs: 128, weight: 0, bias: 3328 };
        let second = Layer { inputs: 128, outputs: 128, weight: 3456, bias: 19_840 };
        let cut = cut(&[first, second], 1, 20_226);
        assert_eq!((cut - second.weight) % (ROWS * 128), 0);
        assert!(cut.abs_diff(10_113) <= ROWS * 64, "{cut}");
    }
}
