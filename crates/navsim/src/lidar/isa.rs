//! Which instruction set a kernel runs on, chosen at run time. The only module of the crate with unsafe code.
//!
//! A wheel is built for plain x86-64; the kernels are compiled again for AVX2 and AVX-512 and give the same bits there.
//! The environment variable `NAVRL_ISA` (`baseline`, `avx2`, `avx512`) forces a lower one, for tests and comparisons.

#![allow(unsafe_code)]

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
dispatched!(add_noise => noise::add, (noise: &Noise, first_block: u32, ranges: &mut [f32]));
