//! Products of matrices.
//!
//! They run on tiles of fused multiply-adds where there is AVX2 or AVX-512, each element summed in one order, so that
//! both give the same bits; elsewhere they come from the crate matrixmultiply.

use super::Isa;
use super::matrix::Matrix;

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
    /// Whether the sums begin with what C holds instead of 0.
    onto: bool,
    /// Where a second sum begins, which is added to the first at the end; `depth` where there is none.
    cut: usize,
}

/// How the elements of a product are summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sum {
    /// From 0 on.
    Whole,
    /// Two sums from 0 on, over the inner places below a number and over the rest, then added.
    Parts(usize),
    /// From what is there on: as `Whole` over the inner places of both products.
    Onto,
}

/// Numbers that can be multiplied as matrices.
pub trait Multiply: Copy + Default + 'static {
    /// C = A B on `isa`.
    ///
    /// # Safety
    /// Every element that `sizes` names lies within the allocation behind its pointer; those of C may be written, are
    /// no two the same, and are none of A or B.
    unsafe fn gemm(isa: Isa, sizes: Sizes, a: *const Self, b: *const Self, c: *mut Self);
}

/// Makes a product of tiles for one type and instruction set: of `$rows` rows, or one, of up to `$vectors` vectors of
/// `$lanes` numbers each, as many as its registers hold. Where the columns end within a vector, `$mask` (from their
/// number) tells `$load_part` and `$store_part` which numbers of the last vector there are; `$fma_low` is enough where all
/// lie in its lower half, which some processors compute in half the time.
#[cfg(target_arch = "x86_64")]
macro_rules! tiles {
    ($name:ident: $type:ident, $features:literal, $rows:literal rows of $vectors:literal vectors of $lanes:literal,
     $zero:ident, $load:ident, $store:ident, $splat:ident, $add:ident, $fma:ident, $fma_low:ident,
     $mask:ident -> $masks:ty, $load_part:ident, $store_part:ident) => {
        mod $name {
            use super::Sizes;
            #[allow(unused_imports, reason = "each uses the ways to mask of its own instruction set")]
            use super::parts::*;
            use std::arch::x86_64::*;

            /// R rows of V vectors of C, of which the last has only the numbers of `mask` if PART, all in its lower half
            /// if LOW.
            ///
            /// # Safety
            /// As of `Multiply::gemm`, for sizes of R rows and these columns.
            #[target_feature(enable = $features)]
            unsafe fn tile<const R: usize, const V: usize, const PART: bool, const LOW: bool>(
                s: Sizes,
                a: *const $type,
                b: *const $type,
                c: *mut $type,
                mask: $masks,
            ) {
                let mut sums = [[$zero(); V]; R];
                if s.onto {
                    for (i, sums) in sums.iter_mut().enumerate() {
                        for (j, sum) in sums.iter_mut().enumerate() {
                            // SAFETY: row i < R of C, vector j < V of its columns, or the part of it that there is.
                            *sum = unsafe {
                                let place = c.add(i * s.c_stride + j * $lanes);
                                if PART && j == V - 1 { $load_part(mask, place) } else { $load(place) }
                            };
                        }
                    }
                }
                let add_products = |sums: &mut [[_; V]; R], from: usize, to: usize| {
                    for k in from..to {
                        // What the next tile reads of A sets out from the outer caches. After the last tile that is nothing,
                        // which a prefetch does not mind.
                        let next = a.wrapping_add((R + k % R) * s.a_strides[0] + k * s.a_strides[1]);
                        _mm_prefetch::<_MM_HINT_T1>(next.cast());
                        let mut row = [$zero(); V];
                        for (j, vector) in row.iter_mut().enumerate() {
                            // SAFETY: row k < depth of B, vector j < V of its columns, or the part that there is.
                            *vector = unsafe {
                                let place = b.add(k * s.b_stride + j * $lanes);
                                if PART && j == V - 1 { $load_part(mask, place) } else { $load(place) }
                            };
                        }
                        for (i, sums) in sums.iter_mut().enumerate() {
                            // SAFETY: element (i, k) of A, i < R and k < depth.
                            let factor = $splat(unsafe { *a.add(i * s.a_strides[0] + k * s.a_strides[1]) });
                            for (j, (sum, &vector)) in sums.iter_mut().zip(&row).enumerate() {
                                let low = LOW && j == V - 1;
                                *sum = if low { $fma_low(factor, vector, *sum) } else { $fma(factor, vector, *sum) };
                            }
                        }
                    }
                };
                add_products(&mut sums, 0, s.cut);
                if s.cut < s.depth {
                    let first = sums;
                    sums = [[$zero(); V]; R];
                    add_products(&mut sums, s.cut, s.depth);
                    for (sum, &first) in sums.as_flattened_mut().iter_mut().zip(first.as_flattened()) {
                        *sum = $add(first, *sum);
                    }
                }
                for (i, sums) in sums.iter().enumerate() {
                    for (j, &sum) in sums.iter().enumerate() {
                        // SAFETY: row i < R of C, vector j < V of its columns, or the part of it that there is.
                        unsafe {
                            let place = c.add(i * s.c_stride + j * $lanes);
                            if PART && j == V - 1 { $store_part(place, mask, sum) } else { $store(place, sum) }
                        }
                    }
                }
            }

            /// All rows of V vectors of C, the last one as in `tile`.
            ///
            /// # Safety
            /// As of `Multiply::gemm`, for these columns.
            #[target_feature(enable = $features)]
            unsafe fn panel<const V: usize, const PART: bool, const LOW: bool>(
                s: Sizes,
                a: *const $type,
                b: *const $type,
                c: *mut $type,
                mask: $masks,
            ) {
                let mut row = 0;
                while row < s.rows {
                    // SAFETY: the rows from `row` on, as many as the tile has, are rows of A and C.
                    unsafe {
                        let (a, c) = (a.add(row * s.a_strides[0]), c.add(row * s.c_stride));
                        if s.rows - row >= $rows {
                            tile::<$rows, V, PART, LOW>(s, a, b, c, mask);
                            row += $rows;
                        } else {
                            tile::<1, V, PART, LOW>(s, a, b, c, mask);
                            row += 1;
                        }
                    }
                }
            }

            /// The whole product.
            ///
            /// # Safety
            /// As of `Multiply::gemm`.
            #[target_feature(enable = $features)]
            pub unsafe fn product(s: Sizes, a: *const $type, b: *const $type, c: *mut $type) {
                let (mut first, mask) = (0, $mask(s.columns % $lanes));
                while first < s.columns {
                    let left = s.columns - first;
                    let vectors = match left.div_ceil($lanes) {
                        1 => 1,
                        2 | 4 => 2,
                        _ => $vectors,
                    };
                    // SAFETY: the columns from `first` on, as many as the panel has, are columns of B and C.
                    unsafe {
                        let (b, c) = (b.add(first), c.add(first));
                        match (vectors, left < vectors * $lanes, 2 * left <= (2 * vectors - 1) * $lanes) {
                            (1, false, _) => panel::<1, false, false>(s, a, b, c, mask),
                            (1, true, false) => panel::<1, true, false>(s, a, b, c, mask),
                            (1, true, true) => panel::<1, true, true>(s, a, b, c, mask),
                            (2, false, _) => panel::<2, false, false>(s, a, b, c, mask),
                            (2, true, false) => panel::<2, true, false>(s, a, b, c, mask),
                            (2, true, true) => panel::<2, true, true>(s, a, b, c, mask),
                            (_, false, _) => panel::<$vectors, false, false>(s, a, b, c, mask),
                            (_, true, false) => panel::<$vectors, true, false>(s, a, b, c, mask),
                            (_, true, true) => panel::<$vectors, true, true>(s, a, b, c, mask),
                        }
                    }
                    first += vectors * $lanes;
                }
            }
        }
    };
}

/// Vectors of which only the first numbers are there.
#[cfg(target_arch = "x86_64")]
mod parts {
    use std::arch::x86_64::*;

    /// For f32 with AVX-512.
    pub fn first_16(count: usize) -> __mmask16 {
        (1 << count) - 1
    }

    /// For f64 with AVX-512.
    pub fn first_8(count: usize) -> __mmask8 {
        (1 << count) - 1
    }

    /// `_mm512_fmadd_ps` of the lower halves; what the upper half of the result holds is never stored.
    #[target_feature(enable = "avx512f,fma")]
    pub fn fma_low_ps(a: __m512, b: __m512, c: __m512) -> __m512 {
        let [a, b, c] = [_mm512_castps512_ps256(a), _mm512_castps512_ps256(b), _mm512_castps512_ps256(c)];
        _mm512_castps256_ps512(_mm256_fmadd_ps(a, b, c))
    }

    /// `_mm512_fmadd_pd` of the lower halves, in the same way.
    #[target_feature(enable = "avx512f,fma")]
    pub fn fma_low_pd(a: __m512d, b: __m512d, c: __m512d) -> __m512d {
        let [a, b, c] = [_mm512_castpd512_pd256(a), _mm512_castpd512_pd256(b), _mm512_castpd512_pd256(c)];
        _mm512_castpd256_pd512(_mm256_fmadd_pd(a, b, c))
    }

    /// For f32 with AVX2.
    #[target_feature(enable = "avx2")]
    pub fn first_of_8(count: usize) -> __m256i {
        _mm256_cmpgt_epi32(_mm256_set1_epi32(count as i32), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
    }

    /// For f64 with AVX2.
    #[target_feature(enable = "avx2")]
    pub fn first_of_4(count: usize) -> __m256i {
        _mm256_cmpgt_epi64(_mm256_set1_epi64x(count as i64), _mm256_setr_epi64x(0, 1, 2, 3))
    }

    /// `_mm256_maskload_ps` with its arguments as those of AVX-512 lie.
    ///
    /// # Safety
    /// The numbers that the mask names may be read.
    #[target_feature(enable = "avx2")]
    pub unsafe fn load_part_ps(mask: __m256i, place: *const f32) -> __m256 {
        // SAFETY: the caller's promise.
        unsafe { _mm256_maskload_ps(place, mask) }
    }

    /// `_mm256_maskload_pd`, in the same way.
    ///
    /// # Safety
    /// The numbers that the mask names may be read.
    #[target_feature(enable = "avx2")]
    pub unsafe fn load_part_pd(mask: __m256i, place: *const f64) -> __m256d {
        // SAFETY: the caller's promise.
        unsafe { _mm256_maskload_pd(place, mask) }
    }
}

#[cfg(target_arch = "x86_64")]
tiles!(f32_avx512: f32, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma", 8 rows of 3 vectors of 16,
    _mm512_setzero_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_set1_ps, _mm512_add_ps, _mm512_fmadd_ps,
    fma_low_ps, first_16 -> __mmask16, _mm512_maskz_loadu_ps, _mm512_mask_storeu_ps);
#[cfg(target_arch = "x86_64")]
tiles!(f64_avx512: f64, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma", 8 rows of 3 vectors of 8,
    _mm512_setzero_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_set1_pd, _mm512_add_pd, _mm512_fmadd_pd,
    fma_low_pd, first_8 -> __mmask8, _mm512_maskz_loadu_pd, _mm512_mask_storeu_pd);
#[cfg(target_arch = "x86_64")]
tiles!(f32_avx2: f32, "avx2,fma", 6 rows of 2 vectors of 8,
    _mm256_setzero_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_set1_ps, _mm256_add_ps, _mm256_fmadd_ps,
    _mm256_fmadd_ps, first_of_8 -> __m256i, load_part_ps, _mm256_maskstore_ps);
#[cfg(target_arch = "x86_64")]
tiles!(f64_avx2: f64, "avx2,fma", 6 rows of 2 vectors of 4,
    _mm256_setzero_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_set1_pd, _mm256_add_pd, _mm256_fmadd_pd,
    _mm256_fmadd_pd, first_of_4 -> __m256i, load_part_pd, _mm256_maskstore_pd);

macro_rules! multiply {
    ($type:ident, $gemm:path, $avx2:ident, $avx512:ident) => {
        impl Multiply for $type {
            unsafe fn gemm(isa: Isa, s: Sizes, a: *const Self, b: *const Self, c: *mut Self) {
                #[cfg(target_arch = "x86_64")]
                if in_order(isa) {
                    match isa.min(Isa::detect()) {
                        // SAFETY: the caller's promise; `detect` and `in_order` test each feature.
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
                let (factor, rest) = (if s.onto { 1.0 } else { 0.0 }, s.depth - s.cut);
                // SAFETY: the caller's promise is what matrixmultiply asks for; with factor 0 it does not read C.
                unsafe { $gemm(s.rows, s.cut, s.columns, 1.0, a, a_row, a_column, b, b_row, 1, factor, c, c_row, 1) }
                if rest == 0 {
                    return;
                }
                let mut second = vec![0.0; s.rows * s.columns];
                // SAFETY: as above, from inner place `cut` < depth on; `second` has as many elements as C.
                unsafe {
                    let (a, b) = (a.add(s.cut * s.a_strides[1]), b.add(s.cut * s.b_stride));
                    let (c, c_row) = (second.as_mut_ptr(), s.columns as isize);
                    $gemm(s.rows, rest, s.columns, 1.0, a, a_row, a_column, b, b_row, 1, 0.0, c, c_row, 1);
                }
                for (i, row) in second.chunks_exact(s.columns).enumerate() {
                    for (j, x) in row.iter().enumerate() {
                        // SAFETY: element (i, j) of C.
                        unsafe { *c.add(i * s.c_stride + j) += x }
                    }
                }
            }
        }
    };
}

/// Whether every element of a product is summed in one order on `isa`, whatever the other columns (which matrixmultiply
/// does, too) and pieces of the sum, so that [`Sum::Onto`] keeps its promise to the
/// bit.
pub fn in_order(isa: Isa) -> bool {
    #[cfg(target_arch = "x86_64")]
    return isa.min(Isa::detect()) >= Isa::Avx2 && std::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

multiply!(f32, matrixmultiply::sgemm, f32_avx2, f32_avx512);
multiply!(f64, matrixmultiply::dgemm, f64_avx2, f64_avx512);

/// Computes `product` = A B, by rows; B lies by rows, A in any order.
///
/// # Panics
/// If the sizes do not fit each other, or B lies by columns, or the second part of a sum begins beyond its end.
pub fn multiply<T: Multiply>(isa: Isa, a: Matrix<'_, T>, b: Matrix<'_, T>, sum: Sum, product: &mut [T]) {
    assert!(a.columns == b.rows && a.columns > 0, "inner sizes of a product");
    assert!(a.rows > 0 && b.columns > 0 && a.rows.checked_mul(b.columns) == Some(product.len()), "size of a product");
    assert!(b.column_stride == 1, "order of a factor");
    let cut = if let Sum::Parts(cut) = sum { cut } else { a.columns };
    assert!((1..=a.columns).contains(&cut), "parts of a sum");
    for factor in [a, b] {
        let [down, across] = [(factor.rows, factor.row_stride), (factor.columns, factor.column_stride)]
            .map(|(count, stride)| (count - 1).checked_mul(stride));
        let last = down.zip(across).and_then(|(down, across)| down.checked_add(across));
        assert!(last.is_some_and(|last| last < factor.values.len()), "size of a factor");
    }
    let sizes = Sizes {
        rows: a.rows,
        depth: a.columns,
        columns: b.columns,
        a_strides: [a.row_stride, a.column_stride],
        b_stride: b.row_stride,
        c_stride: b.columns,
        onto: sum == Sum::Onto,
        cut,
    };
    // SAFETY: the last element of A and of B lies within its slice, as checked above, and no stride is negative, so
    // that all others do; `product` has a place for each element of C. It is borrowed mutably and therefore apart from
    // A and B.
    unsafe { T::gemm(isa, sizes, a.values.as_ptr(), b.values.as_ptr(), product.as_mut_ptr()) }
}

#[cfg(test)]
mod tests {
    use super::super::matrix::transpose;
    use super::*;

    fn numbers(count: usize, seed: f64) -> Vec<f64> {
        (0..count).map(|i| (seed + 1.7 * i as f64).sin()).collect()
    }

    fn naive(a: &[f64], b: &[f64], [rows, depth, columns]: [usize; 3]) -> Vec<f64> {
        let element = |i: usize, j: usize| (0..depth).map(|k| a[i * depth + k] * b[k * columns + j]).sum();
        (0..rows * columns).map(|place| element(place / columns, place % columns)).collect()
    }

    #[test]
    fn products_of_all_sizes_orders_and_instruction_sets() {
        for sizes in [
            [1, 1, 1],
            [2, 3, 5],
            [8, 7, 16],
            [9, 4, 17],
            [13, 26, 96],
            [16, 5, 64],
            [23, 31, 41],
            [9, 12, 40],
            [6, 1, 7],
        ] {
            let [rows, depth, columns] = sizes;
            let (a, b) = (numbers(rows * depth, 0.3), numbers(depth * columns, 0.8));
            let mut a_turned = vec![f64::NAN; a.len()];
            transpose(&a, depth, &mut a_turned);
            let b_wide: Vec<f64> = b.chunks(columns).flat_map(|row| [row, &[f64::NAN; 3]].concat()).collect();
            let expected = naive(&a, &b, sizes);
            for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512] {
                for order in 0..4 {
                    let by_rows = (Matrix::by_rows(&a, depth), Matrix::by_rows(&b, columns));
                    let a = if order & 1 == 0 { by_rows.0 } else { Matrix::by_rows(&a_turned, rows).transposed() };
                    let b =
                        if order & 2 == 0 { by_rows.1 } else { Matrix::first_columns(&b_wide, columns, columns + 3) };
                    let mut product = vec![f64::NAN; rows * columns];
                    multiply(isa, a, b, Sum::Whole, &mut product);
                    for (got, expected) in product.iter().zip(&expected) {
                        assert!((got - expected).abs() < 1e-13, "{sizes:?} {isa:?} {order}: {got} {expected}");
                    }
                }
            }
        }
    }

    /// A by columns, so that a part of its columns is a slice.
    fn product<T: Multiply>(isa: Isa, a: &[T], b: &[T], [rows, columns]: [usize; 2], sum: Sum, product: &mut [T]) {
        multiply(isa, Matrix::by_rows(a, rows).transposed(), Matrix::by_rows(b, columns), sum, product);
    }

    #[test]
    fn sums_in_parts_are_two_products_added_and_onto_goes_on_with_one() {
        for [rows, depth, columns, cut] in
            [[1, 2, 1, 1], [9, 7, 17, 4], [16, 96, 50, 48], [23, 41, 48, 21], [9, 40, 40, 24]]
        {
            let shrunk = |numbers: Vec<f64>| numbers.iter().map(|&x| x as f32).collect::<Vec<_>>();
            let (a, b) = (shrunk(numbers(rows * depth, 0.3)), shrunk(numbers(depth * columns, 0.8)));
            let ((a_first, a_second), (b_first, b_second)) = (a.split_at(cut * rows), b.split_at(cut * columns));
            for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512] {
                let of = |a, b, sum, mut c: Vec<f32>| {
                    product(isa, a, b, [rows, columns], sum, &mut c);
                    c
                };
                let nothing = || vec![f32::NAN; rows * columns];
                let first = of(a_first, b_first, Sum::Whole, nothing());
                let second = of(a_second, b_second, Sum::Whole, nothing());
                let added: Vec<f32> = first.iter().zip(&second).map(|(x, y)| x + y).collect();
                assert_eq!(of(&a, &b, Sum::Parts(cut), nothing()), added, "{isa:?}");
                let (onto, whole) = (of(a_second, b_second, Sum::Onto, first), of(&a, &b, Sum::Whole, nothing()));
                if in_order(isa) {
                    assert_eq!(onto, whole, "{isa:?}");
                    assert!(depth < 7 || whole != added, "a test that tells orders apart");
                } else {
                    assert!(onto.iter().zip(&whole).all(|(x, y)| (x - y).abs() < 1e-5));
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "inner sizes")]
    fn a_product_of_sizes_that_do_not_fit_panics() {
        multiply(
            Isa::Baseline,
            Matrix::by_rows(&[1.0; 6], 3),
            Matrix::by_rows(&[1.0; 8], 4),
            Sum::Whole,
            &mut [0.0; 8],
        );
    }

    #[test]
    #[should_panic(expected = "inner sizes")]
    fn a_product_over_nothing_panics() {
        let empty: [f32; 0] = [];
        let (a, b) = (Matrix::by_rows(&empty, 3).transposed(), Matrix::by_rows(&empty, 4));
        multiply(Isa::Avx2, a, b, Sum::Whole, &mut [0.0; 12]);
    }
}
