//! Products of matrices.
//!
//! They run on tiles of fused multiply-adds where there is AVX2 or AVX-512, each element summed in one order, so that both
//! give the same bits; elsewhere they come from the crate matrixmultiply.

use super::Isa;

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

/// Sizes and strides of a product C = A B: C by rows, B by rows, A in any order.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    rows: usize,
    depth: usize,
    columns: usize,
    a_strides: [usize; 2],
    /// Numbers from one row of B to the next, and of C.
    b_stride: usize,
    c_stride: usize,
}

/// Numbers that can be multiplied as matrices.
pub trait Multiply: Copy + Default + 'static {
    /// C = A B on `isa`.
    ///
    /// # Safety
    /// Every element that `sizes` names lies within the allocation behind its pointer; those of C may be written, are no
    /// two the same, and are none of A or B.
    unsafe fn gemm(isa: Isa, sizes: Sizes, a: *const Self, b: *const Self, c: *mut Self);
}

/// Copies `columns` numbers of each row of a matrix, with a stride of `width`; the rest of each row becomes 0.
fn padded<T: Multiply>(first: &[T], stride: usize, rows: usize, columns: usize, width: usize) -> Vec<T> {
    let mut copy = vec![T::default(); rows * width];
    for (to, from) in copy.chunks_exact_mut(width).zip(first.chunks(stride)) {
        to[..columns].copy_from_slice(&from[..columns]);
    }
    copy
}

/// Makes a product of tiles for one type and instruction set: of `$rows` rows, or one, of up to `$vectors`
/// vectors of `$lanes` numbers each, as many as its registers hold.
#[cfg(target_arch = "x86_64")]
macro_rules! tiles {
    ($name:ident: $type:ident, $features:literal, $rows:literal rows of $vectors:literal vectors of $lanes:literal,
     $zero:ident, $load:ident, $store:ident, $splat:ident, $fma:ident) => {
        mod $name {
            use super::{Sizes, padded};
            use std::arch::x86_64::*;

            /// R rows of V vectors of C.
            ///
            /// # Safety
            /// As of `Multiply::gemm`, for sizes of R rows and V vectors of columns.
            #[target_feature(enable = $features)]
            unsafe fn tile<const R: usize, const V: usize>(s: Sizes, a: *const $type, b: *const $type, c: *mut $type) {
                let mut sums = [[$zero(); V]; R];
                for k in 0..s.depth {
                    let mut row = [$zero(); V];
                    for (j, vector) in row.iter_mut().enumerate() {
                        // SAFETY: row k < depth of B, vector j < V of its columns.
                        *vector = unsafe { $load(b.add(k * s.b_stride + j * $lanes)) };
                    }
                    for (i, sums) in sums.iter_mut().enumerate() {
                        // SAFETY: element (i, k) of A, i < R and k < depth.
                        let factor = $splat(unsafe { *a.add(i * s.a_strides[0] + k * s.a_strides[1]) });
                        for (sum, &vector) in sums.iter_mut().zip(&row) {
                            *sum = $fma(factor, vector, *sum);
                        }
                    }
                }
                for (i, sums) in sums.iter().enumerate() {
                    for (j, &sum) in sums.iter().enumerate() {
                        // SAFETY: row i < R of C, vector j < V of its columns.
                        unsafe { $store(c.add(i * s.c_stride + j * $lanes), sum) };
                    }
                }
            }

            /// All rows of V vectors of C.
            ///
            /// # Safety
            /// As of `Multiply::gemm`, for V vectors of columns.
            #[target_feature(enable = $features)]
            unsafe fn panel<const V: usize>(s: Sizes, a: *const $type, b: *const $type, c: *mut $type) {
                let mut row = 0;
                while row < s.rows {
                    // SAFETY: the rows from `row` on, as many as the tile has, are rows of A and C.
                    unsafe {
                        let (a, c) = (a.add(row * s.a_strides[0]), c.add(row * s.c_stride));
                        if s.rows - row >= $rows {
                            tile::<$rows, V>(s, a, b, c);
                            row += $rows;
                        } else {
                            tile::<1, V>(s, a, b, c);
                            row += 1;
                        }
                    }
                }
            }

            /// The whole product; a last part of a vector goes through copies that fill one.
            ///
            /// # Safety
            /// As of `Multiply::gemm`.
            #[target_feature(enable = $features)]
            pub unsafe fn product(s: Sizes, a: *const $type, b: *const $type, c: *mut $type) {
                let mut first = 0;
                while s.columns - first >= $lanes {
                    // SAFETY: the columns from `first` on, as many as the panel has, are columns of B and C.
                    unsafe {
                        let (b, c) = (b.add(first), c.add(first));
                        let vectors = match (s.columns - first) / $lanes {
                            1 => {
                                panel::<1>(s, a, b, c);
                                1
                            }
                            2 | 4 => {
                                panel::<2>(s, a, b, c);
                                2
                            }
                            _ => {
                                panel::<$vectors>(s, a, b, c);
                                $vectors
                            }
                        };
                        first += vectors * $lanes;
                    }
                }
                let rest = s.columns - first;
                if rest > 0 {
                    // SAFETY: from column `first` of the first row on, the last row ends `rest` numbers after its start there.
                    let b = unsafe { std::slice::from_raw_parts(b.add(first), (s.depth - 1) * s.b_stride + rest) };
                    let b = padded(b, s.b_stride, s.depth, rest, $lanes);
                    let mut copy = vec![$type::default(); s.rows * $lanes];
                    let inner = Sizes { columns: $lanes, b_stride: $lanes, c_stride: $lanes, ..s };
                    // SAFETY: B and C are the copies, of one vector's columns.
                    unsafe { panel::<1>(inner, a, b.as_ptr(), copy.as_mut_ptr()) };
                    for (row, numbers) in copy.chunks_exact($lanes).enumerate() {
                        // SAFETY: the last `rest` columns of a row of C.
                        let to = unsafe { std::slice::from_raw_parts_mut(c.add(row * s.c_stride + first), rest) };
                        to.copy_from_slice(&numbers[..rest]);
                    }
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
tiles!(f32_avx512: f32, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma", 8 rows of 3 vectors of 16,
    _mm512_setzero_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_set1_ps, _mm512_fmadd_ps);
#[cfg(target_arch = "x86_64")]
tiles!(f64_avx512: f64, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma", 8 rows of 3 vectors of 8,
    _mm512_setzero_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_set1_pd, _mm512_fmadd_pd);
#[cfg(target_arch = "x86_64")]
tiles!(f32_avx2: f32, "avx2,fma", 6 rows of 2 vectors of 8,
    _mm256_setzero_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_set1_ps, _mm256_fmadd_ps);
#[cfg(target_arch = "x86_64")]
tiles!(f64_avx2: f64, "avx2,fma", 6 rows of 2 vectors of 4,
    _mm256_setzero_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_set1_pd, _mm256_fmadd_pd);

macro_rules! multiply {
    ($type:ident, $gemm:path, $avx2:ident, $avx512:ident) => {
        impl Multiply for $type {
            unsafe fn gemm(isa: Isa, s: Sizes, a: *const Self, b: *const Self, c: *mut Self) {
                #[cfg(target_arch = "x86_64")]
                if std::is_x86_feature_detected!("fma") {
                    match isa.min(Isa::detect()) {
                        // SAFETY: the caller's promise; `detect` and the line above test each feature.
                        Isa::Avx512 => return unsafe { $avx512::product(s, a, b, c) },
                        // SAFETY: as above.
                        Isa::Avx2 => return unsafe { $avx2::product(s, a, b, c) },
                        Isa::Baseline => {}
                    }
                }
                let _ = isa;
                // Slices have at most isize::MAX bytes, so that no stride overflows.
                let [a_row, a_column] = s.a_strides.map(|stride| stride as isize);
                let (b_row, c_row) = (s.b_stride as isize, s.c_stride as isize);
                // SAFETY: the caller's promise is what matrixmultiply asks for; with factor 0 it does not read C.
                unsafe { $gemm(s.rows, s.depth, s.columns, 1.0, a, a_row, a_column, b, b_row, 1, 0.0, c, c_row, 1) }
            }
        }
    };
}

multiply!(f32, matrixmultiply::sgemm, f32_avx2, f32_avx512);
multiply!(f64, matrixmultiply::dgemm, f64_avx2, f64_avx512);

/// Computes `product` = A B, by rows.
///
/// # Panics
/// If the sizes do not fit each other.
pub fn multiply<T: Multiply>(isa: Isa, a: Matrix<'_, T>, b: Matrix<'_, T>, product: &mut [T]) {
    assert!(a.columns == b.rows && a.columns > 0, "inner sizes of a product");
    assert!(product.len() == a.rows * b.columns && b.columns > 0, "size of a product");
    assert!(a.values.len() == a.rows * a.columns && b.values.len() == b.rows * b.columns, "sizes of factors");
    let turned;
    let b_values = if b.column_stride == 1 {
        b.values
    } else {
        turned = by_rows(b);
        &turned
    };
    let sizes = Sizes {
        rows: a.rows,
        depth: a.columns,
        columns: b.columns,
        a_strides: [a.row_stride, a.column_stride],
        b_stride: b.columns,
        c_stride: b.columns,
    };
    // SAFETY: by construction a matrix's strides are (columns, 1) or, transposed, (1, rows), so that its elements are
    // just the rows * columns numbers of its slice, whose length is checked above; B and `product` lie by rows.
    // `product` is borrowed mutably and therefore apart from A and B.
    unsafe { T::gemm(isa, sizes, a.values.as_ptr(), b_values.as_ptr(), product.as_mut_ptr()) }
}

/// A transposed matrix's numbers by its rows, copied in squares that stay in the cache.
fn by_rows<T: Multiply>(matrix: Matrix<'_, T>) -> Vec<T> {
    const SIDE: usize = 16;
    let (rows, columns) = (matrix.rows, matrix.columns);
    let mut copy = vec![T::default(); rows * columns];
    for top in (0..rows).step_by(SIDE) {
        for left in (0..columns).step_by(SIDE) {
            let right = columns.min(left + SIDE);
            for row in top..rows.min(top + SIDE) {
                for (column, to) in (left..right).zip(&mut copy[row * columns + left..row * columns + right]) {
                    *to = matrix.values[column * rows + row];
                }
            }
        }
    }
    copy
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(count: usize, seed: f64) -> Vec<f64> {
        (0..count).map(|i| (seed + 1.7 * i as f64).sin()).collect()
    }

    fn naive(a: &[f64], b: &[f64], [rows, depth, columns]: [usize; 3]) -> Vec<f64> {
        let element = |i: usize, j: usize| (0..depth).map(|k| a[i * depth + k] * b[k * columns + j]).sum();
        (0..rows * columns).map(|place| element(place / columns, place % columns)).collect()
    }

    fn turned(values: &[f64], columns: usize) -> Vec<f64> {
        let rows = values.len() / columns;
        (0..values.len()).map(|place| values[place % rows * columns + place / rows]).collect()
    }

    #[test]
    fn products_of_all_sizes_orders_and_instruction_sets() {
        for sizes in [[1, 1, 1], [2, 3, 5], [8, 7, 16], [9, 4, 17], [13, 26, 96], [16, 5, 64], [23, 31, 41], [6, 1, 7]]
        {
            let [rows, depth, columns] = sizes;
            let (a, b) = (numbers(rows * depth, 0.3), numbers(depth * columns, 0.8));
            let (a_turned, b_turned) = (turned(&a, depth), turned(&b, columns));
            let expected = naive(&a, &b, sizes);
            for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512] {
                for order in 0..4 {
                    let by_rows = (Matrix::by_rows(&a, depth), Matrix::by_rows(&b, columns));
                    let turned = (Matrix::by_rows(&a_turned, rows), Matrix::by_rows(&b_turned, depth));
                    let a = if order & 1 == 0 { by_rows.0 } else { turned.0.transposed() };
                    let b = if order & 2 == 0 { by_rows.1 } else { turned.1.transposed() };
                    let mut product = vec![f64::NAN; rows * columns];
                    multiply(isa, a, b, &mut product);
                    for (got, expected) in product.iter().zip(&expected) {
                        assert!((got - expected).abs() < 1e-13, "{sizes:?} {isa:?} {order}: {got} {expected}");
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "inner sizes")]
    fn a_product_of_sizes_that_do_not_fit_panics() {
        multiply(Isa::Baseline, Matrix::by_rows(&[1.0; 6], 3), Matrix::by_rows(&[1.0; 8], 4), &mut [0.0; 8]);
    }

    #[test]
    #[should_panic(expected = "inner sizes")]
    fn a_product_over_nothing_panics() {
        let empty: [f32; 0] = [];
        multiply(Isa::Avx2, Matrix::by_rows(&empty, 3).transposed(), Matrix::by_rows(&empty, 4), &mut [0.0; 12]);
    }
}
