//! What a kernel runs on: the instruction set, chosen at run time, the floating-point mode, and the caches. The only
//! module of the crate with unsafe code.

#![allow(unsafe_code)]

mod isa;
mod mode;

pub use isa::Isa;
pub(crate) use isa::{Dispatch, Kernel};
pub(crate) use mode::DefaultMode;

/// The whole part of `value`, which is cut to 0 to 65,536 (0 for NaN): a conversion that vectorises, unlike `as`.
#[inline(always)]
pub(crate) fn whole(value: f32) -> i32 {
    let value = if value > 0.0 { value } else { 0.0 };
    let value = if value < 65_536.0 { value } else { 65_536.0 };
    // SAFETY: the value is within 0 to 65,536, and both comparisons are false for NaN.
    unsafe { value.to_int_unchecked() }
}

/// Asks for `values` to be brought near before they are needed; nothing else happens.
#[inline(always)]
pub(crate) fn prefetch<T>(values: &[T]) {
    #[cfg(target_arch = "x86_64")]
    for offset in (0..size_of_val(values)).step_by(64) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch changes nothing and cannot fault, wherever it points.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().cast::<i8>().wrapping_add(offset)) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = values;
}
