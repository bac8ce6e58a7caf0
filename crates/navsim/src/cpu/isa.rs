//! Instruction sets, and kernels that are compiled for each of them.
//!
//! A wheel is built for plain x86-64; the kernels are compiled again for AVX2 and AVX-512 and give the same bits there.
//! The environment variable `NAVRL_ISA` (`baseline`, `avx2`, `avx512`) forces a lower one, for tests and comparisons.

use crate::error::{Error, Result};

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

    /// Those that this machine has, the lowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        [Self::Baseline, Self::Avx2, Self::Avx512].into_iter().filter(|isa| *isa <= Self::detect())
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

/// An instruction set that this machine has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dispatch(Isa);

/// Work that is compiled for every instruction set.
pub(crate) trait Kernel {
    /// Does it. Implementations, and what they call, are `#[inline(always)]`: only what is inlined is compiled again.
    fn run(self);
}

impl Dispatch {
    /// To the body for `isa`, or for the machine's best if that is lower.
    pub fn new(isa: Isa) -> Self {
        Self(isa.min(Isa::detect()))
    }

    /// Runs the body of `kernel` that was compiled for it.
    #[inline]
    pub fn run(self, kernel: impl Kernel) {
        #[cfg(target_arch = "x86_64")]
        match self.0 {
            // SAFETY: `new` lets no instruction set pass that is above what `detect` found on this machine, and
            // `detect` asks for each of the features.
            Isa::Avx512 => return unsafe { avx512(kernel) },
            // SAFETY: as above.
            Isa::Avx2 => return unsafe { avx2(kernel) },
            Isa::Baseline => {}
        }
        kernel.run();
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi2")]
fn avx2(kernel: impl Kernel) {
    kernel.run();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi2")]
fn avx512(kernel: impl Kernel) {
    kernel.run();
}
