//! Numbers that begin where a line of the processor's cache does, so that whole vectors of them lie in one.

use crate::real::Real;
use std::mem::size_of;
use std::ops::{Deref, DerefMut};

/// Bytes of a line.
const LINE: usize = 64;

/// A slice on the heap which never moves.
#[derive(Debug)]
pub struct Aligned<T> {
    numbers: Vec<T>,
    first: usize,
    count: usize,
}

impl<T> Aligned<T> {
    /// The first `count` of some numbers that begin at a line, of which there are more.
    fn of(numbers: Vec<T>, count: usize) -> Self {
        let first = numbers.as_ptr().align_offset(LINE).min(numbers.len() - count);
        Self { numbers, first, count }
    }
}

impl<T: Real> Aligned<T> {
    /// So many zeros.
    pub fn zeros(count: usize) -> Self {
        Self::of(vec![T::ZERO; count + LINE / size_of::<T>()], count)
    }
}

impl<T: Clone> Clone for Aligned<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::of(self.numbers.clone(), self.count);
        copy.clone_from_slice(self);
        copy
    }
}

impl<T> Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.numbers[self.first..][..self.count]
    }
}

impl<T> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.numbers[self.first..][..self.count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_of_any_length_begin_at_a_line() {
        for count in [0, 1, 7, 100, 4097] {
            let (mut singles, doubles) = (Aligned::<f32>::zeros(count), Aligned::<f64>::zeros(count));
            singles.fill(1.0);
            assert_eq!(singles.clone()[..], singles[..]);
            assert_eq!((singles.len(), doubles.len()), (count, count));
            for place in [singles.as_ptr().addr(), singles.clone().as_ptr().addr(), doubles.as_ptr().addr()] {
                assert_eq!(place % LINE, 0);
            }
        }
    }
}
