//! What a planar world is made of, as a user writes it: plain numbers in metres and radians.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Largest coordinate (m) of a shape: beyond it single precision no longer resolves 0.1 mm.
pub const COORDINATE_MAX: f64 = 1000.0;
/// Largest number of corners of a polygon.
pub const POLYGON_CORNERS_MAX: usize = 64;

/// One obstacle. Circles, boxes and polygons are solid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Shape {
    /// A disc.
    Circle {
        /// Centre, m.
        center: [f64; 2],
        /// Radius, m, > 0.
        radius: f64,
    },
    /// An oriented box.
    Box {
        /// Centre, m.
        center: [f64; 2],
        /// Direction of its length, rad.
        yaw: f64,
        /// Full extent along `yaw`, m, > 0.
        length: f64,
        /// Full extent across `yaw`, m, > 0.
        width: f64,
    },
    /// A wall without thickness.
    Segment {
        /// One end, m.
        a: [f64; 2],
        /// The other end, m.
        b: [f64; 2],
    },
    /// A convex polygon of 3 to 64 corners, counter-clockwise.
    Polygon {
        /// Corners, m.
        points: Vec<[f64; 2]>,
    },
}

fn finite(what: &str, values: &[f64]) -> Result<()> {
    match values.iter().find(|v| !v.is_finite() || v.abs() > COORDINATE_MAX) {
        Some(v) => Err(Error::Shape(format!("{what}: {v} is not a number within +-{COORDINATE_MAX}"))),
        None => Ok(()),
    }
}

fn positive(what: &str, value: f64) -> Result<()> {
    if value >= 1e-4 {
        return Ok(());
    }
    Err(Error::Shape(format!("{what} = {value}: expected at least 0.0001 m")))
}

/// z of the cross product (b - a) x (c - a): positive when a, b, c turn left.
pub fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

impl Shape {
    /// The polygon with these corners, in either order; stored counter-clockwise.
    ///
    /// # Errors
    /// Fewer than 3 or more than 64 corners, a number out of range, or corners that are not strictly convex.
    pub fn polygon(mut points: Vec<[f64; 2]>) -> Result<Self> {
        let n = points.len();
        if !(3..=POLYGON_CORNERS_MAX).contains(&n) {
            return Err(Error::Shape(format!("polygon with {n} corners: expected 3 to {POLYGON_CORNERS_MAX}")));
        }
        let area: f64 = (1..n - 1).map(|i| turn(points[0], points[i], points[i + 1])).sum();
        if area < 0.0 {
            points.reverse();
        }
        let shape = Shape::Polygon { points };
        shape.validate()?;
        Ok(shape)
    }

    /// Checks that every number is finite and the shape is not degenerate.
    ///
    /// # Errors
    /// What is wrong, in one line.
    pub fn validate(&self) -> Result<()> {
        match self {
            Shape::Circle { center, radius } => {
                finite("circle", &[center[0], center[1], *radius])?;
                positive("radius of a circle", *radius)
            }
            Shape::Box { center, yaw, length, width } => {
                finite("box", &[center[0], center[1], *yaw, *length, *width])?;
                positive("length of a box", *length)?;
                positive("width of a box", *width)
            }
            Shape::Segment { a, b } => {
                finite("segment", &[a[0], a[1], b[0], b[1]])?;
                positive("length of a segment", crate::pose::distance(*a, *b))
            }
            Shape::Polygon { points } => {
                let n = points.len();
                points.iter().try_for_each(|p| finite("polygon", p))?;
                // Turning left at every corner is not enough: a star turns left too, but goes round more than once.
                let left = (0..n).all(|i| turn(points[i], points[(i + 1) % n], points[(i + 2) % n]) > 1e-9);
                let once = (1..n.saturating_sub(1)).all(|i| turn(points[0], points[i], points[i + 1]) > 0.0);
                if n >= 3 && left && once {
                    return Ok(());
                }
                Err(Error::Shape("polygon: its corners are not those of a convex polygon in order".into()))
            }
        }
    }

    /// Place of the shape's kind in the file format: circles, boxes, segments, polygons.
    pub fn kind(&self) -> u8 {
        match self {
            Shape::Circle { .. } => 0,
            Shape::Box { .. } => 1,
            Shape::Segment { .. } => 2,
            Shape::Polygon { .. } => 3,
        }
    }

    /// Corners in counter-clockwise order: 4 of a box, 2 of a segment, all of a polygon, none of a circle.
    pub fn corners(&self) -> Vec<[f64; 2]> {
        match self {
            Shape::Circle { .. } => Vec::new(),
            Shape::Box { center, yaw, length, width } => box_corners(*center, *yaw, *length, *width).to_vec(),
            Shape::Segment { a, b } => vec![*a, *b],
            Shape::Polygon { points } => points.clone(),
        }
    }

    /// Smallest axis-parallel rectangle around the shape: [x0, y0, x1, y1], metres.
    pub fn bounds(&self) -> [f64; 4] {
        let around = |corners: &[[f64; 2]]| rectangle_around(corners.iter().map(|[x, y]| [*x, *y, *x, *y]));
        match self {
            Shape::Circle { center: [x, y], radius } => [x - radius, y - radius, x + radius, y + radius],
            Shape::Box { center, yaw, length, width } => around(&box_corners(*center, *yaw, *length, *width)),
            Shape::Segment { a, b } => around(&[*a, *b]),
            Shape::Polygon { points } => around(points),
        }
    }
}

/// Smallest axis-parallel rectangle around others (all [x0, y0, x1, y1], metres; a point is one too).
pub(crate) fn rectangle_around(rectangles: impl Iterator<Item = [f64; 4]>) -> [f64; 4] {
    let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    rectangles.fold(start, |around, [x0, y0, x1, y1]| {
        [around[0].min(x0), around[1].min(y0), around[2].max(x1), around[3].max(y1)]
    })
}

/// The corners of an oriented box (arguments as in `Shape::Box`), counter-clockwise.
pub fn box_corners(center: [f64; 2], yaw: f64, length: f64, width: f64) -> [[f64; 2]; 4] {
    let (sin, cos) = libm::sincos(yaw);
    let (ux, uy) = (0.5 * length * cos, 0.5 * length * sin);
    let (wx, wy) = (-0.5 * width * sin, 0.5 * width * cos);
    let [x, y] = center;
    [[x - ux - wx, y - uy - wy], [x + ux - wx, y + uy - wy], [x + ux + wx, y + uy + wy], [x - ux + wx, y - uy + wy]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_come_in_either_order() {
        let left = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let right: Vec<_> = left.iter().rev().copied().collect();
        let Ok(Shape::Polygon { points }) = Shape::polygon(right) else { panic!("refused") };
        assert_eq!(points, left);
    }

    #[test]
    fn shapes_without_extent_and_concave_polygons_are_refused() {
        assert!(Shape::Circle { center: [0.0, 0.0], radius: 0.0 }.validate().is_err());
        assert!(Shape::Circle { center: [f64::NAN, 0.0], radius: 1.0 }.validate().is_err());
        assert!(Shape::Segment { a: [1.0, 1.0], b: [1.0, 1.0] }.validate().is_err());
        assert!(Shape::polygon(vec![[0.0, 0.0], [2.0, 0.0], [0.5, 0.5], [0.0, 2.0]]).is_err());
        let star = (0..5).map(|i| {
            let (sin, cos) = libm::sincos(f64::from(i) * 4.0 * std::f64::consts::PI / 5.0);
            [cos, sin]
        });
        assert!(Shape::polygon(star.collect()).is_err());
    }

    #[test]
    fn corners_of_a_turned_box() {
        let corners = box_corners([1.0, 2.0], std::f64::consts::FRAC_PI_2, 4.0, 2.0);
        let expected = [[2.0, 0.0], [2.0, 4.0], [0.0, 4.0], [0.0, 0.0]];
        for (corner, wanted) in corners.iter().zip(expected) {
            assert!((corner[0] - wanted[0]).abs() < 1e-12 && (corner[1] - wanted[1]).abs() < 1e-12);
        }
    }
}
