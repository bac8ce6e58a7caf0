//! The promise of the swept test: at any speed and for walls of any thickness a contact is reported if the clearance
//! along the exact arc falls under the footprint by more than 1e-4 m, and none if it stays above by more than 1e-4 m.
//!
//! The judge works in double precision on its own geometry: an exact distance, and a search along the arc that leaves
//! out only intervals whose clearance is proven. NAVRL_FULL=1 makes a million moves.
#![allow(clippy::unwrap_used)]

use navsim::collision::{Clearance, Sweep, clearance, measure, sweep};
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::robot::{Arc, Footprint};
use navsim::world::{Obstacles, Shape};
use parry2d_f64::math::{Pose as Isometry, Vector};
use parry2d_f64::query::{NonlinearRigidMotion, cast_shapes_nonlinear};
use parry2d_f64::shape::{Ball, Cuboid};

type Point = [f64; 2];

/// What is promised, m.
const TOLERANCE: f64 = 1e-4;
const PERIOD: f64 = 0.1;
/// Thickness of the walls, m.
const THIN: f64 = 1e-3;

/// A wall of 1 mm, or one without thickness, and what drives at it.
#[derive(Debug)]
struct Move {
    footprint: Footprint,
    arc: Arc,
    /// Centre, yaw, length.
    wall: (Point, f64, f64),
    /// Of the wall, m.
    thickness: f64,
}

fn moves() -> u64 {
    if std::env::var("NAVRL_FULL").is_ok_and(|v| v == "1") { 1_000_000 } else { 20_000 }
}

/// A move of up to 100 m/s and 100 rad/s, with a wall somewhere near the arc but clear of its beginning.
fn draw(random: &mut Stream, footprint: Footprint) -> Move {
    loop {
        let drawn = draw_any(random, footprint);
        if drawn.distance(0.0, 0.0) > 0.0 {
            return drawn;
        }
    }
}

fn draw_any(random: &mut Stream, footprint: Footprint) -> Move {
    // Slow and fast ones alike; one in four drives straight, one in eight turns on the spot.
    let speed = |random: &mut Stream| libm::pow(10.0, random.uniform(-2.0, 2.0));
    let kind = random.unit();
    let v = if kind < 0.125 { 0.0 } else { speed(random) };
    let sign = if random.unit() < 0.5 { -1.0 } else { 1.0 };
    let omega = if kind > 0.75 { 0.0 } else { sign * speed(random) };
    let pi = std::f64::consts::PI;
    let start = Pose::new(random.uniform(-15.0, 15.0), random.uniform(-15.0, 15.0), random.uniform(-pi, pi));
    let arc = Arc { start, v, omega };
    // About the end of the footprint at some time, so that near misses and grazes are frequent.
    let at = arc.at(PERIOD * random.unit());
    let (reach, bearing) = (random.uniform(0.0, 2.0) * footprint.circumscribed_radius(), random.uniform(-pi, pi));
    let center = at.transform([reach * libm::cos(bearing), reach * libm::sin(bearing)]);
    let wall = (center, random.uniform(-pi, pi), libm::pow(10.0, random.uniform(-2.0, 0.7)));
    Move { footprint, arc, wall, thickness: if random.unit() < 0.5 { THIN } else { 0.0 } }
}

fn disc(random: &mut Stream) -> Footprint {
    Footprint::Disc { radius: random.uniform(0.05, 0.6) }
}

fn rectangle(random: &mut Stream) -> Footprint {
    // From a millimetre on.
    let mut side = |most: f64| most * libm::pow(10.0, random.uniform(-3.0, 0.0));
    Footprint::Rectangle { length: side(1.2).max(1e-3), width: side(0.8).max(1e-3) }
}

/// Corners of a box, counter-clockwise.
fn box_corners([x, y]: Point, yaw: f64, length: f64, width: f64) -> [Point; 4] {
    let (sin, cos) = libm::sincos(yaw);
    let corner = |i: f64, j: f64| [x + i * length * cos - j * width * sin, y + i * length * sin + j * width * cos];
    [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)]
}

fn to_edge(p: Point, a: Point, b: Point) -> f64 {
    let (ux, uy) = (b[0] - a[0], b[1] - a[1]);
    let t = (((p[0] - a[0]) * ux + (p[1] - a[1]) * uy) / (ux * ux + uy * uy)).clamp(0.0, 1.0);
    (p[0] - a[0] - t * ux).hypot(p[1] - a[1] - t * uy)
}

fn cross(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn edges(corners: &[Point; 4]) -> [(Point, Point); 4] {
    std::array::from_fn(|i| (corners[i], corners[(i + 1) % 4]))
}

fn contains(corners: &[Point; 4], p: Point) -> bool {
    edges(corners).iter().all(|(a, b)| cross(*a, *b, p) >= 0.0)
}

/// Distance of a point from a box, 0 inside.
fn point_distance(corners: &[Point; 4], p: Point) -> f64 {
    if contains(corners, p) {
        return 0.0;
    }
    edges(corners).iter().fold(f64::INFINITY, |nearest, (a, b)| nearest.min(to_edge(p, *a, *b)))
}

/// Distance between two boxes, 0 when they overlap.
fn box_distance(one: &[Point; 4], other: &[Point; 4]) -> f64 {
    let crossing = edges(one).iter().any(|(a, b)| {
        edges(other)
            .iter()
            .any(|(c, d)| cross(*a, *b, *c) * cross(*a, *b, *d) < 0.0 && cross(*c, *d, *a) * cross(*c, *d, *b) < 0.0)
    });
    if crossing {
        return 0.0;
    }
    let from = |points: &[Point; 4], corners| {
        points.iter().fold(f64::INFINITY, |nearest, p| f64::min(nearest, point_distance(corners, *p)))
    };
    from(one, other).min(from(other, one))
}

impl Move {
    fn corners(&self) -> [Point; 4] {
        let (center, yaw, length) = self.wall;
        box_corners(center, yaw, length, self.thickness)
    }

    /// Distance at `time` between the wall and the footprint shrunk by `shrunk` m on every side.
    fn distance(&self, time: f64, shrunk: f64) -> f64 {
        let pose = self.arc.at(time);
        match self.footprint {
            Footprint::Disc { radius } => {
                (point_distance(&self.corners(), [pose.x, pose.y]) - (radius - shrunk)).max(0.0)
            }
            Footprint::Rectangle { length, width } => {
                let own = box_corners([pose.x, pose.y], pose.yaw, length - 2.0 * shrunk, width - 2.0 * shrunk);
                box_distance(&own, &self.corners())
            }
        }
    }

    /// Whether the shrunk footprint comes as near as `limit` m (within 1e-7) in [from, to].
    fn comes_near(&self, from: f64, to: f64, shrunk: f64, limit: f64) -> bool {
        let speed = self.arc.v.abs() + self.footprint.circumscribed_radius() * self.arc.omega.abs();
        let mut open = vec![(from, to)];
        while let Some((from, to)) = open.pop() {
            let middle = 0.5 * (from + to);
            let gap = self.distance(middle, shrunk) - limit;
            if gap <= 0.0 {
                return true;
            }
            // No point moves farther than this from where it is in the middle.
            let travel = speed * 0.5 * (to - from);
            if gap <= travel && travel > 1e-7 {
                open.push((from, middle));
                open.push((middle, to));
            }
        }
        false
    }

    fn drive(&self) -> Sweep {
        let (center, yaw, length) = self.wall;
        let [a, b, c, d] = self.corners();
        let wall = if self.thickness > 0.0 {
            Shape::Box { center, yaw, length, width: self.thickness }
        } else {
            let middle = |p: Point, q: Point| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
            Shape::Segment { a: middle(a, d), b: middle(b, c) }
        };
        let wall = Obstacles::new(&[wall]);
        let obstacles = [&wall, &Obstacles::default()];
        let start = Clearance::exactly(clearance(&self.footprint, &self.arc.start, obstacles));
        sweep(&self.footprint, &self.arc, PERIOD, obstacles, start, f32::INFINITY)
    }
}

/// Checks random moves of a kind of footprint.
fn check(stream: u32, footprint: fn(&mut Stream) -> Footprint) {
    let mut random = Stream::new(StreamName::new(11, Purpose::World, Split::Given, stream, 0));
    let (mut contacts, mut misses) = (0, 0);
    for i in 0..moves() / 2 {
        let shape = footprint(&mut random);
        let drawn = draw(&mut random, shape);
        let end = drawn.drive();
        if end.contact {
            contacts += 1;
            assert!(drawn.comes_near(0.0, PERIOD, 0.0, TOLERANCE), "{i}: no contact in {drawn:?}: {end:?}");
            // It stops where it touches, not behind the wall.
            assert!(!drawn.comes_near(0.0, end.time, TOLERANCE, 0.0), "{i}: too late in {drawn:?}: {end:?}");
            assert!(drawn.distance(end.time, 0.0) <= TOLERANCE, "{i}: too early in {drawn:?}: {end:?}");
        } else {
            misses += 1;
            assert_eq!(end.time, PERIOD);
            assert!(!drawn.comes_near(0.0, PERIOD, TOLERANCE, 0.0), "{i}: tunnelled in {drawn:?}: {end:?}");
        }
    }
    assert!(contacts > moves() / 8 && misses > moves() / 8, "{contacts} contacts, {misses} misses");
}

#[test]
fn a_disc_tunnels_through_nothing() {
    check(0, disc);
}

#[test]
fn a_rectangle_tunnels_through_nothing() {
    check(1, rectangle);
}

/// The motion of an arc for parry: a turn about the centre of the circle, or straight on.
fn rigid_motion(arc: &Arc) -> NonlinearRigidMotion {
    let start = Isometry::new(Vector::new(arc.start.x, arc.start.y), arc.start.yaw);
    if arc.omega == 0.0 {
        let (sin, cos) = libm::sincos(arc.start.yaw);
        return NonlinearRigidMotion::new(start, Vector::ZERO, Vector::new(arc.v * cos, arc.v * sin), 0.0);
    }
    NonlinearRigidMotion::new(start, Vector::new(0.0, arc.v / arc.omega), Vector::ZERO, arc.omega)
}

/// Parry's nonlinear cast sees about one contact in a hundred of these too late or not at all, so it judges one way
/// only: what it meets the sweep has met before anything was deeper than promised, and mostly they agree.
#[test]
fn the_sweep_meets_what_parrys_nonlinear_cast_meets() {
    let mut random = Stream::new(StreamName::new(12, Purpose::World, Split::Given, 0, 0));
    let mut agreed = 0;
    for _ in 0..1000 {
        let shape = if random.unit() < 0.5 { disc(&mut random) } else { rectangle(&mut random) };
        let drawn = draw(&mut random, shape);
        let end = drawn.drive();
        let (center, yaw, length) = drawn.wall;
        let wall = Cuboid::new(Vector::new(0.5 * length, 0.5 * drawn.thickness));
        let still = NonlinearRigidMotion::constant_position(Isometry::new(Vector::new(center[0], center[1]), yaw));
        let motion = rigid_motion(&drawn.arc);
        let hit = match drawn.footprint {
            Footprint::Disc { radius } => {
                cast_shapes_nonlinear(&motion, &Ball::new(radius), &still, &wall, 0.0, PERIOD, false)
            }
            Footprint::Rectangle { length, width } => {
                let own = Cuboid::new(Vector::new(0.5 * length, 0.5 * width));
                cast_shapes_nonlinear(&motion, &own, &still, &wall, 0.0, PERIOD, false)
            }
        };
        let hit = hit.unwrap().map_or(f64::INFINITY, |hit| hit.time_of_impact);
        let time = if end.contact { end.time } else { f64::INFINITY };
        let in_time = time <= hit || !drawn.comes_near(0.0, time.min(PERIOD), TOLERANCE, 0.0);
        assert!(in_time, "{drawn:?}: {end:?}, parry at {hit} s");
        agreed += u32::from(time == hit || (time - hit).abs() < 0.01 * PERIOD);
    }
    assert!(agreed >= 950, "{agreed} of 1000");
}

/// A long way in which most clearances are not measured, beside one where all of them are.
#[test]
fn what_is_not_measured_is_certain() {
    let mut random = Stream::new(StreamName::new(12, Purpose::World, Split::Given, 0, 0));
    let mut measured = 0;
    for way in 0..20 {
        // Boxes along a corridor of 1 km, one of them as far away as clearances are followed.
        let place = |random: &mut Stream| [random.uniform(-500.0, 500.0), random.uniform(-60.0, 60.0)];
        let shapes: Vec<Shape> = (0..if way % 2 == 0 { 1 } else { 40 })
            .map(|_| Shape::Box { center: place(&mut random), yaw: random.uniform(-3.0, 3.0), length: 2.0, width: 1.0 })
            .collect();
        let obstacles = [&Obstacles::new(&shapes), &Obstacles::default()];
        let footprint = Footprint::Disc { radius: 0.25 };
        let mut pose = Pose::new(-500.0, 0.0, 0.0);
        let mut known = Clearance::exactly(clearance(&footprint, &pose, obstacles));
        let mut smallest = known.measured;
        while smallest > 0.0 && pose.x < 500.0 {
            let arc =
                Arc { start: pose, v: random.uniform(0.0, 2.0), omega: random.uniform(-0.2, 0.2) - 0.5 * pose.yaw };
            let now = Clearance::exactly(measure(&footprint, &pose, obstacles, &known));
            let always = sweep(&footprint, &arc, PERIOD, obstacles, now, f32::INFINITY);
            let seldom = sweep(&footprint, &arc, PERIOD, obstacles, known, smallest);
            assert_eq!((seldom.pose, seldom.time, seldom.contact), (always.pose, always.time, always.contact));
            let exact = always.clearance.measured;
            assert!(seldom.clearance.at_least() <= exact + 1e-3 && exact <= seldom.clearance.at_most() + 1e-3);
            measured += usize::from(seldom.clearance.driven == 0.0);
            let before = smallest.min(seldom.clearance.measured);
            smallest = smallest.min(exact);
            assert_eq!(before, smallest);
            (pose, known) = (seldom.pose, seldom.clearance);
            if seldom.contact {
                break;
            }
        }
    }
    assert!(measured > 0);
}

/// Nothing is in contact that is only not known to be free.
#[test]
fn a_bound_of_zero_is_measured() {
    let wall = Obstacles::new(&[Shape::Segment { a: [2.0, -1.0], b: [2.0, 1.0] }]);
    let known = Clearance { measured: 1.0, driven: 1.0 };
    for v in [0.0, 1e-6, 0.5] {
        let arc = Arc { start: Pose::new(1.0, 0.0, 0.0), v, omega: 0.0 };
        let end = sweep(&Footprint::Disc { radius: 0.25 }, &arc, PERIOD, [&wall, &Obstacles::default()], known, 0.1);
        assert!(!end.contact && end.time == PERIOD, "{v}: {end:?}");
    }
}

/// Every kind of shape and footprint, at rest, within single precision of coordinates of up to 100 m.
#[test]
fn clearances_are_exact() {
    let mut random = Stream::new(StreamName::new(13, Purpose::World, Split::Given, 0, 0));
    for i in 0..moves() / 4 {
        let footprint = if i % 4 == 0 { disc(&mut random) } else { rectangle(&mut random) };
        let mut drawn = draw(&mut random, footprint);
        let (east, north) = (random.uniform(-85.0, 85.0), random.uniform(-85.0, 85.0));
        drawn.arc.start = Pose { x: drawn.arc.start.x + east, y: drawn.arc.start.y + north, ..drawn.arc.start };
        drawn.wall.0 = [drawn.wall.0[0] + east, drawn.wall.0[1] + north];
        let still = Move { arc: Arc { v: 0.0, omega: 0.0, ..drawn.arc }, ..drawn };
        let (found, exact) = (f64::from(still.drive().clearance.measured), still.distance(0.0, 0.0));
        assert!((found - exact).abs() < 3e-5, "{still:?}: {found}, not {exact}");
    }
}

/// An answer of parry that was wrong by a quarter of a millimetre.
#[test]
fn a_rectangle_beside_a_wall() {
    let wall = Shape::Segment {
        a: [-4.373_463_476_189_845, -1.759_813_494_920_784_7],
        b: [3.729_603_735_016_315_4, -3.813_177_249_159_391],
    };
    let start = Pose::new(-2.015_859_654_957_94, -0.367_941_743_333_999_4, 1.320_111_613_533_018);
    let footprint = Footprint::Rectangle { length: 0.5, width: 0.4 };
    let found = clearance(&footprint, &start, [&Obstacles::new(&[wall]), &Obstacles::default()]);
    assert!((found - 1.677_851_5).abs() < 1e-6, "{found}");
}
