//! What is chosen for the processor at run time: matrix products and loops over slices. The only module with unsafe code.
//!
//! Products come from the crate matrixmultiply, which picks its own instructions. The loops of [`crate::loops`] are
//! compiled for every instruction set of [`Isa`], give the same bits on each, and follow `NAVRL_ISA`.

#![allow(unsafe_code)]

use crate::adam::{Moments, Step};
use crate::loops;
use crate::real::Real;
pub use navsim::lidar::Isa;

/// A matrix in a slice.
#[derive(Debug, Clone, Copy)]
pub struct Matrix<'a, T> {
    values: &'a [T],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a, T> Matrix<'a, T> {
    /// `values` by rows of `columns` numbers each.
    ///
    /// # Panics
    /// If they are no whole number of rows.
    pub fn by_rows(values: &'a [T], columns: usize) -> Self {
        assert!(columns > 0 && values.len().is_multiple_of(columns), "{} values in rows of {columns}", values.len());
        Self { values, rows: values.len() / columns, columns, row_stride: columns, column_stride: 1 }
    }

    /// The same numbers with rows and columns exchanged.
    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// Numbers that can be multiplied as matrices.
pub trait Multiply: Copy + 'static {
    /// C = A B, where each matrix is a pointer with its row and column strides, and `sizes` are the rows of A, its
    /// columns, and the columns of B.
    ///
    /// # Safety
    /// Every element that the sizes and strides name lies within an allocation; those of C may be written, are no two
    /// the same, and are none of A or B.
    unsafe fn gemm(
        sizes: [usize; 3],
        a: (*const Self, [isize; 2]),
        b: (*const Self, [isize; 2]),
        c: (*mut Self, [isize; 2]),
    );
}

macro_rules! multiply {
    ($type:ident, $gemm:path, $zero:expr, $one:expr) => {
        impl Multiply for $type {
            unsafe fn gemm(
                [m, k, n]: [usize; 3],
                (a, [a_row, a_column]): (*const Self, [isize; 2]),
                (b, [b_row, b_column]): (*const Self, [isize; 2]),
                (c, [c_row, c_column]): (*mut Self, [isize; 2]),
            ) {
                // SAFETY: the caller promises what matrixmultiply asks for; with factor 0 it does not read C.
                unsafe { $gemm(m, k, n, $one, a, a_row, a_column, b, b_row, b_column, $zero, c, c_row, c_column) }
            }
        }
    };
}

multiply!(f32, matrixmultiply::sgemm, 0.0, 1.0);
multiply!(f64, matrixmultiply::dgemm, 0.0, 1.0);

/// Computes `product` = A B, by rows.
///
/// # Panics
/// If the sizes do not fit each other.
pub fn multiply<T: Multiply>(a: Matrix<'_, T>, b: Matrix<'_, T>, product: &mut [T]) {
    assert_eq!(a.columns, b.rows, "inner sizes of a product");
    assert_eq!(product.len(), a.rows * b.columns, "size of a product");
    assert_eq!(a.values.len(), a.rows * a.columns);
    assert_eq!(b.values.len(), b.rows * b.columns);
    // Slices have at most isize::MAX bytes, so that no stride overflows.
    let strides = |matrix: Matrix<'_, T>| [matrix.row_stride as isize, matrix.column_stride as isize];
    // SAFETY: by construction a matrix's strides are (columns, 1) or, transposed, (1, rows), so that its elements are
    // just the rows * columns numbers of its slice, whose length is checked above; those of `product` likewise, with
    // strides (columns, 1). `product` is borrowed mutably and therefore apart from A and B.
    unsafe {
        T::gemm(
            [a.rows, a.columns, b.columns],
            (a.values.as_ptr(), strides(a)),
            (b.values.as_ptr(), strides(b)),
            (product.as_mut_ptr(), [b.columns as isize, 1]),
        );
    }
}

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
    /// dL/dz from dL/dy in place, for y = relu(z) (units, batch); `sums` (units) takes its sums over the batch.
    through_relu(gradient: &mut [T], outputs: &[T], sums: &mut [T], batch: usize)
}
dispatched! {
    /// y = W x + b for a W (outputs, units) of few outputs; without `bias`, b = 0.
    narrow(weight: &[T], bias: Option<&[T]>, inputs: &[T], outputs: &mut [T], batch: usize)
}
dispatched! {
    /// dL/dW (outputs, units) = dL/dy x^T for few outputs.
    narrow_weights(upper: &[T], inputs: &[T], gradient: &mut [T], batch: usize)
}
dispatched! {
    /// dL/dx = W^T dL/dy (units, batch) for few outputs.
    narrow_inputs(weight: &[T], upper: &[T], gradient: &mut [T], batch: usize)
}
dispatched! {
    /// One step of Adam; see [`crate::adam`].
    adam(step: Step<T>, gradient: &[T], moments: Moments<'_, T>, parameters: &mut [T])
}
dispatched! {
    /// One step of Adam and the soft update of the targets (equation 10) with the new parameters.
    adam_and_follow(
        step: Step<T>, gradient: &[T], moments: Moments<'_, T>, parameters: &mut [T], targets: &mut [T], tau: T
    )
}
dispatched! {
    /// Whether no number is NaN or infinite.
    all_finite(numbers: &[T]) -> bool
}
