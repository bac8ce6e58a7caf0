//! Adam's step over a packed vector.
//!
//! m <- b1 m + (1 - b1) g;  v <- b2 v + (1 - b2) g^2;
//! theta <- theta - lr / (1 - b1^t) m / (sqrt(v / (1 - b2^t)) + eps)
//!
//! Tiny gradients, moments and squares are written as 0 ([`Real::TINY`]).

use crate::real::Real;

/// b1: decay of the first moment.
pub const FIRST_DECAY: f64 = 0.9;
/// b2: decay of the second moment.
pub const SECOND_DECAY: f64 = 0.999;
/// Keeps the step finite where the second moment is 0.
pub const EPSILON: f64 = 1e-8;

/// The factors of one step.
#[derive(Debug, Clone, Copy)]
pub struct Step<T> {
    /// lr / (1 - b1^t).
    pub size: T,
    /// 1 / sqrt(1 - b2^t).
    pub scale: T,
}

impl<T: Real> Step<T> {
    /// Of step number `count` (t, from 1) with step size `rate`.
    pub fn new(rate: f64, count: u64) -> Self {
        let t = count as f64;
        let size = rate / (1.0 - libm::pow(FIRST_DECAY, t));
        let scale = 1.0 / libm::sqrt(1.0 - libm::pow(SECOND_DECAY, t));
        Self { size: T::of(size), scale: T::of(scale) }
    }
}

/// A network's packed vectors, or one piece of each: all of one length.
#[derive(Debug)]
pub struct Vectors<'a, T> {
    /// theta.
    pub parameters: &'a mut [T],
    /// theta' of the target network.
    pub targets: &'a mut [T],
    /// m.
    pub first: &'a mut [T],
    /// v.
    pub second: &'a mut [T],
}

impl<'a, T> Vectors<'a, T> {
    /// The numbers of each before a place, and those from it on.
    ///
    /// # Panics
    /// If a vector ends before the place.
    pub fn split_at(self, place: usize) -> [Self; 2] {
        let (p, t) = (self.parameters.split_at_mut(place), self.targets.split_at_mut(place));
        let (m, v) = (self.first.split_at_mut(place), self.second.split_at_mut(place));
        [
            Self { parameters: p.0, targets: t.0, first: m.0, second: v.0 },
            Self { parameters: p.1, targets: t.1, first: m.1, second: v.1 },
        ]
    }

    /// The same, borrowed for less time.
    pub fn borrow(&mut self) -> Vectors<'_, T> {
        let Self { parameters, targets, first, second } = self;
        Vectors { parameters, targets, first, second }
    }
}
