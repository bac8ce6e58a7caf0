//! A batch: rows of replay, drawn by index, with one column for each row drawn.

use crate::aligned::Aligned;
use crate::error::{Result, expect, expect_size};
use crate::kernels::matrix::{Matrix, transpose};
use crate::real::Real;

/// Numbers in an action: forward and turn (equation 1).
pub const ACTIONS: usize = 2;

/// The left-right mirror of a row of replay, or of an observation: column j becomes `signs[j]` times column
/// `permutation[j]`.
#[derive(Debug, Clone)]
pub struct Mirror {
    /// (width) where each column comes from.
    pub permutation: Vec<usize>,
    /// (width) +1 or -1.
    pub signs: Vec<f32>,
}

impl Mirror {
    /// Refuses one for rows of another width.
    ///
    /// # Errors
    /// Names what does not fit.
    pub fn check(&self, width: usize) -> Result<()> {
        expect_size("columns of the mirror", self.permutation.len(), width)?;
        expect_size("signs of the mirror", self.signs.len(), width)?;
        let farthest = self.permutation.iter().copied().max().unwrap_or_default();
        expect("a column of the mirror", farthest, farthest < width, || format!("less than {width}"))?;
        let other = self.signs.iter().find(|sign| sign.abs() != 1.0);
        expect("a sign of the mirror", other.copied().unwrap_or(1.0), other.is_none(), || "1 or -1".into())
    }
}

/// The rows of one update.
#[derive(Debug)]
pub struct Batch<T> {
    /// (size, width): observation, action, successor, return R, bootstrap factor.
    rows: Aligned<T>,
    /// (width, size) the same.
    columns: Aligned<T>,
    inputs: usize,
    size: usize,
}

impl<T: Real> Batch<T> {
    /// Memory for `size` rows with observations of `inputs` numbers.
    pub fn new(inputs: usize, size: usize) -> Self {
        let memory = || Aligned::zeros(width(inputs) * size);
        Self { rows: memory(), columns: memory(), inputs, size }
    }

    /// Copies rows of `replay` (by rows) in, mirrored where `mirrored` says so.
    ///
    /// # Panics
    /// If an index is beyond replay, or a row is to be mirrored and there is no mirror.
    pub fn gather(&mut self, replay: &[f32], indices: &[i64], mirrored: &[bool], mirror: Option<&Mirror>) {
        let width = width(self.inputs);
        for ((numbers, &index), &flip) in self.rows.chunks_exact_mut(width).zip(indices).zip(mirrored) {
            let row = &replay[index as usize * width..][..width];
            match mirror {
                Some(mirror) if flip => {
                    for ((number, &from), &sign) in numbers.iter_mut().zip(&mirror.permutation).zip(&mirror.signs) {
                        *number = T::of(f64::from(sign * row[from]));
                    }
                }
                _ => {
                    assert!(!flip, "a row to mirror without a mirror");
                    for (number, &x) in numbers.iter_mut().zip(row) {
                        *number = T::of(f64::from(x));
                    }
                }
            }
        }
        transpose(&self.rows, width, &mut self.columns);
    }

    fn part(&self, first: usize, rows: usize) -> &[T] {
        &self.columns[first * self.size..][..rows * self.size]
    }

    /// (inputs, size).
    pub fn observations(&self) -> &[T] {
        self.part(0, self.inputs)
    }

    /// (size, inputs) the same as `observations`.
    pub fn observation_rows(&self) -> Matrix<'_, T> {
        Matrix::first_columns(&self.rows, self.inputs, width(self.inputs))
    }

    /// (2, size).
    pub fn actions(&self) -> &[T] {
        self.part(self.inputs, ACTIONS)
    }

    /// (inputs, size).
    pub fn successors(&self) -> &[T] {
        self.part(self.inputs + ACTIONS, self.inputs)
    }

    /// R (size) of equation 9.
    pub fn returns(&self) -> &[T] {
        self.part(2 * self.inputs + ACTIONS, 1)
    }

    /// gamma^m (1 - terminated) (size) of equation 9.
    pub fn bootstrap(&self) -> &[T] {
        self.part(2 * self.inputs + ACTIONS + 1, 1)
    }
}

/// Columns of a row of replay with observations of `inputs` numbers.
pub fn width(inputs: usize) -> usize {
    2 * inputs + ACTIONS + 2
}
