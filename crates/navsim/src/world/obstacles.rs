//! Shapes prepared for the questions of a step: how near is the nearest one, and what does a beam meet.

use super::blocks::{BLOCK, Block, Blocks};
use super::distance as exact;
use super::outline::{BOXES, Outline, TREE_FROM};
use super::shapes::Shape;
use crate::cpu::prefetch;
use crate::robot::Footprint;
use parry2d::bounding_volume::{Aabb, BoundingVolume};
use parry2d::math::{Pose, Rotation, Vector};
use parry2d::partitioning::{Bvh, BvhBuildStrategy};
use parry2d::query::{PointQuery, Ray, RayCast};
use parry2d::shape::{Ball, ConvexPolygon, Cuboid, Segment, Shape as ParryShape};
use std::ops::Range;

/// From this many shapes on, a bounding volume hierarchy beats one shape after the other.
const HIERARCHY_FROM: usize = 32;
/// A tree reorders the boxes of an outline, but not what is placed: with one, distances need a hierarchy.
const _: () = assert!(HIERARCHY_FROM <= (TREE_FROM - 1) * BOXES + 1);

/// Solid obstacles and walls, ready for distance queries (parry) and for the scan kernels (outline).
///
/// Static shapes are prepared once and shared by all robots of a world; moved boxes live in a second, small `Obstacles`
/// of each robot that is refilled at a reset without allocating.
#[derive(Debug, Clone, Default)]
pub struct Obstacles {
    /// Boxes first, as `outline.boxes` has them unless there is a hierarchy.
    placed: Vec<Placed>,
    /// The same in double precision, for rectangular footprints: parry's iterative distance of two such shapes errs by
    /// tenths of a millimetre.
    exact: Vec<exact::Solid>,
    /// A rectangle around each shape that is no box: [x0, y0, x1, y1], m.
    bounds: Blocks<4>,
    hierarchy: Option<Box<Bvh>>,
    outline: Outline,
}

/// A shape as parry sees it: an enumeration of known types, which takes half the time of a trait object.
#[derive(Debug, Clone)]
enum Solid {
    Ball(Ball),
    Cuboid(Cuboid),
    Segment(Segment),
    /// Rare and large: apart, so that the others lie close together.
    Polygon(Box<ConvexPolygon>),
}

#[derive(Debug, Clone)]
struct Placed {
    solid: Solid,
    world_from_shape: Pose,
}

/// A point in parry's type.
pub(crate) fn vector(point: [f64; 2]) -> Vector {
    Vector::new(point[0] as f32, point[1] as f32)
}

/// A pose in parry's type; sine and cosine are taken in double precision.
pub(crate) fn isometry(x: f64, y: f64, yaw: f64) -> Pose {
    let (sin, cos) = libm::sincos(yaw);
    let rotation = Rotation { re: cos as f32, im: sin as f32 };
    Pose::from_parts(vector([x, y]), rotation)
}

impl Obstacles {
    /// Prepares `shapes`, which must have passed `Shape::validate`.
    pub fn new(shapes: &[Shape]) -> Self {
        let mut obstacles = Self::default();
        obstacles.refill(shapes);
        if shapes.len() >= HIERARCHY_FROM {
            let boxes: Vec<Aabb> = obstacles.placed.iter().map(Placed::aabb).collect();
            obstacles.hierarchy = Some(Box::new(Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes)));
        }
        obstacles.outline.build_trees();
        obstacles
    }

    /// Takes `shapes`, which must have passed `Shape::validate`, in the place of what there was; keeps the memory, and
    /// builds no hierarchy.
    pub fn refill(&mut self, shapes: &[Shape]) {
        self.placed.clear();
        self.exact.clear();
        self.bounds.clear();
        self.hierarchy = None;
        self.outline.clear();
        let is_box = |shape: &&Shape| matches!(shape, Shape::Box { .. });
        self.placed.reserve_exact(shapes.len());
        self.exact.reserve_exact(shapes.len());
        self.outline.boxes.reserve(shapes.iter().filter(is_box).count());
        for shape in shapes.iter().filter(is_box) {
            self.placed.push(Placed::new(shape));
            self.exact.push(exact::Solid::new(shape));
            self.outline.push(shape);
        }
        for shape in shapes.iter().filter(|shape| !is_box(shape)) {
            self.placed.push(Placed::new(shape));
            self.exact.push(exact::Solid::new(shape));
            self.bounds.push(bounding_rectangle(shape));
            self.outline.push(shape);
        }
    }

    /// Number of shapes.
    pub fn len(&self) -> usize {
        self.placed.len()
    }

    /// Whether there is no shape.
    pub fn is_empty(&self) -> bool {
        self.placed.is_empty()
    }

    /// Asks for all of it to be brought near: the shapes of the next robot, while this one is stepped.
    pub(crate) fn prefetch(&self) {
        prefetch(&self.placed);
        prefetch(self.bounds.blocks());
        self.outline.prefetch();
    }

    /// The same in arrays, for the scan kernels.
    pub(crate) fn outline(&self) -> &Outline {
        &self.outline
    }

    /// Distance (m) from `point` to the nearest shape: 0 inside a solid, `limit` if nothing is nearer than `limit`.
    pub fn distance(&self, point: [f64; 2], limit: f32) -> f32 {
        let point = vector(point);
        match &self.hierarchy {
            Some(hierarchy) => {
                let nearest = hierarchy.find_best(
                    limit,
                    |node, _| node.aabb().distance_to_local_point(point, true),
                    |leaf, _| Some(self.placed[leaf as usize].distance_to_point(point)),
                );
                nearest.map_or(limit, |(_, distance)| distance)
            }
            None => self.nearest_by(point, 0.0, limit, |index| self.placed[index].distance_to_point(point)),
        }
    }

    /// Distance (m) between `footprint` at [x, y, yaw] and the nearest shape, 0 when they touch or overlap; `limit` if
    /// nothing is nearer than `limit`.
    pub fn clearance(&self, footprint: &Footprint, pose: [f64; 3], limit: f32) -> f32 {
        let center = [pose[0], pose[1]];
        let (half_length, half_width) = match *footprint {
            Footprint::Disc { radius } => {
                let radius = radius as f32;
                return (self.distance(center, limit + radius) - radius).max(0.0);
            }
            Footprint::Rectangle { length, width } => (0.5 * length, 0.5 * width),
        };
        let (sin, cos) = libm::sincos(pose[2]);
        let own = exact::Solid::turned_box(center, [cos, sin], half_length, half_width);
        let point = vector(center);
        let reach = own.reach as f32 + ROUNDING * (1.0 + point.x.abs() + point.y.abs());
        let measure = |index: usize| self.exact[index].distance_to(&own) as f32;
        match &self.hierarchy {
            Some(hierarchy) => {
                let around = Aabb::from_half_extents(point, Vector::splat(reach));
                let nearest = hierarchy.find_best(
                    limit,
                    |node, _| aabb_distance(&node.aabb(), &around),
                    |leaf, _| Some(measure(leaf as usize)),
                );
                nearest.map_or(limit, |(_, distance)| distance)
            }
            None => self.nearest_by(point, reach, limit, measure),
        }
    }

    /// The smallest `distance` of a shape from something that reaches `reach` m around `point`, or `limit` if none is
    /// smaller. Asks only about shapes that come near enough: their bounds are looked at block by block.
    fn nearest_by(&self, point: Vector, reach: f32, limit: f32, distance: impl Fn(usize) -> f32) -> f32 {
        let closest =
            |nearest: f32, gaps: &[f32], shapes: Range<usize>| {
                gaps.iter().zip(shapes).fold(nearest, |nearest, (gap, index)| {
                    if *gap < nearest { nearest.min(distance(index)) } else { nearest }
                })
            };
        let boxes = self.outline.boxes.len();
        let mut nearest = limit;
        for (i, block) in self.outline.boxes.blocks().iter().enumerate() {
            nearest = closest(nearest, &gaps_to_boxes(block, point, reach), i * BOXES..boxes);
        }
        for (i, block) in self.bounds.blocks().iter().enumerate() {
            let others = boxes + i * BLOCK..self.len();
            nearest = closest(nearest, &gaps_to_rectangles(block, point, reach), others);
        }
        nearest
    }

    /// Whether `point` lies inside a solid shape (walls have no inside).
    pub fn contains(&self, point: [f64; 2]) -> bool {
        let point = vector(point);
        let inside =
            |placed: &Placed| !matches!(placed.solid, Solid::Segment(_)) && placed.distance_to_point(point) <= 0.0;
        match &self.hierarchy {
            Some(hierarchy) => {
                let own = Aabb::new(point, point);
                hierarchy.intersect_aabb(&own).any(|leaf| inside(&self.placed[leaf as usize]))
            }
            None => self.placed.iter().any(inside),
        }
    }

    /// Range (m) at which a beam from `origin` along the unit vector `direction` meets a shape, at most `range_max`;
    /// 0 if the origin lies inside a solid. The reference for the scan kernels, and slow.
    pub fn cast_ray(&self, origin: [f32; 2], direction: [f32; 2], range_max: f32) -> f32 {
        let ray = Ray::new(Vector::new(origin[0], origin[1]), Vector::new(direction[0], direction[1]));
        match &self.hierarchy {
            Some(hierarchy) => {
                let hit = hierarchy
                    .cast_ray(&ray, range_max, |leaf, nearest| self.placed[leaf as usize].cast_ray(&ray, nearest));
                hit.map_or(range_max, |(_, range)| range)
            }
            None => {
                self.placed.iter().fold(range_max, |nearest, placed| placed.cast_ray(&ray, nearest).unwrap_or(nearest))
            }
        }
    }
}

/// More than what rounding takes from a bound: this (m), and this part of it and of the distance to it.
const ROUNDING: f32 = 2e-6;

/// A rectangle that certainly holds `shape`: [x0, y0, x1, y1], m.
fn bounding_rectangle(shape: &Shape) -> [f32; 4] {
    let [x0, y0, x1, y1] = shape.bounds().map(|bound| bound as f32);
    let slack = |bound: f32| ROUNDING * (1.0 + bound.abs());
    [x0 - slack(x0), y0 - slack(y0), x1 + slack(x1), y1 + slack(y1)]
}

/// Distances (m), or less, from eight boxes to a disc of radius `reach` around `point`; not positive where they
/// may overlap.
fn gaps_to_boxes(Block(boxes): &Block<6, BOXES>, point: Vector, reach: f32) -> [f32; BOXES] {
    let [x, y, along_x, along_y, across_x, across_y] = boxes;
    std::array::from_fn(|i| {
        let (dx, dy) = (point.x - x[i], point.y - y[i]);
        let (along, across) =
            (along_x[i] * along_x[i] + along_y[i] * along_y[i], across_x[i] * across_x[i] + across_y[i] * across_y[i]);
        let radius = (along + across).sqrt() * (1.0 + ROUNDING) + ROUNDING;
        (dx * dx + dy * dy).sqrt() * (1.0 - ROUNDING) - radius - reach
    })
}

/// Distances (m), or less, from sixteen rectangles to a disc of radius `reach` around `point`; not positive where they
/// may overlap.
fn gaps_to_rectangles(Block([x0, y0, x1, y1]): &Block<4, BLOCK>, point: Vector, reach: f32) -> [f32; BLOCK] {
    let outside = |at: f32, low: f32, high: f32| (low - at).max(at - high).max(0.0);
    std::array::from_fn(|i| {
        let (dx, dy) = (outside(point.x, x0[i], x1[i]), outside(point.y, y0[i], y1[i]));
        (dx * dx + dy * dy).sqrt() * (1.0 - ROUNDING) - reach
    })
}

/// Distance between two axis-parallel boxes: a lower bound of the distance of what they hold.
fn aabb_distance(a: &Aabb, b: &Aabb) -> f32 {
    let gap = (b.mins - a.maxs).max(a.mins - b.maxs).max(Vector::ZERO);
    gap.length()
}

impl Placed {
    fn new(shape: &Shape) -> Self {
        let (solid, world_from_shape) = match shape {
            Shape::Circle { center, radius } => {
                (Solid::Ball(Ball::new(*radius as f32)), isometry(center[0], center[1], 0.0))
            }
            Shape::Box { center, yaw, length, width } => {
                let half = Vector::new(0.5 * *length as f32, 0.5 * *width as f32);
                (Solid::Cuboid(Cuboid::new(half)), isometry(center[0], center[1], *yaw))
            }
            Shape::Segment { a, b } => (Solid::Segment(Segment::new(vector(*a), vector(*b))), Pose::identity()),
            Shape::Polygon { points } => {
                let corners: Vec<Vector> = points.iter().copied().map(vector).collect();
                match ConvexPolygon::from_convex_polyline_unmodified(corners) {
                    Some(polygon) => (Solid::Polygon(Box::new(polygon)), Pose::identity()),
                    // Corners that fall together in single precision leave a sliver: its longest diagonal.
                    None => (
                        Solid::Segment(Segment::new(vector(points[0]), vector(points[points.len() / 2]))),
                        Pose::identity(),
                    ),
                }
            }
        };
        Self { solid, world_from_shape }
    }

    fn shape(&self) -> &dyn ParryShape {
        match &self.solid {
            Solid::Ball(ball) => ball,
            Solid::Cuboid(cuboid) => cuboid,
            Solid::Segment(segment) => segment,
            Solid::Polygon(polygon) => &**polygon,
        }
    }

    fn aabb(&self) -> Aabb {
        self.shape().compute_aabb(&self.world_from_shape).loosened(1e-5)
    }

    fn distance_to_point(&self, point: Vector) -> f32 {
        match &self.solid {
            Solid::Ball(ball) => ball.distance_to_point(&self.world_from_shape, point, true),
            Solid::Cuboid(cuboid) => cuboid.distance_to_point(&self.world_from_shape, point, true),
            Solid::Segment(segment) => segment.distance_to_local_point(point, true),
            Solid::Polygon(polygon) => polygon.distance_to_local_point(point, true),
        }
    }

    fn cast_ray(&self, ray: &Ray, limit: f32) -> Option<f32> {
        match &self.solid {
            Solid::Ball(ball) => ball.cast_ray(&self.world_from_shape, ray, limit, true),
            Solid::Cuboid(cuboid) => cuboid.cast_ray(&self.world_from_shape, ray, limit, true),
            Solid::Segment(segment) => segment.cast_local_ray(ray, limit, true),
            Solid::Polygon(polygon) => polygon.cast_local_ray(ray, limit, true),
        }
    }
}
