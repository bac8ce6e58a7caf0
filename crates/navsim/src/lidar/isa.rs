//! What a kernel runs on: the instruction set, chosen at run time, and the floating-point mode. The only module of the
//! crate with unsafe code.
//!
//! A wheel is built for plain x86-64; the kernels are compiled again for AVX2 and AVX-512 and give the same bits there.
//! The environment variable `NAVRL_ISA` (`baseline`, `avx2`, `avx512`) forces a lower one, for tests and comparisons.

#![allow(unsafe_code)]

use super::NoiseName;
use super::bins::Bins;
use super::draw::View;
use super::fan::Fan;
use super::noise::{self, Noise};
use super::raster::{self, Scratch};
use crate::error::{Error, Result};
use crate::world::Outline;

/// An instruction set that the kernels are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Isa {
    /// What every machine of the target has (SSE2 on x86-64, NEON on aarch64).
    Baseline,
    /// x86-64 with AVX2.
    Avx2,
    /// x86-64 with AVX-512 F, VL, DQ and BW.
    Avx512,
}

impl Isa {
    /// The best that this machine has, or a lower one that the environment variable `NAVRL_ISA` asks for.
    ///
    /// # Errors
    /// `NAVRL_ISA` holds another word.
    pub fn current() -> Result<Self> {
        let best = Self::detect();
        let Ok(name) = std::env::var("NAVRL_ISA") else { return Ok(best) };
        let expected =
            || Error::Setting { key: "NAVRL_ISA", value: name.clone(), expected: "baseline, avx2 or avx512".into() };
        Self::named(&name).map(|isa| isa.min(best)).ok_or_else(expected)
    }

    /// The instruction set of that name, `None` for another word.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Baseline, Self::Avx2, Self::Avx512].into_iter().find(|isa| isa.name() == name)
    }

    /// `baseline`, `avx2` or `avx512`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// The best instruction set of this machine.
    #[cfg(target_arch = "x86_64")]
    pub fn detect() -> Self {
        let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi2");
        let avx512 = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw");
        if avx2 && avx512 {
            Self::Avx512
        } else if avx2 {
            Self::Avx2
        } else {
            Self::Baseline
        }
    }

    /// The best instruction set of this machine.
    #[cfg(not(target_arch = "x86_64"))]
    pub fn detect() -> Self {
        Self::Baseline
    }
}

/// The whole part of `value`, which is cut to 0 to 65,536 (0 for NaN): a conversion that vectorises, unlike `as`.
#[inline(always)]
pub(super) fn whole(value: f32) -> i32 {
    let value = if value > 0.0 { value } else { 0.0 };
    let value = if value < 65_536.0 { value } else { 65_536.0 };
    // SAFETY: the value is within 0 to 65,536, and both comparisons are false for NaN.
    unsafe { value.to_int_unchecked() }
}

/// Compiles a kernel for every instruction set and calls the body that `isa` names.
macro_rules! dispatched {
    ($name:ident => $kernel:path, ($($argument:ident: $type:ty),*)) => {
        pub(super) fn $name(isa: Isa, $($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,bmi2")]
                fn avx2($($argument: $type),*) {
                    $kernel($($argument),*)
                }
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi2")]
                fn avx512($($argument: $type),*) {
                    $kernel($($argument),*)
                }
                match isa.min(Isa::detect()) {
                    // SAFETY: `isa` is at most what `detect` found on this machine, which tests each enabled feature.
                    Isa::Avx512 => return unsafe { avx512($($argument),*) },
                    // SAFETY: as above.
                    Isa::Avx2 => return unsafe { avx2($($argument),*) },
                    Isa::Baseline => {}
                }
            }
            let _ = isa;
            $kernel($($argument),*)
        }
    };
}

dispatched!(scan => raster::scan, (
    outlines: [&Outline; 2], shortcuts: bool, view: View, fan: &Fan, scratch: &mut Scratch, ranges: &mut [f32]
));
dispatched!(pool => Bins::pool, (bins: &Bins, ranges: &[f32], memory: &mut [f32], pooled: &mut [f32]));
dispatched!(disturb => noise::disturb, (noise: &Noise, name: &NoiseName, ranges: &mut [f32]));

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

/// Round to nearest, denormal numbers as they are, for as long as this lives: results must not depend on what the calling
/// thread has chosen (a training loop flushes denormals), nor change it. Where the target is neither x86-64 nor aarch64,
/// the thread's own mode stays.
#[derive(Debug)]
pub(crate) struct DefaultMode {
    caller: mode::Word,
    /// The mode belongs to the thread.
    not_send: std::marker::PhantomData<*const ()>,
}

impl DefaultMode {
    /// Sets the default mode on this thread.
    #[inline]
    pub fn set() -> Self {
        let caller = mode::read();
        if caller & mode::CONTROL != mode::DEFAULT {
            mode::write(caller & !mode::CONTROL | mode::DEFAULT);
        }
        Self { caller, not_send: std::marker::PhantomData }
    }
}

impl Drop for DefaultMode {
    fn drop(&mut self) {
        if self.caller & mode::CONTROL != mode::DEFAULT {
            mode::write(self.caller);
        }
    }
}

/// The control register of SSE and AVX.
#[cfg(target_arch = "x86_64")]
mod mode {
    use std::arch::asm;

    pub type Word = u32;
    /// Everything but the six flags that record what has happened.
    pub const CONTROL: Word = 0xFFC0;
    /// All exceptions masked, round to nearest, nothing flushed.
    pub const DEFAULT: Word = 0x1F80;

    #[inline]
    pub fn read() -> Word {
        let mut word = 0;
        // SAFETY: stores the control register, which every x86-64 has, into `word` and touches nothing else.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut word, options(nostack, preserves_flags)) };
        word
    }

    #[inline]
    pub fn write(word: Word) {
        // SAFETY: `word` was read from this register, with no reserved bit and no exception unmasked that was masked.
        // Rust expects the default mode: `DefaultMode` sets it, and gives back no other than it found.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const word, options(nostack, preserves_flags)) };
    }
}

/// The floating-point control register.
#[cfg(target_arch = "aarch64")]
mod mode {
    use std::arch::asm;

    pub type Word = u64;
    /// Alternative half precision, default NaN, flushing, rounding, trapped exceptions, and FEAT_AFP's three bits.
    pub const CONTROL: Word = 0x07C0_9F07;
    /// None of them.
    pub const DEFAULT: Word = 0;

    #[inline]
    pub fn read() -> Word {
        let word;
        // SAFETY: copies the control register, which every aarch64 has, and touches nothing else.
        unsafe { asm!("mrs {}, fpcr", out(reg) word, options(nomem, nostack, preserves_flags)) };
        word
    }

    #[inline]
    pub fn write(word: Word) {
        // SAFETY: `word` was read from this register, with control bits cleared at most. Rust expects the default mode:
        // `DefaultMode` sets it, and gives back no other than it found.
        unsafe { asm!("msr fpcr, {}", in(reg) word, options(nostack, preserves_flags)) };
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod mode {
    pub type Word = u32;
    pub const CONTROL: Word = 0;
    pub const DEFAULT: Word = 0;

    pub fn read() -> Word {
        0
    }

    pub fn write(_word: Word) {}
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::{BatchSim, Results, SimConfig};
    use std::hint::black_box;

    /// Flush denormal results and take denormal operands as zero.
    const FLUSH: mode::Word = 0x8040;

    #[test]
    fn the_default_mode_holds_for_a_while_and_the_callers_comes_back() {
        let half = || black_box(f32::MIN_POSITIVE) * black_box(0.5);
        let before = mode::read();
        mode::write(before | FLUSH);
        let flushed = half();
        let kept = {
            let _mode = DefaultMode::set();
            half()
        };
        let (flushed_again, after) = (half(), mode::read());
        mode::write(before);
        assert_eq!((flushed, kept, flushed_again), (0.0, f32::MIN_POSITIVE / 2.0, 0.0));
        assert_eq!(after & mode::CONTROL, (before | FLUSH) & mode::CONTROL);
    }

    /// Speeds and actions so small that they are denormal numbers.
    #[test]
    #[allow(clippy::unwrap_used)]
    fn a_caller_that_flushes_denormals_gets_the_same_bits() {
        let mut config = SimConfig::from_json(include_str!("../../tests/defaults.json")).unwrap();
        config.robot.v_max = 1e-310;
        let run = |threads| -> Results {
            let mut sim = BatchSim::new(config.clone(), 4, 0, threads, true, None).unwrap();
            (0..20).for_each(|_| sim.step(&[0.5, 1e-40, 0.5, 0.5, -0.5, -1e-40, 1.0, 0.0]).unwrap());
            sim.results().clone()
        };
        let expected = run(1);
        assert!(expected.velocities.iter().filter(|v| v.is_subnormal()).count() == 4 && expected.velocities[1] != 0.0);
        let before = mode::read();
        mode::write(before | FLUSH);
        let flushed = [run(1), run(3)];
        mode::write(before);
        assert!(flushed.iter().all(|results| *results == expected));
    }
}
