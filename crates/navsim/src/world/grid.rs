//! A grid of bits over the plane, one per position of a disc's centre, and how shapes are cut out of it.

use super::distance::{Form, Rounded, Solid};

/// Most columns or rows of a grid; larger worlds get larger cells.
const SIDE_MAX: f64 = 2048.0;
/// Guards a comparison of lengths (m) against rounding.
const ROUNDING: f64 = 1e-9;

/// Square cells over a rectangle; 64 columns of a row share a word, the lowest bit is the leftmost.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    x0: f64,
    y0: f64,
    /// Side of a cell, m.
    pub cell: f64,
    pub columns: usize,
    pub rows: usize,
    /// Words of a row.
    pub words: usize,
}

/// Column and row.
pub(crate) type Cell = (usize, usize);

impl Grid {
    /// Covers [x0, y0, x1, y1] with cells of about the wanted side.
    pub fn new([x0, y0, x1, y1]: [f64; 4], wanted: f64) -> Self {
        let (width, height) = ((x1 - x0).max(wanted), (y1 - y0).max(wanted));
        let cell = wanted.max(width.max(height) / SIDE_MAX);
        let count = |extent: f64| libm::ceil(extent / cell - ROUNDING) as usize;
        let (columns, rows) = (count(width), count(height));
        // Centred, so that what overhangs does so on both sides alike.
        let (x0, y0) = (0.5 * (x0 + x1 - columns as f64 * cell), 0.5 * (y0 + y1 - rows as f64 * cell));
        Self { x0, y0, cell, columns, rows, words: columns.div_ceil(64) }
    }

    /// Centre of a cell, m.
    pub fn center(&self, (column, row): Cell) -> [f64; 2] {
        [self.x0 + (column as f64 + 0.5) * self.cell, self.y0 + (row as f64 + 0.5) * self.cell]
    }

    /// The cell that holds `point`, or the nearest one to it.
    pub fn cell_at(&self, point: [f64; 2]) -> Cell {
        let index = |along: f64, count: usize| ((along / self.cell).max(0.0) as usize).min(count - 1);
        (index(point[0] - self.x0, self.columns), index(point[1] - self.y0, self.rows))
    }

    /// Whether the bit of a cell is set.
    pub fn is_set(&self, bits: &[u64], (column, row): Cell) -> bool {
        bits[row * self.words + column / 64] >> (column % 64) & 1 == 1
    }

    /// All cells free.
    pub fn all(&self) -> Vec<u64> {
        let last = u64::MAX >> (self.words * 64 - self.columns);
        (0..self.rows * self.words).map(|i| if i % self.words == self.words - 1 { last } else { u64::MAX }).collect()
    }

    /// Clears the cells whose centre is nearer to `solid` than `inflation` (m); unless `exact`, corners of the grown
    /// shape are cut once only, which clears up to 8 % of `inflation` too much there.
    pub fn block(&self, bits: &mut [u64], solid: &Solid, inflation: f64, exact: bool) {
        let outline = match &solid.form {
            Form::Rounded(rounded) => Border::Octagon(Octagon::new(solid.center, rounded, inflation)),
            Form::Polygon(corners) => Border::Polygon { corners, inflation },
        };
        let (low, high) = outline.heights();
        for row in between((low - self.y0) / self.cell, (high - self.y0) / self.cell, self.rows) {
            let y = self.y0 + (row as f64 + 0.5) * self.cell;
            let (left, right) = outline.span(y);
            let columns = between((left - self.x0) / self.cell, (right - self.x0) / self.cell, self.columns);
            let (mut first, mut end) = (columns.start, columns.end);
            if exact {
                let clear = |column| !solid.is_nearer(self.center((column, row)), inflation);
                while first < end && clear(first) {
                    first += 1;
                }
                while first < end && clear(end - 1) {
                    end -= 1;
                }
            }
            clear_bits(&mut bits[row * self.words..][..self.words], first, end);
        }
    }
}

/// The cells, of `count` in a row, whose middles lie between `low` and `high` (in cells).
fn between(low: f64, high: f64, count: usize) -> std::ops::Range<usize> {
    // The middle of cell i is i + 1/2, and a float becomes an index by truncation: the first i > low - 1/2 is
    // trunc(low + 1/2) for positive numbers, and one past the last i < high - 1/2 is trunc(high + 1/2).
    let index = |bound: f64| ((bound + 0.5).max(0.0) as usize).min(count);
    index(low)..index(high)
}

/// Clears the bits from `first` to before `end`.
fn clear_bits(words: &mut [u64], first: usize, end: usize) {
    if first >= end {
        return;
    }
    let (from, to) = (first / 64, (end - 1) / 64);
    let (head, tail) = (u64::MAX << (first % 64), u64::MAX >> (63 - (end - 1) % 64));
    if from == to {
        words[from] &= !(head & tail);
        return;
    }
    words[from] &= !head;
    words[from + 1..to].fill(0);
    words[to] &= !tail;
}

/// A shape grown by `inflation`, as horizontal lines cut it.
enum Border<'a> {
    Octagon(Octagon),
    Polygon { corners: &'a [[f64; 2]], inflation: f64 },
}

/// Octagon around a grown box: its four sides moved outwards and its four corners cut at half the angle.
struct Octagon {
    center: [f64; 2],
    half_height: f64,
    /// x - center_x <= limit - slope (y - center_y) for each; by symmetry the mirrored lines hold on the left.
    lines: [[f64; 2]; 4],
}

impl Octagon {
    fn new(center: [f64; 2], r: &Rounded, inflation: f64) -> Self {
        use std::f64::consts::FRAC_1_SQRT_2;
        let grown = inflation + r.radius;
        let half_height = r.sin.abs() * r.half_length + r.cos.abs() * r.half_width + grown;
        let diagonal = FRAC_1_SQRT_2 * (r.half_length + r.half_width) + grown;
        let (plus, minus) = (FRAC_1_SQRT_2 * (r.cos + r.sin), FRAC_1_SQRT_2 * (r.cos - r.sin));
        let line = |normal: [f64; 2], distance: f64| {
            if normal[0].abs() < 1e-9 {
                return [f64::INFINITY, 0.0];
            }
            let inverse = 1.0 / normal[0];
            [distance * inverse.abs(), normal[1] * inverse]
        };
        let lines = [
            line([r.cos, r.sin], r.half_length + grown),
            line([-r.sin, r.cos], r.half_width + grown),
            line([minus, plus], diagonal),
            line([plus, -minus], diagonal),
        ];
        Self { center, half_height, lines }
    }
}

impl Border<'_> {
    /// Lowest and highest y.
    fn heights(&self) -> (f64, f64) {
        match self {
            Self::Octagon(octagon) => {
                (octagon.center[1] - octagon.half_height, octagon.center[1] + octagon.half_height)
            }
            Self::Polygon { corners, inflation } => {
                let low = corners.iter().fold(f64::INFINITY, |y, c| y.min(c[1]));
                let high = corners.iter().fold(f64::NEG_INFINITY, |y, c| y.max(c[1]));
                (low - inflation, high + inflation)
            }
        }
    }

    /// Leftmost and rightmost x at the height `y`, or a little beyond.
    fn span(&self, y: f64) -> (f64, f64) {
        match self {
            Self::Octagon(Octagon { center, lines, .. }) => {
                let t = y - center[1];
                let (mut right, mut left) = (f64::INFINITY, f64::INFINITY);
                for [limit, slope] in lines {
                    right = right.min(limit - slope * t);
                    left = left.min(limit + slope * t);
                }
                (center[0] - left, center[0] + right)
            }
            Self::Polygon { corners, inflation } => {
                let (mut left, mut right) = (f64::NEG_INFINITY, f64::INFINITY);
                for i in 0..corners.len() {
                    let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                    let normal = [b[1] - a[1], a[0] - b[0]];
                    if normal[0].abs() < 1e-9 {
                        continue;
                    }
                    let length = (normal[0] * normal[0] + normal[1] * normal[1]).sqrt();
                    let x = a[0] + (inflation * length - normal[1] * (y - a[1])) / normal[0];
                    if normal[0] > 0.0 { right = right.min(x) } else { left = left.max(x) }
                }
                (left, right)
            }
        }
    }
}
