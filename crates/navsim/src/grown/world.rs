//! The grown shapes of a world, found by place.

use super::grid::Grid;
use super::points::{Point, apart, sweep};
use super::shape::{GrownShape, TOUCH};
use crate::world::shapes::rectangle_around;

/// A corner of a core with its reach: the disc about which a shortest path may bend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    pub center: Point,
    pub reach: f64,
}

/// Where two grown shapes overlap: a segment from core to core that no path can cross.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Joint {
    /// Indices in `GrownWorld::shapes`.
    pub shapes: [usize; 2],
    /// On the core of the first.
    pub from: Point,
    /// On the core of the second.
    pub to: Point,
}

/// Smallest axis-parallel rectangle ([x0, y0, x1, y1], m) around grown shapes, a start and the goal disc.
pub(crate) fn bounds(shapes: &[GrownShape], start: Point, goal: Point, goal_radius: f64) -> [f64; 4] {
    let square = |[x, y]: Point, half: f64| [x - half, y - half, x + half, y + half];
    let ends = [square(start, 0.0), square(goal, goal_radius)];
    rectangle_around(shapes.iter().map(GrownShape::bounds).chain(ends))
}

/// The grown obstacles of a world, found by place.
#[derive(Debug)]
pub(crate) struct GrownWorld {
    shapes: Vec<GrownShape>,
    corners: Vec<Corner>,
    /// Squares between the nodes of this grid, each named by its lower left node.
    squares: Grid,
    /// Shapes of square i: `listed[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    listed: Vec<u32>,
}

impl GrownWorld {
    /// Sorts `shapes` into squares over `bounds`, which holds every grown shape and every point that is asked about.
    pub fn new(shapes: Vec<GrownShape>, bounds: [f64; 4]) -> Self {
        let area = ((bounds[2] - bounds[0]) * (bounds[3] - bounds[1])).max(1e-6);
        let squares = Grid::around(bounds, (area / (64.0 + 4.0 * shapes.len() as f64)).sqrt());
        let half = 0.5 * squares.cell;
        // The slack covers the rounding of a walk along the border of two squares.
        let diagonal = half * (std::f64::consts::SQRT_2 + 1e-6);
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(8 * shapes.len());
        for (index, shape) in shapes.iter().enumerate() {
            let [x0, y0, x1, y1] = shape.bounds();
            let cell = squares.cell;
            let [columns, rows] =
                squares.window([x0 - 1.01 * cell, y0 - 1.01 * cell, x1 + 0.01 * cell, y1 + 0.01 * cell]);
            for row in rows {
                for column in columns.clone() {
                    let square = row * squares.columns + column;
                    let [x, y] = squares.position(square);
                    if shape.clearance([x + half, y + half]) <= diagonal {
                        pairs.push((square as u32, index as u32));
                    }
                }
            }
        }
        pairs.sort_unstable();
        let mut starts = vec![0u32; squares.len() + 1];
        for (square, _) in &pairs {
            starts[*square as usize + 1] += 1;
        }
        for square in 0..squares.len() {
            starts[square + 1] += starts[square];
        }
        let mut corners: Vec<Corner> =
            shapes.iter().flat_map(|s| s.core.iter().map(|p| Corner { center: *p, reach: s.reach })).collect();
        corners.sort_by(|a, b| a.center[0].total_cmp(&b.center[0]).then(a.center[1].total_cmp(&b.center[1])));
        corners.dedup();
        Self { shapes, corners, squares, starts, listed: pairs.into_iter().map(|(_, index)| index).collect() }
    }

    /// Corners of all cores, each once.
    pub fn corners(&self) -> &[Corner] {
        &self.corners
    }

    fn square_of(&self, point: Point) -> (usize, usize) {
        let index = |at: f64, origin: f64, count: usize| (((at - origin) / self.squares.cell) as usize).min(count - 1);
        (
            index(point[0], self.squares.origin[0], self.squares.columns),
            index(point[1], self.squares.origin[1], self.squares.rows),
        )
    }

    fn listed_in(&self, column: usize, row: usize) -> &[u32] {
        let square = row * self.squares.columns + column;
        &self.listed[self.starts[square] as usize..self.starts[square + 1] as usize]
    }

    /// The grown shapes.
    pub fn shapes(&self) -> &[GrownShape] {
        &self.shapes
    }

    /// The joints of all pairs of grown shapes that overlap.
    pub fn joints(&self) -> Vec<Joint> {
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        for range in self.starts.windows(2) {
            let listed = &self.listed[range[0] as usize..range[1] as usize];
            for (i, first) in listed.iter().enumerate() {
                pairs.extend(listed[i + 1..].iter().map(|second| (*first, *second)));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let joint = |(i, j): (u32, u32)| {
            let [from, to] = self.shapes[i as usize].joint(&self.shapes[j as usize])?;
            Some(Joint { shapes: [i as usize, j as usize], from, to })
        };
        pairs.into_iter().filter_map(joint).collect()
    }

    /// Whether `point` lies in no grown shape.
    pub fn is_free(&self, point: Point) -> bool {
        let (column, row) = self.square_of(point);
        self.listed_in(column, row).iter().all(|index| !self.shapes[*index as usize].holds(point))
    }

    /// Whether the segment `a`-`b`, its ends free, enters no grown shape.
    pub fn segment_is_free(&self, a: Point, b: Point) -> bool {
        let ((mut column, mut row), (last_column, last_row)) = (self.square_of(a), self.square_of(b));
        let cell = self.squares.cell;
        // Share of the segment at which it leaves the present square along one axis, and the share that a square takes.
        let axis = |from: f64, to: f64, origin: f64, index: usize| {
            let span = to - from;
            let border = origin + cell * (index as f64 + if span > 0.0 { 1.0 } else { 0.0 });
            if span == 0.0 { (f64::INFINITY, 0.0) } else { ((border - from) / span, cell / span.abs()) }
        };
        let (mut leave_x, across_x) = axis(a[0], b[0], self.squares.origin[0], column);
        let (mut leave_y, across_y) = axis(a[1], b[1], self.squares.origin[1], row);
        loop {
            if self.listed_in(column, row).iter().any(|index| self.shapes[*index as usize].crosses(a, b)) {
                return false;
            }
            if column == last_column && row == last_row {
                return true;
            }
            if row == last_row || (column != last_column && leave_x < leave_y) {
                column = if last_column > column { column + 1 } else { column - 1 };
                leave_x += across_x;
            } else {
                row = if last_row > row { row + 1 } else { row - 1 };
                leave_y += across_y;
            }
        }
    }

    /// Shapes that may meet the circle of this `center` and `radius`.
    fn near_circle(&self, center: Point, radius: f64) -> Vec<&GrownShape> {
        let (first_column, first_row) = self.square_of([center[0] - radius, center[1] - radius]);
        let (last_column, last_row) = self.square_of([center[0] + radius, center[1] + radius]);
        let mut indices: Vec<u32> = Vec::new();
        for row in first_row..=last_row {
            for column in first_column..=last_column {
                indices.extend_from_slice(self.listed_in(column, row));
            }
        }
        indices.sort_unstable();
        indices.dedup();
        let touch = (1.0 + TOUCH) * radius;
        let meets = |shape: &&GrownShape| apart(center, shape.center) <= touch + shape.reach + shape.extent;
        indices.into_iter().map(|index| &self.shapes[index as usize]).filter(meets).collect()
    }

    /// Angles (rad, unordered, any multiple of a turn) at which the circle of this `center` and `radius` may enter or
    /// leave a grown shape.
    pub fn crossings(&self, center: Point, radius: f64) -> Vec<f64> {
        let mut angles = Vec::new();
        for shape in self.near_circle(center, radius) {
            shape.add_crossings(&mut angles, center, radius);
        }
        angles
    }

    /// How far (rad, 0 to 2 pi) one may go from `angle` on the arc about `corner`, counter-clockwise if `turn` is 1,
    /// clockwise if it is -1, before it enters a grown shape.
    pub fn free_sweep(&self, corner: &Corner, angle: f64, turn: f64) -> f64 {
        let Corner { center, reach } = *corner;
        let near = self.near_circle(center, reach);
        let mut angles = vec![0.0, std::f64::consts::TAU];
        let own = angles.len();
        near.iter().for_each(|shape| shape.add_crossings(&mut angles, center, reach));
        angles[own..].iter_mut().for_each(|crossing| *crossing = sweep(angle, *crossing, turn));
        angles.sort_by(f64::total_cmp);
        for pair in angles.windows(2) {
            let (sin, cos) = libm::sincos(angle + turn * 0.5 * (pair[0] + pair[1]));
            let middle = [center[0] + reach * cos, center[1] + reach * sin];
            if near.iter().any(|shape| shape.holds(middle)) {
                return pair[0];
            }
        }
        std::f64::consts::TAU
    }
}
