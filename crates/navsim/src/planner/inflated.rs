//! Obstacles grown by the robot's radius: what its centre may not enter.
//!
//! Every shape is a convex core (a point, a segment, a polygon) grown by a reach: the robot's radius, for a circle plus
//! the circle's own. Its border is made of arcs about the corners of the core and of straight lines between them, so
//! that a shortest path is made of straight lines that touch such arcs and of pieces of the arcs.

use super::fast_marching::Grid;
use crate::world::Shape;

pub(crate) type Point = [f64; 2];

/// Clearance (m) below the radius that still counts as free: the rounding of tangents and arcs, and nothing else.
const ROUNDING: f64 = 1e-9;
/// A circle that misses a line or another circle by this share of its radius counts as touching it.
const TOUCH: f64 = 1e-6;

/// A convex core and its reach.
#[derive(Debug, Clone)]
pub(crate) struct InflatedSolid {
    core: Vec<Point>,
    /// Distance from the core that is blocked, m.
    reach: f64,
    /// Mean of the core's corners: a point of the core.
    center: Point,
    /// Largest distance of the core from its centre, m.
    extent: f64,
}

/// A corner of a core with its reach: the disc about which a shortest path may bend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    pub center: Point,
    pub reach: f64,
}

/// Where two grown shapes overlap: a segment from core to core that no path can cross.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Joint {
    /// Indices in `Inflated::solids`.
    pub solids: [usize; 2],
    /// On the core of the first.
    pub from: Point,
    /// On the core of the second.
    pub to: Point,
}

/// Distance (m) between two points.
pub(crate) fn apart(a: Point, b: Point) -> f64 {
    let offset = minus(b, a);
    dot(offset, offset).sqrt()
}

/// The point at `length` (m) from `a` towards `b`; `a` itself where the two fall together.
pub(crate) fn along(a: Point, b: Point, length: f64) -> Point {
    let whole = apart(a, b);
    let share = if whole > 0.0 { length / whole } else { 0.0 };
    [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Squared distance of `point` from the segment `a`-`b`.
fn squared_to_segment(point: Point, a: Point, b: Point) -> f64 {
    let rest = minus(point, nearest_on_segment(point, a, b));
    dot(rest, rest)
}

/// The point of the segment `a`-`b` that is nearest to `point`.
fn nearest_on_segment(point: Point, a: Point, b: Point) -> Point {
    let (edge, offset) = (minus(b, a), minus(point, a));
    let square = dot(edge, edge);
    let share = if square > 0.0 { (dot(offset, edge) / square).clamp(0.0, 1.0) } else { 0.0 };
    [a[0] + share * edge[0], a[1] + share * edge[1]]
}

/// Squared distance between the segments `a`-`b` and `c`-`d`, 0 where they cross.
fn squared_between(a: Point, b: Point, c: Point, d: Point) -> f64 {
    let (first, second) = (minus(b, a), minus(d, c));
    let sides = cross(first, minus(c, a)) * cross(first, minus(d, a)) < 0.0;
    if sides && cross(second, minus(a, c)) * cross(second, minus(b, c)) < 0.0 {
        return 0.0;
    }
    let ends = squared_to_segment(a, c, d).min(squared_to_segment(b, c, d));
    ends.min(squared_to_segment(c, a, b)).min(squared_to_segment(d, a, b))
}

impl InflatedSolid {
    /// `shape` grown by `radius`, both m.
    pub fn new(shape: &Shape, radius: f64) -> Self {
        let (core, reach) = match shape {
            Shape::Circle { center, radius: own } => (vec![*center], radius + own),
            _ => (shape.corners(), radius),
        };
        let count = core.len() as f64;
        let center = core.iter().fold([0.0, 0.0], |sum, p| [sum[0] + p[0] / count, sum[1] + p[1] / count]);
        let extent = core.iter().fold(0.0, |extent: f64, p| extent.max(apart(*p, center)));
        Self { core, reach, center, extent }
    }

    /// Edges of the core, counter-clockwise; a segment has two, one for each of its sides.
    fn edges(&self) -> impl Iterator<Item = (Point, Point)> + '_ {
        let count = if self.core.len() > 1 { self.core.len() } else { 0 };
        (0..count).map(move |i| (self.core[i], self.core[(i + 1) % count]))
    }

    /// Smallest axis-parallel rectangle around the grown shape, m.
    pub fn bounds(&self) -> [f64; 4] {
        let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let [x0, y0, x1, y1] =
            self.core.iter().fold(start, |[x0, y0, x1, y1], [x, y]| [x0.min(*x), y0.min(*y), x1.max(*x), y1.max(*y)]);
        [x0 - self.reach, y0 - self.reach, x1 + self.reach, y1 + self.reach]
    }

    /// A point of the core, m.
    pub fn center(&self) -> Point {
        self.center
    }

    /// Distance (m) of `point` from the grown shape, negative inside.
    pub fn clearance(&self, point: Point) -> f64 {
        if let [center] = self.core[..] {
            return apart(point, center) - self.reach;
        }
        let nearest = self.edges().fold(f64::INFINITY, |nearest, (a, b)| nearest.min(squared_to_segment(point, a, b)));
        let inside = self.core.len() > 2 && self.edges().all(|(a, b)| cross(minus(b, a), minus(point, a)) > 0.0);
        if inside { -nearest.sqrt() - self.reach } else { nearest.sqrt() - self.reach }
    }

    fn holds(&self, point: Point) -> bool {
        let far = self.reach + self.extent;
        let offset = minus(point, self.center);
        dot(offset, offset) < far * far && self.clearance(point) < -ROUNDING
    }

    /// Nearest points of the two cores, if the grown shapes overlap.
    fn joint(&self, other: &InflatedSolid) -> Option<[Point; 2]> {
        let far = self.reach + other.reach;
        if apart(self.center, other.center) > far + self.extent + other.extent {
            return None;
        }
        let mut best = ((far - ROUNDING).powi(2), None);
        let mut offer = |a: Point, b: Point| {
            let square = dot(minus(b, a), minus(b, a));
            if square < best.0 {
                best = (square, Some([a, b]));
            }
        };
        // A corner is one of the nearest points, unless the cores cross or one holds the other.
        for corner in &self.core {
            other.edges().for_each(|(a, b)| offer(*corner, nearest_on_segment(*corner, a, b)));
            other.core.iter().for_each(|b| offer(*corner, *b));
        }
        for corner in &other.core {
            self.edges().for_each(|(a, b)| offer(nearest_on_segment(*corner, a, b), *corner));
        }
        best.1.or_else(|| self.common_point(other).map(|point| [point, point]))
    }

    /// A point of both cores, if they cross or one holds the other.
    fn common_point(&self, other: &InflatedSolid) -> Option<Point> {
        for (a, b) in self.edges() {
            for (c, d) in other.edges() {
                if squared_between(a, b, c, d) == 0.0 {
                    let (first, second) = (minus(b, a), minus(d, c));
                    let share = cross(minus(c, a), second) / cross(first, second);
                    return Some([a[0] + share * first[0], a[1] + share * first[1]]);
                }
            }
        }
        let held = |inner: &InflatedSolid, outer: &InflatedSolid| {
            (outer.clearance(inner.core[0]) < -outer.reach).then_some(inner.core[0])
        };
        held(self, other).or_else(|| held(other, self))
    }

    /// Whether the segment `a`-`b`, its ends outside, enters the grown shape.
    pub fn crosses(&self, a: Point, b: Point) -> bool {
        let far = self.reach + self.extent - ROUNDING;
        if squared_to_segment(self.center, a, b) >= far * far {
            return false;
        }
        let near = self.reach - ROUNDING;
        self.core.len() == 1 || self.edges().any(|(c, d)| squared_between(a, b, c, d) < near * near)
    }
}

/// The grown obstacles of a world, found by place.
#[derive(Debug)]
pub(crate) struct Inflated {
    solids: Vec<InflatedSolid>,
    corners: Vec<Corner>,
    /// Squares between the nodes of this grid, each named by its lower left node.
    squares: Grid,
    /// Solids of square i: `listed[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    listed: Vec<u32>,
}

impl Inflated {
    /// Sorts `solids` into squares over `bounds`, which holds every grown shape and every point that is asked about.
    pub fn new(solids: Vec<InflatedSolid>, bounds: [f64; 4]) -> Self {
        let area = ((bounds[2] - bounds[0]) * (bounds[3] - bounds[1])).max(1e-6);
        let squares = Grid::around(bounds, (area / (64.0 + 4.0 * solids.len() as f64)).sqrt());
        let half = 0.5 * squares.cell;
        // The slack covers the rounding of a walk along the border of two squares.
        let diagonal = half * (std::f64::consts::SQRT_2 + 1e-6);
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(8 * solids.len());
        for (index, solid) in solids.iter().enumerate() {
            let [x0, y0, x1, y1] = solid.bounds();
            let cell = squares.cell;
            let [columns, rows] =
                squares.window([x0 - 1.01 * cell, y0 - 1.01 * cell, x1 + 0.01 * cell, y1 + 0.01 * cell]);
            for row in rows {
                for column in columns.clone() {
                    let square = row * squares.columns + column;
                    let [x, y] = squares.position(square);
                    if solid.clearance([x + half, y + half]) <= diagonal {
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
            solids.iter().flat_map(|s| s.core.iter().map(|p| Corner { center: *p, reach: s.reach })).collect();
        corners.sort_by(|a, b| a.center[0].total_cmp(&b.center[0]).then(a.center[1].total_cmp(&b.center[1])));
        corners.dedup();
        Self { solids, corners, squares, starts, listed: pairs.into_iter().map(|(_, index)| index).collect() }
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
    pub fn solids(&self) -> &[InflatedSolid] {
        &self.solids
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
            let [from, to] = self.solids[i as usize].joint(&self.solids[j as usize])?;
            Some(Joint { solids: [i as usize, j as usize], from, to })
        };
        pairs.into_iter().filter_map(joint).collect()
    }

    /// Whether `point` lies in no grown shape.
    pub fn is_free(&self, point: Point) -> bool {
        let (column, row) = self.square_of(point);
        self.listed_in(column, row).iter().all(|index| !self.solids[*index as usize].holds(point))
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
            if self.listed_in(column, row).iter().any(|index| self.solids[*index as usize].crosses(a, b)) {
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

    /// Solids whose grown shape may meet the circle of this `center` and `radius`.
    fn near_circle(&self, center: Point, radius: f64) -> Vec<&InflatedSolid> {
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
        let meets = |solid: &&InflatedSolid| apart(center, solid.center) <= touch + solid.reach + solid.extent;
        indices.into_iter().map(|index| &self.solids[index as usize]).filter(meets).collect()
    }

    /// Angles (rad, unordered, any multiple of a turn) at which the circle of this `center` and `radius` may enter or
    /// leave a grown shape.
    pub fn crossings(&self, center: Point, radius: f64) -> Vec<f64> {
        let mut angles = Vec::new();
        for solid in self.near_circle(center, radius) {
            add_crossings(&mut angles, solid, center, radius);
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
        near.iter().for_each(|solid| add_crossings(&mut angles, solid, center, reach));
        angles[own..].iter_mut().for_each(|crossing| *crossing = sweep(angle, *crossing, turn));
        angles.sort_by(f64::total_cmp);
        for pair in angles.windows(2) {
            let (sin, cos) = libm::sincos(angle + turn * 0.5 * (pair[0] + pair[1]));
            let middle = [center[0] + reach * cos, center[1] + reach * sin];
            if near.iter().any(|solid| solid.holds(middle)) {
                return pair[0];
            }
        }
        std::f64::consts::TAU
    }
}

/// Angle (rad, 0 to 2 pi) from `from` to `to`, counter-clockwise if `turn` is 1, clockwise if it is -1.
pub(crate) fn sweep(from: f64, to: f64, turn: f64) -> f64 {
    let turns = turn * (to - from) / std::f64::consts::TAU;
    (turns - turns.floor()) * std::f64::consts::TAU
}

/// Appends the angles at which the circle of this `center` and `radius` meets the circles about the corners of
/// `solid` and the lines beside its edges.
fn add_crossings(angles: &mut Vec<f64>, solid: &InflatedSolid, center: Point, radius: f64) {
    let mut meet = |direction: Point, cosine: f64| {
        if cosine.abs() <= 1.0 + TOUCH {
            let (middle, half) = (libm::atan2(direction[1], direction[0]), libm::acos(cosine.clamp(-1.0, 1.0)));
            angles.extend([middle - half, middle + half]);
        }
    };
    for corner in &solid.core {
        let offset = minus(*corner, center);
        let apart = dot(offset, offset).sqrt();
        if apart > ROUNDING {
            let square = radius * radius + apart * apart - solid.reach * solid.reach;
            meet(offset, square / (2.0 * radius * apart));
        }
    }
    for (a, b) in solid.edges() {
        let edge = minus(b, a);
        let length = dot(edge, edge).sqrt();
        let normal = [edge[1] / length, -edge[0] / length];
        meet(normal, (dot(normal, minus(a, center)) + solid.reach) / radius);
    }
}
