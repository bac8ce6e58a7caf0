//! Bodies of the loops that [`super`] compiles for every instruction set.
//!
//! Sums run in fixed lanes, so that their order does not depend on the width of the vectors.

use crate::adam::{EPSILON, FIRST_DECAY, SECOND_DECAY, Step, Vectors};
use crate::real::Real;

/// The numbers in one vector of the widest instruction set.
const LANES: usize = 16;
/// Partial sums of a sum: few, for what costs most is to add them up.
pub const SUMS: usize = 8;

#[inline(always)]
fn relu<T: Real>(z: T) -> T {
    if z < T::ZERO { T::ZERO } else { z }
}

/// Adds up the lanes, halving them.
#[inline(always)]
fn total<T: Real, const N: usize>(mut lanes: [T; N]) -> T {
    let mut width = N / 2;
    while width > 0 {
        for lane in 0..width {
            lanes[lane] += lanes[lane + width];
        }
        width /= 2;
    }
    lanes[0]
}

/// Sum over i of f(a_i, b_i).
#[inline(always)]
fn sum_of<T: Real>(a: &[T], b: &[T], f: impl Fn(T, T) -> T) -> T {
    let mut lanes = [T::ZERO; SUMS];
    let ((wholes_a, rest_a), (wholes_b, rest_b)) = (a.as_chunks::<SUMS>(), b.as_chunks::<SUMS>());
    for (a, b) in wholes_a.iter().zip(wholes_b) {
        for lane in 0..SUMS {
            lanes[lane] += f(a[lane], b[lane]);
        }
    }
    for ((lane, a), b) in lanes.iter_mut().zip(rest_a).zip(rest_b) {
        *lane += f(*a, *b);
    }
    total(lanes)
}

/// The sum over the places below `cut` plus that over the others.
#[inline(always)]
fn sum_in_parts<T: Real>(a: &[T], b: &[T], cut: usize, f: impl Fn(T, T) -> T + Copy) -> T {
    let ((a, rest_a), (b, rest_b)) = (a.split_at(cut), b.split_at(cut));
    let first = sum_of(a, b, f);
    if rest_a.is_empty() { first } else { first + sum_of(rest_a, rest_b, f) }
}

#[inline(always)]
pub fn bias_relu<T: Real>(z: &mut [T], bias: &[T], batch: usize) {
    for (row, &b) in z.chunks_exact_mut(batch).zip(bias) {
        for z in row {
            *z = relu(*z + b);
        }
    }
}

#[inline(always)]
pub fn combined_relu<T: Real>(z: &mut [T], bias: &[T], weight: &[T], actions: &[T], batch: usize) {
    let ((forward, turn), (w_forward, w_turn)) = (actions.split_at(batch), weight.split_at(bias.len()));
    for (((row, &b), &wf), &wt) in z.chunks_exact_mut(batch).zip(bias).zip(w_forward).zip(w_turn) {
        for ((z, &af), &at) in row.iter_mut().zip(forward).zip(turn) {
            *z = relu(*z + (wf * af + wt * at + b));
        }
    }
}

#[inline(always)]
pub fn through_relu<T: Real>(gradient: &mut [T], outputs: &[T], sums: &mut [T], batch: usize, cut: usize) {
    for ((row, outputs), sum) in gradient.chunks_exact_mut(batch).zip(outputs.chunks_exact(batch)).zip(sums) {
        for (g, &y) in row.iter_mut().zip(outputs) {
            *g = if y > T::ZERO { *g } else { T::ZERO };
        }
        *sum = sum_in_parts(row, outputs, cut, |g, _| g);
    }
}

#[inline(always)]
pub fn narrow<T: Real>(weight: &[T], bias: Option<&[T]>, inputs: &[T], outputs: &mut [T], batch: usize) {
    let units = inputs.len() / batch;
    for (i, (row, weights)) in outputs.chunks_exact_mut(batch).zip(weight.chunks_exact(units)).enumerate() {
        row.fill(bias.map_or(T::ZERO, |bias| bias[i]));
        let (blocks, rest) = row.as_chunks_mut::<{ 2 * LANES }>();
        let first_of_rest = blocks.len() * 2 * LANES;
        for (block, ys) in blocks.iter_mut().enumerate() {
            // A copy, so that the sums stay in registers
            let mut sums = *ys;
            for (inputs, &w) in inputs.chunks_exact(batch).zip(weights) {
                let (inputs, _) = inputs[block * 2 * LANES..].as_chunks::<{ 2 * LANES }>();
                for (y, &x) in sums.iter_mut().zip(&inputs[0]) {
                    *y += w * x;
                }
            }
            *ys = sums;
        }
        for (inputs, &w) in inputs.chunks_exact(batch).zip(weights) {
            for (y, &x) in rest.iter_mut().zip(&inputs[first_of_rest..]) {
                *y += w * x;
            }
        }
    }
}

#[inline(always)]
pub fn narrow_weights<T: Real>(upper: &[T], inputs: &[T], gradient: &mut [T], batch: usize, cut: usize) {
    let units = inputs.len() / batch;
    for (upper, row) in upper.chunks_exact(batch).zip(gradient.chunks_exact_mut(units)) {
        for (g, inputs) in row.iter_mut().zip(inputs.chunks_exact(batch)) {
            *g = sum_in_parts(upper, inputs, cut, |u, x| u * x);
        }
    }
}

#[inline(always)]
pub fn narrow_inputs<T: Real>(weight: &[T], upper: &[T], gradient: &mut [T], batch: usize) {
    let units = gradient.len() / batch;
    for (i, (upper, weights)) in upper.chunks_exact(batch).zip(weight.chunks_exact(units)).enumerate() {
        for (row, &w) in gradient.chunks_exact_mut(batch).zip(weights) {
            for (g, &u) in row.iter_mut().zip(upper) {
                *g = if i == 0 { w * u } else { *g + w * u };
            }
        }
    }
}

/// The new parameter, with its moments updated.
#[inline(always)]
fn stepped<T: Real>(step: Step<T>, gradient: T, parameter: T, first: &mut T, second: &mut T) -> T {
    let g = gradient.settled();
    *first = (T::of(FIRST_DECAY) * *first + T::of(1.0 - FIRST_DECAY) * g).settled();
    let square = (T::of(1.0 - SECOND_DECAY) * (g * g).settled()).settled();
    *second = (T::of(SECOND_DECAY) * *second + square).settled();
    parameter - step.size * *first / (second.root() * step.scale + T::of(EPSILON))
}

#[inline(always)]
pub fn adam<T: Real>(step: Step<T>, gradients: [&[T]; 2], vectors: Vectors<'_, T>, tau: Option<T>) {
    match gradients {
        [whole, []] => step_all(step, whole.iter().copied(), vectors, tau),
        [first, second] => step_all(step, first.iter().zip(second).map(|(&a, &b)| a + b), vectors, tau),
    }
}

#[inline(always)]
fn step_all<T: Real>(step: Step<T>, gradient: impl Iterator<Item = T>, vectors: Vectors<'_, T>, tau: Option<T>) {
    let Vectors { parameters, targets, first, second } = vectors;
    let moments = first.iter_mut().zip(second);
    let places = parameters.iter_mut().zip(gradient).zip(moments);
    match tau {
        None => {
            for ((p, g), (first, second)) in places {
                *p = stepped(step, g, *p, first, second);
            }
        }
        Some(tau) => {
            for (((p, g), (first, second)), target) in places.zip(targets) {
                *p = stepped(step, g, *p, first, second);
                // Eq. 10: theta' <- tau theta + (1 - tau) theta'
                *target = (*target + tau * (*p - *target)).settled();
            }
        }
    }
}

#[inline(always)]
pub fn rows_finite<T: Real>(numbers: &[T], width: usize, rows: &[i64]) -> bool {
    // 0 x is 0 unless x is NaN or infinite. Never left early: the processor fetches many rows from memory side by side.
    let mut sums = [T::ZERO; LANES];
    for &row in rows {
        for block in numbers[row as usize * width..][..width].chunks(LANES) {
            for (sum, &x) in sums.iter_mut().zip(block) {
                *sum += T::ZERO * x;
            }
        }
    }
    total(sums) == T::ZERO
}

#[inline(always)]
pub fn all_finite<T: Real>(numbers: &[T]) -> bool {
    // Whole blocks at a time, for an exit from within would keep them from being vectors.
    numbers.chunks(4 * LANES).all(|block| block.iter().fold(true, |all, x| all & x.finite()))
}

#[inline(always)]
pub fn all_bounded<T: Real>(numbers: &[T]) -> bool {
    numbers.chunks(4 * LANES).all(|block| block.iter().fold(true, |all, x| all & (x.size() <= T::HALF)))
}
