//! Points, segments and angles of the plane.

/// A place, m.
pub(crate) type Point = [f64; 2];

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

pub(super) fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Squared distance of `point` from the segment `a`-`b`.
pub(super) fn squared_to_segment(point: Point, a: Point, b: Point) -> f64 {
    let rest = minus(point, nearest_on_segment(point, a, b));
    dot(rest, rest)
}

/// The point of the segment `a`-`b` that is nearest to `point`.
pub(super) fn nearest_on_segment(point: Point, a: Point, b: Point) -> Point {
    let (edge, offset) = (minus(b, a), minus(point, a));
    let square = dot(edge, edge);
    let share = if square > 0.0 { (dot(offset, edge) / square).clamp(0.0, 1.0) } else { 0.0 };
    [a[0] + share * edge[0], a[1] + share * edge[1]]
}

/// Squared distance between the segments `a`-`b` and `c`-`d`, 0 where they cross.
pub(super) fn squared_between(a: Point, b: Point, c: Point, d: Point) -> f64 {
    let (first, second) = (minus(b, a), minus(d, c));
    let sides = cross(first, minus(c, a)) * cross(first, minus(d, a)) < 0.0;
    if sides && cross(second, minus(a, c)) * cross(second, minus(b, c)) < 0.0 {
        return 0.0;
    }
    let ends = squared_to_segment(a, c, d).min(squared_to_segment(b, c, d));
    ends.min(squared_to_segment(c, a, b)).min(squared_to_segment(d, a, b))
}

/// Angle (rad, 0 to 2 pi) from `from` to `to`, counter-clockwise if `turn` is 1, clockwise if it is -1.
pub(crate) fn sweep(from: f64, to: f64, turn: f64) -> f64 {
    let turns = turn * (to - from) / std::f64::consts::TAU;
    (turns - turns.floor()) * std::f64::consts::TAU
}
