//! Points found by place: which is nearest, which lie around.

use super::inflated::{Point, apart};

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

    /// Calls `visit` with the number of every point of a square.
    fn visit(&self, column: usize, row: usize, visit: &mut impl FnMut(usize)) {
        let mut number = self.heads[row * self.columns + column];
        while number != NONE {
            visit(number as usize);
            number = self.next[number as usize];
        }
    }

    /// The point nearest to `place`; of several the one that came first. `None` without points.
    pub fn nearest(&self, place: Point) -> Option<usize> {
        let (column, row) = self.square(place);
        let mut best = (f64::INFINITY, usize::MAX);
        for ring in 0..self.columns.max(self.rows) {
            // Whatever lies in this ring of squares or beyond is at least this far away.
            if best.0 < (ring as f64 - 1.0) * self.side {
                break;
            }
            let (top, bottom) = (row + ring, row.wrapping_sub(ring));
            for row in row.saturating_sub(ring)..=top.min(self.rows - 1) {
                let edge = row == top || row == bottom;
                let (left, right) = (column.saturating_sub(ring), column + ring);
                let step = if edge || ring == 0 { 1 } else { 2 * ring };
                // Only the two ends of the rows between; a left end that was cut off is none.
                let first = if edge || column >= ring { left } else { right };
                for column in (first..=right.min(self.columns - 1)).step_by(step) {
                    self.visit(column, row, &mut |number| {
                        best = nearer(best, (apart(self.points[number], place), number));
                    });
                }
            }
        }
        (best.1 != usize::MAX).then_some(best.1)
    }

    /// Fills `found` with the points within `radius` (m) of `place` and their distances, in rising order of both.
    pub fn within(&self, place: Point, radius: f64, found: &mut Vec<(f64, usize)>) {
        found.clear();
        let (left, low) = self.square([place[0] - radius, place[1] - radius]);
        let (right, high) = self.square([place[0] + radius, place[1] + radius]);
        for row in low..=high {
            for column in left..=right {
                self.visit(column, row, &mut |number| {
                    let away = apart(self.points[number], place);
                    if away <= radius {
                        found.push((away, number));
                    }
                });
            }
        }
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
}

fn nearer(a: (f64, usize), b: (f64, usize)) -> (f64, usize) {
    if b.0 < a.0 || (b.0 == a.0 && b.1 < a.1) { b } else { a }
}
