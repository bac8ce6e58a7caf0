//! What is chosen for the processor at run time: matrix products ([`product`]) and loops over slices. The only module
//! with unsafe code.
//!
//! The loops are compiled for every instruction set of [`Isa`] and give the same bits on each. Products are for AVX2
//! with FMA and for AVX-512; elsewhere the crate matrixmultiply makes them, with what it finds the processor to have.
//! All but that follows `NAVRL_ISA`.

#![allow(unsafe_code)]

mod loops;
pub mod matrix;
pub mod product;

use crate::adam::{Step, Vectors};
use crate::real::Real;
pub use loops::SUMS;
pub use navsim::cpu::Isa;

/// Compiles a loop for every instruction set and calls the body that `isa` names.
macro_rules! dispatched {
    ($(#[$doc:meta])* $name:ident($($argument:ident: $type:ty),*) $(-> $result:ty)?) => {
        $(#[$doc])*
        pub fn $name<T: Real>(isa: Isa, $($argument: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,bmi2")]
                fn avx2<T: Real>($($argument: $type),*) $(-> $result)? {
                    loops::$name($($argument),*)
                }
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi2")]
                fn avx512<T: Real>($($argument: $type),*) $(-> $result)? {
                    loops::$name($($argument),*)
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
            loops::$name($($argument),*)
        }
    };
}

dispatched! {
    /// z = relu(z + b) for `z` (units, batch) and `b` (units); NaN stays.
    bias_relu(z: &mut [T], bias: &[T], batch: usize)
}
dispatched! {
    /// z = relu(z + W_a^T a + b) for `z` (units, batch), `weight` W_a (2, units), `actions` (2, batch) and b (units).
    combined_relu(z: &mut [T], bias: &[T], weight: &[T], actions: &[T], batch: usize)
}
dispatched! {
    /// dL/dz from dL/dy in place, for y = relu(z) (units, batch); `sums` (units) takes its sums over the first `cut`
    /// of the batch plus those over the others.
    through_relu(gradient: &mut [T], outputs: &[T], sums: &mut [T], batch: usize, cut: usize)
}
dispatched! {
    /// y = W x + b for a W (outputs, units) of few outputs; without `bias`, b = 0.
    narrow(weight: &[T], bias: Option<&[T]>, inputs: &[T], outputs: &mut [T], batch: usize)
}
dispatched! {
    /// dL/dW (outputs, units) = dL/dy x^T for few outputs, summed as in `through_relu`.
    narrow_weights(upper: &[T], inputs: &[T], gradient: &mut [T], batch: usize, cut: usize)
}
dispatched! {
    /// dL/dx = W^T dL/dy (units, batch) for few outputs.
    narrow_inputs(weight: &[T], upper: &[T], gradient: &mut [T], batch: usize)
}
dispatched! {
    /// One step of Adam with the sum of two gradients, of which the second may be empty; see [`crate::adam`]. With
    /// `tau` the targets follow the new parameters (equation 10).
    adam(step: Step<T>, gradients: [&[T]; 2], vectors: Vectors<'_, T>, tau: Option<T>)
}
dispatched! {
    /// Whether no number is NaN or infinite in some rows of `width` numbers each.
    rows_finite(numbers: &[T], width: usize, rows: &[i64]) -> bool
}
dispatched! {
    /// Whether no number is NaN or infinite.
    all_finite(numbers: &[T]) -> bool
}
dispatched! {
    /// Whether no number is NaN or so large that the sum of two might be infinite.
    all_bounded(numbers: &[T]) -> bool
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_number_that_is_not_finite_is_found_anywhere() {
        for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512] {
            for place in [0, 15, 63, 64, 99] {
                for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                    let mut numbers = vec![f32::MAX; 100];
                    assert!(all_finite(isa, &numbers));
                    numbers[place] = bad;
                    assert!(!all_finite(isa, &numbers), "{bad} in {place}");
                }
            }
        }
    }

    #[test]
    fn tiny_moments_become_zero() {
        let step = Step::<f32>::new(1e-3, 10);
        let (mut first, mut second, mut p) = ([1e-36, 1e-20], [1e-37, 1e-20], [0.5, 0.5]);
        let vectors = Vectors { parameters: &mut p, targets: &mut [], first: &mut first, second: &mut second };
        adam(Isa::Avx512, step, [&[1e-37, 0.0], &[]], vectors, None);
        assert_eq!((first[0], second[0], p[0]), (0.0, 0.0, 0.5));
        assert!(first[1] > 0.0 && second[1] > 0.0);
    }

    #[test]
    fn adam_by_hand() {
        // t = 1: m = 0.1 g, v = 0.001 g^2, so that the step is lr g / (|g| + eps).
        for gradients in [[vec![-2.0], vec![]], [vec![1.5], vec![-3.5]]] {
            let (mut first, mut second, mut p, mut target) = ([0.0], [0.0], [1.0], [3.0]);
            let vectors = Vectors { parameters: &mut p, targets: &mut target, first: &mut first, second: &mut second };
            adam(Isa::Baseline, Step::new(0.1, 1), gradients.each_ref().map(Vec::as_slice), vectors, Some(0.5));
            assert!((p[0] - 1.1_f64).abs() < 1e-8 && (target[0] - 2.05).abs() < 1e-8);
            assert!((first[0] + 0.2).abs() < 1e-15 && (second[0] - 0.004).abs() < 1e-15);
        }
    }
}
