//! A shape grown by the robot's radius.
//!
//! It is a convex core (a point, a segment, a polygon) grown by a reach: the robot's radius, for a circle plus the
//! circle's own. Its border is made of arcs about the corners of the core and of straight lines between them.

use super::points::{Point, apart, cross, dot, minus, nearest_on_segment, squared_between, squared_to_segment};
use crate::world::Shape;
use crate::world::shapes::rectangle_around;

/// Clearance (m) below the radius that still counts as free: the rounding of tangents and arcs, and nothing else.
const ROUNDING: f64 = 1e-9;
/// A circle that misses a line or another circle by this share of its radius counts as touching it.
pub(super) const TOUCH: f64 = 1e-6;

/// A convex core and its reach.
#[derive(Debug, Clone)]
pub(crate) struct GrownShape {
    pub(super) core: Vec<Point>,
    /// Distance from the core that is blocked, m.
    pub(super) reach: f64,
    /// Mean of the core's corners: a point of the core.
    pub(super) center: Point,
    /// Largest distance of the core from its centre, m.
    pub(super) extent: f64,
}

impl GrownShape {
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
        let [x0, y0, x1, y1] = rectangle_around(self.core.iter().map(|[x, y]| [*x, *y, *x, *y]));
        [x0 - self.reach, y0 - self.reach, x1 + self.reach, y1 + self.reach]
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

    /// Whether `point` lies within the grown shape.
    pub(super) fn holds(&self, point: Point) -> bool {
        let far = self.reach + self.extent;
        let offset = minus(point, self.center);
        dot(offset, offset) < far * far && self.clearance(point) < -ROUNDING
    }

    /// Nearest points of the two cores, if the grown shapes overlap.
    pub(super) fn joint(&self, other: &GrownShape) -> Option<[Point; 2]> {
        let far = self.reach + other.reach;
        if apart(self.center, other.center) > far + self.extent + other.extent {
            return None;
        }
        let mut best = ((far - ROUNDING) * (far - ROUNDING), None);
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
    fn common_point(&self, other: &GrownShape) -> Option<Point> {
        for (a, b) in self.edges() {
            for (c, d) in other.edges() {
                if squared_between(a, b, c, d) == 0.0 {
                    let (first, second) = (minus(b, a), minus(d, c));
                    let share = cross(minus(c, a), second) / cross(first, second);
                    return Some([a[0] + share * first[0], a[1] + share * first[1]]);
                }
            }
        }
        let held = |inner: &GrownShape, outer: &GrownShape| {
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

    /// Appends the angles at which the circle of this `center` and `radius` meets the circles about the corners of
    /// the core and the lines beside its edges.
    pub(super) fn add_crossings(&self, angles: &mut Vec<f64>, center: Point, radius: f64) {
        let mut meet = |direction: Point, cosine: f64| {
            if cosine.abs() <= 1.0 + TOUCH {
                let (middle, half) = (libm::atan2(direction[1], direction[0]), libm::acos(cosine.clamp(-1.0, 1.0)));
                angles.extend([middle - half, middle + half]);
            }
        };
        for corner in &self.core {
            let offset = minus(*corner, center);
            let apart = dot(offset, offset).sqrt();
            if apart > ROUNDING {
                let square = radius * radius + apart * apart - self.reach * self.reach;
                meet(offset, square / (2.0 * radius * apart));
            }
        }
        for (a, b) in self.edges() {
            let edge = minus(b, a);
            let length = dot(edge, edge).sqrt();
            let normal = [edge[1] / length, -edge[0] / length];
            meet(normal, (dot(normal, minus(a, center)) + self.reach) / radius);
        }
    }
}
