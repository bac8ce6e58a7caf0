//! Points found by place: which is nearest, which lie around.

use crate::grown::{Point, apart};

/// Squares along the longer side of the area.
const SQUARES: f64 = 64.0;
/// End of a list.
const NONE: u32 = u32::MAX;

/// Points sorted into squares over a rectangle, in lists that are linked through the points.
#[derive(Debug)]
pub(crate) struct Neighbours {
    points: Vec<Point>,
    /// The point that was sorted into the same square before, or `NONE`.
    next: Vec<u32>,
    /// The last point of each square, or `NONE`.
    heads: Vec<u32>,
    low: Point,
    side: f64,
    columns: usize,
    rows: usize,
}

impl Neighbours {
    /// No points yet; all will lie within `bounds` ([x0, y0, x1, y1], m).
    pub fn new([x0, y0, x1, y1]: [f64; 4]) -> Self {
        let side = (x1 - x0).max(y1 - y0) / SQUARES;
        let count = |extent: f64| (extent / side) as usize + 1;
        let (columns, rows) = (count(x1 - x0), count(y1 - y0));
        let heads = vec![NONE; columns * rows];
        Self { points: Vec::new(), next: Vec::new(), heads, low: [x0, y0], side, columns, rows }
    }

    /// All points, in the order in which they came.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    fn square(&self, point: Point) -> (usize, usize) {
        let index = |axis: usize, count: usize| (((point[axis] - self.low[axis]) / self.side) as usize).min(count - 1);
        (index(0, self.columns), index(1, self.rows))
    }

    /// Adds a point and returns its number.
    pub fn push(&mut self, point: Point) -> usize {
        let (column, row) = self.square(point);
        let number = self.points.len();
        let head = &mut self.heads[row * self.columns + column];
        self.next.push(*head);
        *head = number as u32;
        self.points.push(point);
        number
    }

    /// Fills `found` with the `count` (> 0) points nearest to `place`, or all there are: distance (m) and number of
    /// each, in rising order of both.
    pub fn closest(&self, place: Point, count: usize, found: &mut Vec<(f64, usize)>) {
        found.clear();
        let (column, row) = self.square(place);
        for ring in 0..self.columns.max(self.rows) {
            // Whatever lies in this ring of squares or beyond is at least this far away.
            if found.len() == count && found[count - 1].0 < (ring as f64 - 1.0) * self.side {
                break;
            }
            let (top, bottom) = (row + ring, row.wrapping_sub(ring));
            for row in row.saturating_sub(ring)..=top.min(self.rows - 1) {
                let edge = row == top || row == bottom;
                let (left, right) = (column.saturating_sub(ring), column + ring);
                // Only the two ends of the rows between; a left end that was cut off is none.
                let (first, step) = match edge {
                    true => (left, 1),
                    false => (if column >= ring { left } else { right }, 2 * ring),
                };
                for column in (first..=right.min(self.columns - 1)).step_by(step) {
                    self.offer(column, row, place, count, found);
                }
            }
        }
    }

    /// Sorts the points of a square into `found`, which keeps the `count` nearest.
    fn offer(&self, column: usize, row: usize, place: Point, count: usize, found: &mut Vec<(f64, usize)>) {
        let mut number = self.heads[row * self.columns + column];
        while number != NONE {
            let new = (apart(self.points[number as usize], place), number as usize);
            let before = |other: &(f64, usize)| other.0.total_cmp(&new.0).then(other.1.cmp(&new.1)).is_lt();
            if found.len() < count || !before(&found[count - 1]) {
                found.truncate(count - 1);
                found.insert(found.partition_point(before), new);
            }
            number = self.next[number as usize];
        }
    }
}
