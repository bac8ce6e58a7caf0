//! Shapes prepared for the questions of a step: how near is the nearest one, and what does a beam meet.

use super::blocks::{BLOCK, Blocks, Lanes};
use super::outline::Outline;
use super::shapes::Shape;
use crate::cpu::prefetch;
use crate::robot::Footprint;
use parry2d::bounding_volume::{Aabb, BoundingVolume};
use parry2d::math::{Pose, Rotation, Vector};
use parry2d::partitioning::{Bvh, BvhBuildStrategy};
use parry2d::query::{self, PointQuery, Ray, RayCast};
use parry2d::shape::{Ball, ConvexPolygon, Cuboid, Segment, Shape as ParryShape};

/// From this many shapes on, a bounding volume hierarchy beats one shape after the other.
const HIERARCHY_FROM: usize = 32;

/// Solid obstacles and walls, ready for distance queries (parry) and for the scan kernels (outline).
///
/// Static shapes are prepared once and shared by all robots of a world; moved boxes live in a second, small `Obstacles`
/// of each robot that is cleared and refilled at a reset without allocating.
#[derive(Debug, Clone, Default)]
pub struct Obstacles {
    placed: Vec<Placed>,
    /// A disc around each shape: centre x, y and radius, m.
    bounds: Blocks<3>,
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
        for shape in shapes {
            obstacles.push(shape);
        }
        if shapes.len() >= HIERARCHY_FROM {
            let boxes: Vec<Aabb> = obstacles.placed.iter().map(Placed::aabb).collect();
            obstacles.hierarchy = Some(Box::new(Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes)));
        }
        obstacles.outline.build_trees();
        obstacles
    }

    /// Removes all shapes and keeps the memory.
    pub fn clear(&mut self) {
        self.placed.clear();
        self.bounds.clear();
        self.hierarchy = None;
        self.outline.clear();
    }

    /// Adds a shape that has passed `Shape::validate`.
    pub fn push(&mut self, shape: &Shape) {
        self.hierarchy = None;
        self.placed.push(Placed::new(shape));
        self.bounds.push(bounding_disc(shape));
        self.outline.push(shape);
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
            None => self.nearest_by(point, 0.0, limit, |placed| placed.distance_to_point(point)),
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
            Footprint::Rectangle { length, width } => (0.5 * length as f32, 0.5 * width as f32),
        };
        let cuboid = Cuboid::new(Vector::new(half_length, half_width));
        let reach = footprint.circumscribed_radius() as f32;
        let (point, world_from_robot) = (vector(center), isometry(pose[0], pose[1], pose[2]));
        let measure = |placed: &Placed| placed.distance_to_cuboid(&cuboid, &world_from_robot);
        match &self.hierarchy {
            Some(hierarchy) => {
                let own = cuboid.compute_aabb(&world_from_robot);
                let nearest = hierarchy.find_best(
                    limit,
                    |node, _| aabb_distance(&node.aabb(), &own),
                    |leaf, _| Some(measure(&self.placed[leaf as usize])),
                );
                nearest.map_or(limit, |(_, distance)| distance)
            }
            None => self.nearest_by(point, reach, limit, measure),
        }
    }

    /// The smallest `distance` of a shape from something that reaches `reach` m around `point`, or `limit` if none is
    /// smaller. Asks only about shapes that come near enough: sixteen discs are looked at together.
    fn nearest_by(&self, point: Vector, reach: f32, limit: f32, distance: impl Fn(&Placed) -> f32) -> f32 {
        let mut nearest = limit;
        for (discs, placed) in self.bounds.blocks().iter().zip(self.placed.chunks(BLOCK)) {
            let gaps = gaps_to_discs(discs, point, reach);
            for (gap, placed) in gaps.iter().zip(placed) {
                if *gap < nearest {
                    nearest = nearest.min(distance(placed));
                }
            }
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

/// A disc that certainly holds `shape`: centre x, y and radius, m.
fn bounding_disc(shape: &Shape) -> [f32; 3] {
    let [x0, y0, x1, y1] = shape.bounds();
    let center = vector([0.5 * (x0 + x1), 0.5 * (y0 + y1)]);
    // A circle's box has a larger diagonal than the circle needs; the bound only has to hold.
    let radius = match shape {
        Shape::Circle { radius, .. } => *radius as f32,
        _ => 0.5 * libm::hypot(x1 - x0, y1 - y0) as f32,
    };
    [center.x, center.y, radius * 1.000_001 + 1e-6]
}

/// Distances (m) from sixteen discs to one of radius `reach` around `point`; negative where they overlap.
fn gaps_to_discs([x, y, radius]: &[Lanes; 3], point: Vector, reach: f32) -> [f32; BLOCK] {
    std::array::from_fn(|i| {
        let (dx, dy) = (point.x - x.0[i], point.y - y.0[i]);
        (dx * dx + dy * dy).sqrt() - radius.0[i] - reach
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

    fn distance_to_cuboid(&self, cuboid: &Cuboid, world_from_cuboid: &Pose) -> f32 {
        if let Solid::Ball(ball) = &self.solid {
            let center = self.world_from_shape.translation;
            return (cuboid.distance_to_point(world_from_cuboid, center, true) - ball.radius).max(0.0);
        }
        // Every pair of these types is supported by parry; a refusal would count as contact.
        query::distance(world_from_cuboid, cuboid, &self.world_from_shape, self.shape()).map_or(0.0, |d| d.distance)
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
