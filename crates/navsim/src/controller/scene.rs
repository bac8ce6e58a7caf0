//! What a controller knows of its surroundings: the points that the beams met, in the robot's frame.

use crate::config::LidarConfig;
use crate::lidar::beam_angle;
use crate::pose::Pose;
use std::f32::consts::PI;

/// Points are handled in groups of this many, so that loops over them vectorise.
pub(super) const GROUP: usize = 16;
/// A place (m) behind the robot that no arc of half a turn meets: fills up the last group.
const NOWHERE: f32 = -1e4;
/// Smallest gap (m^2) between contact and a point: one that is nearer counts as just touching.
const TOUCHING: f32 = 1e-6;

/// The beams of a lidar as rays in the robot's frame.
#[derive(Debug, Clone)]
pub(super) struct Eye {
    direction: Vec<[f32; 2]>,
    origin: [f32; 2],
    range_max: f32,
    /// What the beams cover, as angles (rad) about the robot's x axis: half the field of view on both sides of
    /// `middle`.
    pub half_fov: f32,
    /// Direction (rad) of the middle of the field of view in the robot's frame.
    pub middle: f32,
    /// Angle (rad) between neighbouring beams.
    pub increment: f32,
}

impl Eye {
    /// The lidar of a checked configuration.
    pub fn new(lidar: &LidarConfig) -> Self {
        let [x, y, yaw] = lidar.mount;
        let mount = Pose { x, y, yaw };
        let direction = |i| {
            let (sin, cos) = libm::sincos(mount.yaw + beam_angle(lidar, i));
            [cos as f32, sin as f32]
        };
        Self {
            direction: (0..lidar.beams).map(direction).collect(),
            origin: [x as f32, y as f32],
            range_max: lidar.range_max as f32,
            half_fov: 0.5 * lidar.fov as f32,
            middle: yaw as f32,
            increment: (lidar.fov / lidar.beams as f64) as f32,
        }
    }

    /// Number of beams.
    pub fn beams(&self) -> usize {
        self.direction.len()
    }

    /// Replaces the points of `scene` by those of a scan. A beam at range_max or beyond met nothing; NaN and negative
    /// ranges are lost beams; minus infinity is too near to measure, which counts as 0.
    pub fn look(&self, ranges: &[f32], scene: &mut Scene) {
        scene.x.clear();
        scene.y.clear();
        for (&[cos, sin], &range) in self.direction.iter().zip(ranges) {
            let range = if range == f32::NEG_INFINITY { 0.0 } else { range };
            if range >= 0.0 && range < self.range_max {
                scene.x.push(self.origin[0] + range * cos);
                scene.y.push(self.origin[1] + range * sin);
            }
        }
    }
}

/// Points (m) in the robot's frame: x forward, y left.
#[derive(Debug, Clone, Default)]
pub(super) struct Scene {
    /// Forward coordinates.
    pub x: Vec<f32>,
    /// Left coordinates.
    pub y: Vec<f32>,
}

impl Scene {
    /// The points one by one.
    pub fn points(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        self.x.iter().zip(&self.y).map(|(&x, &y)| [x, y])
    }

    /// Sees the points from `pose` in the frame that they were in.
    pub fn move_to(&mut self, pose: &Pose) {
        let (sin, cos) = libm::sincos(pose.yaw);
        let (sin, cos, to_x, to_y) = (sin as f32, cos as f32, pose.x as f32, pose.y as f32);
        for (x, y) in self.x.iter_mut().zip(&mut self.y) {
            let (dx, dy) = (*x - to_x, *y - to_y);
            (*x, *y) = (cos * dx + sin * dy, cos * dy - sin * dx);
        }
    }
}

/// The points that a disc about the robot's centre may meet, prepared for `free_way`.
#[derive(Debug, Clone, Default)]
pub(super) struct Arcs {
    groups: Vec<Group>,
}

/// Of each point: coordinates, q = square of the distance less square of the radius, and 1 / q.
#[derive(Debug, Clone)]
struct Group {
    x: [f32; GROUP],
    y: [f32; GROUP],
    q: [f32; GROUP],
    inverse: [f32; GROUP],
}

impl Arcs {
    /// Takes over the points that a disc of `radius` can meet within `reach` metres of driving.
    pub fn prepare(&mut self, scene: &Scene, radius: f32, reach: f32) {
        self.groups.clear();
        let far = (radius + reach) * (radius + reach);
        let mut place = GROUP;
        for [x, y] in scene.points() {
            let square = x * x + y * y;
            if square > far {
                continue;
            }
            if place == GROUP {
                self.groups.push(Group::empty());
                place = 0;
            }
            if let Some(group) = self.groups.last_mut() {
                let q = (square - radius * radius).max(TOUCHING);
                (group.x[place], group.y[place], group.q[place], group.inverse[place]) = (x, y, q, 1.0 / q);
            }
            place += 1;
        }
    }

    /// Way (m) that the disc drives forward on the arc of `curvature` (1/m, left positive) before it touches a point;
    /// infinite if it touches none in half a turn.
    ///
    /// With u = (2 / curvature) tan(turn / 2), which is the way where the arc is straight, contact with (x, y) is a u^2
    /// - 2 x u + q = 0, a = 1 - curvature y + curvature^2 q / 4. The first root ahead is q / (x + sqrt(x^2 - a q)).
    pub fn free_way(&self, curvature: f32) -> f32 {
        let quarter = 0.25 * curvature * curvature;
        let u = self.first_root(|x, y, q| (x, 1.0 - curvature * y + quarter * q));
        let half = 0.5 * curvature.abs();
        if half < 1e-4 || u == f32::INFINITY { u } else { libm::atanf(half * u) / half }
    }

    /// Way (m) that the disc drives straight on, once it has turned in place by `angle` (rad).
    pub fn free_way_after_turn(&self, angle: f32) -> f32 {
        let (sin, cos) = libm::sincosf(angle);
        self.first_root(|x, y, _| (cos * x + sin * y, 1.0))
    }

    /// Smallest positive root u of a u^2 - 2 b u + q = 0 over all points, whose (x, y, q) `factors` turns into (b, a).
    #[inline(always)]
    fn first_root(&self, factors: impl Fn(f32, f32, f32) -> (f32, f32)) -> f32 {
        // The largest 1 / u of each lane; a square root of a negative number is NaN, which is never larger.
        let mut nearest = [0.0; GROUP];
        for Group { x, y, q, inverse } in &self.groups {
            for lane in 0..GROUP {
                let (b, a) = factors(x[lane], y[lane], q[lane]);
                let inverse_u = (b + (b * b - a * q[lane]).sqrt()) * inverse[lane];
                nearest[lane] = if inverse_u > nearest[lane] { inverse_u } else { nearest[lane] };
            }
        }
        1.0 / nearest.iter().fold(0.0, |most: f32, &one| most.max(one))
    }
}

impl Group {
    fn empty() -> Self {
        let q = NOWHERE * NOWHERE;
        Self { x: [NOWHERE; GROUP], y: [0.0; GROUP], q: [q; GROUP], inverse: [1.0 / q; GROUP] }
    }
}

/// `angle` (rad) brought to [-pi, pi].
pub(super) fn wrap(angle: f32) -> f32 {
    if (-PI..=PI).contains(&angle) { angle } else { angle - 2.0 * PI * libm::roundf(angle / (2.0 * PI)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arcs(points: &[[f32; 2]], radius: f32) -> Arcs {
        let scene = Scene { x: points.iter().map(|p| p[0]).collect(), y: points.iter().map(|p| p[1]).collect() };
        let mut arcs = Arcs::default();
        arcs.prepare(&scene, radius, 10.0);
        arcs
    }

    /// First contact by small steps, within the step.
    fn by_steps(points: &[[f32; 2]], radius: f64, curvature: f64) -> f64 {
        let step = 1e-3;
        for i in 0..20_000 {
            let way = f64::from(i) * step;
            if way * curvature.abs() > std::f64::consts::PI {
                break;
            }
            let (sin, cos) = libm::sincos(curvature * way);
            let [x, y] = if curvature == 0.0 { [way, 0.0] } else { [sin / curvature, (1.0 - cos) / curvature] };
            if points.iter().any(|p| libm::hypot(x - f64::from(p[0]), y - f64::from(p[1])) <= radius) {
                return way;
            }
        }
        f64::INFINITY
    }

    /// A point 1 m ahead is met after 0.75 m; one 0.2 m to the side after 1 - 0.15 = 0.85 m; one 0.3 m aside never.
    #[test]
    fn straight_ways_by_hand() {
        for (point, way) in
            [([1.0, 0.0], 0.75), ([1.0, 0.2], 0.85), ([1.0, 0.3], f32::INFINITY), ([-1.0, 0.0], f32::INFINITY)]
        {
            let free = arcs(&[point], 0.25).free_way(0.0);
            assert!(free == way || (free - way).abs() < 1e-6, "{point:?}: {free}");
        }
    }

    /// On the circle of radius 1 to the left, the point (1, 1) lies a quarter turn ahead; contact when the chord to it
    /// is the radius 0.25: 2 asin(0.125) = 0.2507 before pi / 2.
    #[test]
    fn a_quarter_turn_by_hand() {
        let free = arcs(&[[1.0, 1.0]], 0.25).free_way(1.0);
        assert!((free - (std::f32::consts::FRAC_PI_2 - 2.0 * 0.125f32.asin())).abs() < 1e-6, "{free}");
        assert_eq!(arcs(&[[1.0, 1.0]], 0.25).free_way(-1.0), f32::INFINITY);
    }

    #[test]
    fn ways_are_those_of_small_steps() {
        use crate::rng::{Purpose, Split, Stream, StreamName};
        let mut random = Stream::new(StreamName::new(1, Purpose::World, Split::Test, 0, 0));
        let mut met = 0;
        for _ in 0..600 {
            let count = 1 + (random.unit() * 30.0) as usize;
            let mut points = Vec::new();
            while points.len() < count {
                let point = [random.uniform(-2.0, 3.0) as f32, random.uniform(-3.0, 3.0) as f32];
                if libm::hypotf(point[0], point[1]) > 0.3 {
                    points.push(point);
                }
            }
            let curvature = random.uniform(-6.0, 6.0) as f32;
            let (free, expected) =
                (arcs(&points, 0.25).free_way(curvature), by_steps(&points, 0.25, f64::from(curvature)));
            if expected.is_finite() {
                met += 1;
                assert!((f64::from(free) - expected).abs() < 3e-3, "{curvature}: {free} {expected}");
            } else if free.is_finite() {
                // A grazing contact between two steps, or beyond half a turn by a step.
                let (sin, cos) = libm::sincosf(curvature * free);
                let [x, y] = [sin / curvature, (1.0 - cos) / curvature];
                assert!(points.iter().any(|p| (libm::hypotf(x - p[0], y - p[1]) - 0.25).abs() < 1e-4));
            }
        }
        assert!(met > 100, "{met}");
    }

    #[test]
    fn lost_beams_and_beams_without_hit_leave_no_point() {
        let config = crate::SimConfig::from_json(include_str!("../../tests/defaults.json")).unwrap();
        let eye = Eye::new(&LidarConfig { beams: 6, fov: std::f64::consts::PI, ..config.lidar });
        let mut scene = Scene::default();
        eye.look(&[f32::NAN, 10.0, f32::INFINITY, -1.0, f32::NEG_INFINITY, 2.0], &mut scene);
        assert_eq!(scene.x.len(), 2);
        assert_eq!((scene.x[0], scene.y[0]), (0.0, 0.0));
        assert!((libm::hypotf(scene.x[1], scene.y[1]) - 2.0).abs() < 1e-6);
        assert!((libm::atan2f(scene.y[1], scene.x[1]) - 75f32.to_radians()).abs() < 1e-6);
    }
}
