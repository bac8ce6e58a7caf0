//! The floating-point mode of a thread.

/// Round to nearest, denormal numbers as they are, for as long as this lives: results must not depend on what the
/// calling thread has chosen (a training loop flushes denormals), nor change it. Where the target is neither x86-64 nor
/// aarch64, the thread's own mode stays.
#[derive(Debug)]
pub(crate) struct DefaultMode {
    caller: register::Word,
    /// The mode belongs to the thread.
    not_send: std::marker::PhantomData<*const ()>,
}

impl DefaultMode {
    /// Sets the default mode on this thread.
    #[inline]
    pub fn set() -> Self {
        let caller = register::read();
        if caller & register::CONTROL != register::DEFAULT {
            register::write(caller & !register::CONTROL | register::DEFAULT);
        }
        Self { caller, not_send: std::marker::PhantomData }
    }
}

impl Drop for DefaultMode {
    fn drop(&mut self) {
        if self.caller & register::CONTROL != register::DEFAULT {
            register::write(self.caller);
        }
    }
}

/// The control register of SSE and AVX.
#[cfg(target_arch = "x86_64")]
mod register {
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
mod register {
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
mod register {
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
    const FLUSH: register::Word = 0x8040;

    #[test]
    fn the_default_mode_holds_for_a_while_and_the_callers_comes_back() {
        let half = || black_box(f32::MIN_POSITIVE) * black_box(0.5);
        let before = register::read();
        register::write(before | FLUSH);
        let flushed = half();
        let kept = {
            let _mode = DefaultMode::set();
            half()
        };
        let (flushed_again, after) = (half(), register::read());
        register::write(before);
        assert_eq!((flushed, kept, flushed_again), (0.0, f32::MIN_POSITIVE / 2.0, 0.0));
        assert_eq!(after & register::CONTROL, (before | FLUSH) & register::CONTROL);
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
        let before = register::read();
        register::write(before | FLUSH);
        let flushed = [run(1), run(3)];
        register::write(before);
        assert!(flushed.iter().all(|results| *results == expected));
    }
}
