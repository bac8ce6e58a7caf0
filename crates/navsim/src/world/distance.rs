//! Exact distances between shapes in double precision, where scenarios are drawn and checked.
//!
//! The step of the simulator asks parry (`Obstacles`); here a decision is made once an episode, and one point more or
//! less than a wall decides whether a world is fair.

use super::shapes::{Shape, turn};
use parry2d::bounding_volume::Aabb;
use parry2d::math::Vector;
use parry2d::partitioning::{Bvh, BvhBuildStrategy};

/// From this many shapes on, a hierarchy of bounding boxes picks the near ones.
const HIERARCHY_FROM: usize = 32;

/// A shape ready for distance questions.
#[derive(Debug, Clone)]
pub(crate) struct Solid {
    pub center: [f64; 2],
    /// Radius of a disc about `center` that holds the shape, m.
    pub reach: f64,
    pub form: Form,
}

/// Circles, boxes, segments and capsules are all boxes with rounded corners.
#[derive(Debug, Clone)]
pub(crate) enum Form {
    Rounded(Rounded),
    /// Corners of a convex polygon, counter-clockwise.
    Polygon(Vec<[f64; 2]>),
}

/// A box whose every point is grown by a disc.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rounded {
    pub cos: f64,
    pub sin: f64,
    pub half_length: f64,
    pub half_width: f64,
    /// Radius of the disc, m; 0 for a box or a segment.
    pub radius: f64,
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn squared_distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let d = [b[0] - a[0], b[1] - a[1]];
    dot(d, d)
}

/// Squared distance (m^2) from `p` to the segment from `a` to `b`.
fn squared_distance_to_edge(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (along, from_a) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let t = (dot(from_a, along) / dot(along, along).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    squared_distance(p, [a[0] + t * along[0], a[1] + t * along[1]])
}

impl Rounded {
    /// Squared distance (m^2) from the point at `offset` from the centre to the box without its rounding.
    #[inline]
    fn squared_core_distance(&self, offset: [f64; 2]) -> f64 {
        let along = (self.cos * offset[0] + self.sin * offset[1]).abs() - self.half_length;
        let across = (self.cos * offset[1] - self.sin * offset[0]).abs() - self.half_width;
        let (along, across) = (along.max(0.0), across.max(0.0));
        along * along + across * across
    }
}

impl Solid {
    /// Prepares a shape that has passed `Shape::validate`.
    pub fn new(shape: &Shape) -> Self {
        match shape {
            Shape::Circle { center, radius } => Self::capsule(*center, *center, *radius),
            Shape::Segment { a, b } => Self::capsule(*a, *b, 0.0),
            Shape::Box { center, yaw, length, width } => {
                let (sin, cos) = libm::sincos(*yaw);
                Self::turned_box(*center, [cos, sin], 0.5 * length, 0.5 * width)
            }
            Shape::Polygon { points } => {
                let [x0, y0, x1, y1] = shape.bounds();
                let center = [0.5 * (x0 + x1), 0.5 * (y0 + y1)];
                let reach = points.iter().fold(0.0, |r: f64, p| r.max(squared_distance(center, *p))).sqrt();
                Self { center, reach, form: Form::Polygon(points.clone()) }
            }
        }
    }

    /// A box with its length along the unit vector `direction`.
    pub fn turned_box(center: [f64; 2], direction: [f64; 2], half_length: f64, half_width: f64) -> Self {
        let [cos, sin] = direction;
        let reach = (half_length * half_length + half_width * half_width).sqrt();
        Self { center, reach, form: Form::Rounded(Rounded { cos, sin, half_length, half_width, radius: 0.0 }) }
    }

    /// What a disc of `radius` sweeps on the straight way from `a` to `b`, which may coincide.
    pub fn capsule(a: [f64; 2], b: [f64; 2], radius: f64) -> Self {
        let length = squared_distance(a, b).sqrt();
        let (cos, sin) = if length > 0.0 { ((b[0] - a[0]) / length, (b[1] - a[1]) / length) } else { (1.0, 0.0) };
        let half_length = 0.5 * length;
        Self {
            center: [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])],
            reach: half_length + radius,
            form: Form::Rounded(Rounded { cos, sin, half_length, half_width: 0.0, radius }),
        }
    }

    fn rounding(&self) -> f64 {
        match &self.form {
            Form::Rounded(rounded) => rounded.radius,
            Form::Polygon(_) => 0.0,
        }
    }

    /// Squared distance (m^2) from `point` to the shape without its rounding, 0 inside.
    #[inline]
    fn squared_core_distance(&self, point: [f64; 2]) -> f64 {
        match &self.form {
            Form::Rounded(rounded) => {
                rounded.squared_core_distance([point[0] - self.center[0], point[1] - self.center[1]])
            }
            Form::Polygon(corners) => {
                let n = corners.len();
                let edges = || (0..n).map(|i| (corners[i], corners[(i + 1) % n]));
                if edges().all(|(a, b)| turn(a, b, point) >= 0.0) {
                    return 0.0;
                }
                edges().fold(f64::INFINITY, |d, (a, b)| d.min(squared_distance_to_edge(point, a, b)))
            }
        }
    }

    /// Distance (m) from `point` to the shape, 0 inside.
    pub fn distance(&self, point: [f64; 2]) -> f64 {
        (self.squared_core_distance(point).sqrt() - self.rounding()).max(0.0)
    }

    /// Whether the shape lies nearer to `point` than `limit` (m, > 0).
    #[inline]
    pub fn is_nearer(&self, point: [f64; 2], limit: f64) -> bool {
        let limit = limit + self.rounding();
        self.squared_core_distance(point) < limit * limit
    }

    /// Whether the distance between the two shapes is more than `gap` (m, >= 0).
    pub fn is_apart(&self, other: &Solid, gap: f64) -> bool {
        if !self.is_nearer(other.center, other.reach + gap) || !other.is_nearer(self.center, self.reach + gap) {
            return true;
        }
        self.distance_to(other) > gap
    }

    /// Distance (m) between two shapes, 0 when they touch or overlap.
    pub fn distance_to(&self, other: &Solid) -> f64 {
        self.with_corners(|mine| {
            other.with_corners(|theirs| {
                let apart = self.has_separating_axis(mine, theirs) || other.has_separating_axis(mine, theirs);
                if !apart {
                    return 0.0;
                }
                // Two convex sets that do not meet are nearest at a corner of one of them.
                let to_other = mine.iter().fold(f64::INFINITY, |d, c| d.min(other.squared_core_distance(*c)));
                let squared = theirs.iter().fold(to_other, |d, c| d.min(self.squared_core_distance(*c)));
                (squared.sqrt() - self.rounding() - other.rounding()).max(0.0)
            })
        })
    }

    fn with_corners<R>(&self, read: impl FnOnce(&[[f64; 2]]) -> R) -> R {
        match &self.form {
            Form::Polygon(corners) => read(corners),
            Form::Rounded(r) => {
                let (ux, uy) = (r.half_length * r.cos, r.half_length * r.sin);
                let (wx, wy) = (-r.half_width * r.sin, r.half_width * r.cos);
                let [x, y] = self.center;
                read(&[
                    [x - ux - wx, y - uy - wy],
                    [x + ux - wx, y + uy - wy],
                    [x + ux + wx, y + uy + wy],
                    [x - ux + wx, y - uy + wy],
                ])
            }
        }
    }

    /// Whether an edge normal of this shape (of a segment: also its direction) keeps the two sets of corners apart.
    fn has_separating_axis(&self, mine: &[[f64; 2]], theirs: &[[f64; 2]]) -> bool {
        let separates = |axis: [f64; 2]| {
            let span = |corners: &[[f64; 2]]| {
                corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| {
                    let along = dot(*c, axis);
                    (low.min(along), high.max(along))
                })
            };
            let ((low, high), (other_low, other_high)) = (span(mine), span(theirs));
            high < other_low || other_high < low
        };
        match &self.form {
            Form::Rounded(r) => separates([r.cos, r.sin]) || separates([-r.sin, r.cos]),
            Form::Polygon(corners) => (0..corners.len()).any(|i| {
                let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                separates([b[1] - a[1], a[0] - b[0]])
            }),
        }
    }
}

/// A set of shapes that do not move.
#[derive(Debug, Clone)]
pub(crate) struct Solids {
    pub all: Vec<Solid>,
    hierarchy: Option<Bvh>,
}

impl Solids {
    /// Prepares `shapes`, which must have passed `Shape::validate`.
    pub fn new(shapes: &[Shape]) -> Self {
        let boxes = || shapes.iter().map(|shape| loose_box(shape.bounds())).collect::<Vec<_>>();
        let hierarchy = (shapes.len() >= HIERARCHY_FROM).then(|| Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes()));
        Self { all: shapes.iter().map(Solid::new).collect(), hierarchy }
    }

    /// Whether any shape that meets the rectangle [x0, y0, x1, y1] (and perhaps some beyond it) fulfils `condition`.
    pub fn any_near(&self, [x0, y0, x1, y1]: [f64; 4], mut condition: impl FnMut(&Solid) -> bool) -> bool {
        match &self.hierarchy {
            Some(hierarchy) => {
                let near = loose_box([x0, y0, x1, y1]);
                hierarchy.intersect_aabb(&near).any(|leaf| condition(&self.all[leaf as usize]))
            }
            None => self.all.iter().any(condition),
        }
    }

    /// Whether a shape lies nearer to `point` than `limit` (m, > 0).
    pub fn is_nearer(&self, point @ [x, y]: [f64; 2], limit: f64) -> bool {
        self.any_near([x - limit, y - limit, x + limit, y + limit], |solid| solid.is_nearer(point, limit))
    }

    /// Whether a shape comes as near to `other` as `gap` (m, >= 0).
    pub fn touches(&self, other: &Solid, gap: f64) -> bool {
        let ([x, y], reach) = (other.center, other.reach + gap);
        self.any_near([x - reach, y - reach, x + reach, y + reach], |solid| !solid.is_apart(other, gap))
    }

    /// Distance (m) from `point` to the nearest shape; infinite without shapes.
    pub fn distance(&self, point: [f64; 2]) -> f64 {
        self.all.iter().fold(f64::INFINITY, |d, solid| d.min(solid.distance(point)))
    }
}

/// A rectangle in single precision that certainly holds the given one.
fn loose_box([x0, y0, x1, y1]: [f64; 4]) -> Aabb {
    const ROUNDING: f64 = 1e-3;
    Aabb::new(
        Vector::new((x0 - ROUNDING) as f32, (y0 - ROUNDING) as f32),
        Vector::new((x1 + ROUNDING) as f32, (y1 + ROUNDING) as f32),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4};

    fn solid_box(center: [f64; 2], yaw: f64, length: f64, width: f64) -> Solid {
        Solid::new(&Shape::Box { center, yaw, length, width })
    }

    #[test]
    fn distances_from_points() {
        let turned = solid_box([1.0, 0.0], FRAC_PI_4, 2.0, 2.0);
        assert!((turned.distance([3.0, 0.0]) - (2.0 - 1.0 / FRAC_1_SQRT_2)).abs() < 1e-12);
        assert_eq!(turned.distance([1.2, 0.1]), 0.0);
        let circle = Solid::new(&Shape::Circle { center: [0.0, 3.0], radius: 0.5 });
        assert!((circle.distance([0.0, 0.0]) - 2.5).abs() < 1e-12);
        let wall = Solid::new(&Shape::Segment { a: [0.0, 0.0], b: [4.0, 0.0] });
        assert!((wall.distance([7.0, 4.0]) - 5.0).abs() < 1e-12);
        let triangle = Solid::new(&Shape::Polygon { points: vec![[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]] });
        assert!((triangle.distance([2.0, 2.0]) - 2.0 * FRAC_1_SQRT_2).abs() < 1e-12);
        assert_eq!(triangle.distance([0.5, 0.5]), 0.0);
        assert!(wall.is_nearer([7.0, 4.0], 5.001) && !wall.is_nearer([7.0, 4.0], 4.999));
    }

    #[test]
    fn distances_between_shapes() {
        let unit = solid_box([0.0, 0.0], 0.0, 2.0, 2.0);
        assert!((unit.distance_to(&solid_box([4.0, 5.0], 0.0, 2.0, 2.0)) - 13f64.sqrt()).abs() < 1e-12);
        // A cross: no corner lies in the other box.
        let (flat, tall) = (solid_box([0.0, 0.0], 0.0, 4.0, 0.2), solid_box([0.5, 0.0], 0.0, 0.2, 4.0));
        assert_eq!(flat.distance_to(&tall), 0.0);
        assert!(!flat.is_apart(&tall, 0.0));
        // Two pieces of one straight line.
        let near = Solid::new(&Shape::Segment { a: [0.0, 0.0], b: [1.0, 1.0] });
        let far = Solid::new(&Shape::Segment { a: [2.0, 2.0], b: [3.0, 3.0] });
        assert!((near.distance_to(&far) - 2f64.sqrt()).abs() < 1e-12);
        let ball = Solid::new(&Shape::Circle { center: [4.0, 1.0], radius: 1.0 });
        assert!((unit.distance_to(&ball) - 2.0).abs() < 1e-12);
        let corridor = Solid::capsule([-3.0, 2.0], [3.0, 2.0], 0.9);
        assert!((corridor.distance_to(&unit) - 0.1).abs() < 1e-12);
        assert!(corridor.is_apart(&unit, 0.09) && !corridor.is_apart(&unit, 0.11));
        let triangle = Solid::new(&Shape::Polygon { points: vec![[3.0, 0.0], [5.0, -1.0], [5.0, 1.0]] });
        assert!((unit.distance_to(&triangle) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_hierarchy_answers_like_the_loop() {
        let shapes: Vec<Shape> = (0..100)
            .map(|i| Shape::Circle {
                center: [f64::from(i % 10), f64::from(i / 10)],
                radius: 0.1 + 0.002 * f64::from(i),
            })
            .collect();
        let solids = Solids::new(&shapes);
        for i in 0..200 {
            let point = [0.05 * f64::from(i), 0.037 * f64::from((i * 7) % 200)];
            let distance = solids.distance(point);
            assert!(solids.is_nearer(point, distance + 1e-6));
            assert!(distance < 1e-6 || !solids.is_nearer(point, distance - 1e-6));
        }
    }
}
