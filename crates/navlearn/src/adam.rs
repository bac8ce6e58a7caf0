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

/// Adam's moments, as long as the parameters.
#[derive(Debug)]
pub struct Moments<'a, T> {
    /// m.
    pub first: &'a mut [T],
    /// v.
    pub second: &'a mut [T],
}
