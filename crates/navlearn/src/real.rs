//! The numbers that networks are made of: f32, or f64 for comparisons.

use crate::kernels::product::Multiply;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A floating-point type.
pub trait Real:
    Multiply
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// What is smaller in size is written as 0: far above the subnormal numbers, which slow a processor down and which
    /// some callers flush to zero, and far below what counts beside Adam's epsilon.
    const TINY: Self;
    /// Half of the largest number: the sum of two that are no larger is finite.
    const HALF: Self;

    /// The nearest number of this type.
    fn of(number: f64) -> Self;

    /// As f64, exactly.
    fn wide(self) -> f64;

    /// Of size |self|.
    fn size(self) -> Self;

    /// Square root, correctly rounded.
    fn root(self) -> Self;

    /// Hyperbolic tangent, of the same bits on every machine.
    fn tanh(self) -> Self;

    /// Neither NaN nor infinite.
    fn finite(self) -> bool;

    /// The number, or 0 if it is tiny.
    #[inline(always)]
    fn settled(self) -> Self {
        if self.size() < Self::TINY { Self::ZERO } else { self }
    }

    /// Within [low, high]; NaN stays.
    #[inline(always)]
    fn within(self, low: Self, high: Self) -> Self {
        let raised = if self < low { low } else { self };
        if raised > high { high } else { raised }
    }
}

macro_rules! real {
    ($type:ident, $tiny:expr, $tanh:path) => {
        impl Real for $type {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const TINY: Self = $tiny;
            const HALF: Self = $type::MAX / 2.0;

            #[inline(always)]
            fn of(number: f64) -> Self {
                number as Self
            }

            #[inline(always)]
            fn wide(self) -> f64 {
                f64::from(self)
            }

            #[inline(always)]
            fn size(self) -> Self {
                self.abs()
            }

            #[inline(always)]
            fn root(self) -> Self {
                self.sqrt()
            }

            fn tanh(self) -> Self {
                $tanh(self)
            }

            #[inline(always)]
            fn finite(self) -> bool {
                self.is_finite()
            }
        }
    };
}

// 2^16 times the smallest normal number
real!(f32, f32::MIN_POSITIVE * 65536.0, libm::tanhf);
real!(f64, f64::MIN_POSITIVE * 65536.0, libm::tanh);
