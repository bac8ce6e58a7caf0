//! Matrices in slices.

/// A matrix in a slice.
#[derive(Debug, Clone, Copy)]
pub struct Matrix<'a, T> {
    /// From the first element on.
    pub values: &'a [T],
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Numbers from one row to the next.
    pub row_stride: usize,
    /// Numbers from one column to the next.
    pub column_stride: usize,
}

impl<'a, T> Matrix<'a, T> {
    /// `values` by rows of `columns` numbers each.
    ///
    /// # Panics
    /// If they are no whole number of rows.
    pub fn by_rows(values: &'a [T], columns: usize) -> Self {
        Self::first_columns(values, columns, columns)
    }

    /// The first `columns` of rows of `stride` numbers each.
    ///
    /// # Panics
    /// If they are no whole number of rows, or have fewer columns.
    pub fn first_columns(values: &'a [T], columns: usize, stride: usize) -> Self {
        assert!(
            (1..=stride).contains(&columns) && values.len().is_multiple_of(stride),
            "{columns} columns of {} values in rows of {stride}",
            values.len()
        );
        Self { values, rows: values.len() / stride, columns, row_stride: stride, column_stride: 1 }
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

/// Copies a matrix that lies by rows of `columns` numbers to `turned`, with rows and columns exchanged.
///
/// # Panics
/// If the two have different sizes, or are no whole number of rows.
pub fn transpose<T: Copy>(values: &[T], columns: usize, turned: &mut [T]) {
    const SIDE: usize = 4;
    assert!(
        values.len() == turned.len() && values.len().is_multiple_of(columns),
        "sizes of a matrix and its transpose"
    );
    let rows = values.len() / columns;
    let (squares_down, squares_across) = (rows / SIDE * SIDE, columns / SIDE * SIDE);
    for top in (0..squares_down).step_by(SIDE) {
        let band: [&[T]; SIDE] = std::array::from_fn(|i| &values[(top + i) * columns..][..columns]);
        for left in (0..squares_across).step_by(SIDE) {
            let square: [[T; SIDE]; SIDE] = band.map(|row| std::array::from_fn(|j| row[left + j]));
            for j in 0..SIDE {
                let to = &mut turned[(left + j) * rows + top..][..SIDE];
                to.copy_from_slice(&square.map(|row| row[j]));
            }
        }
    }
    for (row, numbers) in values.chunks_exact(columns).enumerate() {
        let first = if row < squares_down { squares_across } else { 0 };
        for (column, &number) in numbers.iter().enumerate().skip(first) {
            turned[column * rows + row] = number;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transpose_has_its_rows_for_columns() {
        for [rows, columns] in [[1, 1], [3, 5], [4, 4], [9, 8], [16, 31]] {
            let values: Vec<f64> = (0..rows * columns).map(|i| i as f64).collect();
            let mut turned = vec![f64::NAN; rows * columns];
            transpose(&values, columns, &mut turned);
            for (place, &value) in values.iter().enumerate() {
                assert_eq!(turned[place % columns * rows + place / columns], value);
            }
        }
    }
}
