//! Lengths known by hand, turned, moved and scaled at random.

use super::super::lower_bound::LowerBound;
use super::super::{needs_detour, shortest_path};
use crate::grown::tests::{room, stream};
use crate::grown::{GoalDisc, GrownShape, GrownWorld, Point};
use crate::pose::Pose;
use crate::rng::Stream;
use crate::world::Shape;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A world, its start and goal, and the length of the shortest path to the goal's centre.
struct Case {
    shapes: Vec<Shape>,
    radius: f64,
    start: Point,
    goal: Point,
    length: f64,
}

/// Draws a case.
type Kind = fn(&mut Stream) -> Case;

impl Case {
    /// The same case, `scale` times as large, turned and moved.
    fn placed(&self, pose: &Pose, scale: f64) -> Case {
        let at = |p: Point| pose.transform([scale * p[0], scale * p[1]]);
        let shapes = self.shapes.iter().map(|shape| match shape {
            Shape::Circle { center, radius } => Shape::Circle { center: at(*center), radius: scale * radius },
            Shape::Box { center, yaw, length, width } => {
                let (length, width) = (scale * length, scale * width);
                Shape::Box { center: at(*center), yaw: yaw + pose.yaw, length, width }
            }
            Shape::Segment { a, b } => Shape::Segment { a: at(*a), b: at(*b) },
            Shape::Polygon { points } => Shape::Polygon { points: points.iter().map(|p| at(*p)).collect() },
        });
        Case {
            shapes: shapes.collect(),
            radius: scale * self.radius,
            start: at(self.start),
            goal: at(self.goal),
            length: scale * self.length,
        }
    }

    /// Relative error of `shortest_path`.
    fn error(&self, goal_radius: f64) -> f64 {
        let exact = self.length - goal_radius;
        let found = shortest_path(&self.shapes, self.radius, self.start, self.goal, goal_radius).unwrap();
        (found - exact) / exact
    }
}

/// Length around a disc of radius `reach`, from distance `a` to distance `b` from its centre, `angle` (rad) apart.
fn around_disc(reach: f64, a: f64, b: f64, angle: f64) -> f64 {
    let tangents = (a * a - reach * reach).sqrt() + (b * b - reach * reach).sqrt();
    tangents + reach * (angle - (reach / a).acos() - (reach / b).acos())
}

fn polar(length: f64, angle: f64) -> Point {
    [length * angle.cos(), length * angle.sin()]
}

/// Around a disc of radius 0.75 m.
fn disc(random: &mut Stream) -> Case {
    let (radius, a, b) = (random.uniform(0.05, 0.3), random.uniform(1.2, 4.0), random.uniform(1.2, 4.0));
    let angle = random.uniform(2.8, PI);
    let shapes = vec![Shape::Circle { center: [0.0, 0.0], radius: 0.75 }];
    Case { shapes, radius, start: [a, 0.0], goal: polar(b, angle), length: around_disc(0.75 + radius, a, b, angle) }
}

/// Around the corner at the origin of a large box that fills the quadrant x < 0, y < 0.
fn corner(random: &mut Stream) -> Case {
    let (radius, a, b) = (random.uniform(0.05, 0.3), random.uniform(0.8, 3.0), random.uniform(0.8, 3.0));
    let (from, to) = (-FRAC_PI_2 + random.uniform(0.4, 0.6), PI - random.uniform(0.4, 0.6));
    let shapes = vec![Shape::Box { center: [-5.0, -5.0], yaw: 0.0, length: 10.0, width: 10.0 }];
    let length = around_disc(radius, a, b, to - from);
    Case { shapes, radius, start: polar(a, from), goal: polar(b, to), length }
}

/// Around the end of a wall on the negative x axis.
fn wall_end(random: &mut Stream) -> Case {
    let (radius, a, b) = (random.uniform(0.05, 0.3), random.uniform(1.0, 3.0), random.uniform(1.0, 3.0));
    let (from, to) = (-PI + random.uniform(0.4, 1.0), PI - random.uniform(0.4, 1.0));
    let shapes = vec![Shape::Segment { a: [0.0, 0.0], b: [-10.0, 0.0] }];
    Case { shapes, radius, start: polar(a, from), goal: polar(b, to), length: around_disc(radius, a, b, to - from) }
}

/// Along one side of a box and around both of its corners; the box reaches further to the other side.
fn two_corners(random: &mut Stream) -> Case {
    let (radius, side) = (random.uniform(0.05, 0.3), random.uniform(0.5, 3.0));
    let (before, height) = (random.uniform(0.4, 1.5), random.uniform(0.2, 0.8));
    let shapes = vec![Shape::Box { center: [0.0, height - 2.0], yaw: 0.0, length: side, width: 4.0 }];
    let apart = before.hypot(height);
    let bend = (-height / apart).acos() - (radius / apart).acos();
    let half = (apart * apart - radius * radius).sqrt() + radius * bend;
    let x = 0.5 * side + before;
    Case { shapes, radius, start: [-x, 0.0], goal: [x, 0.0], length: side + 2.0 * half }
}

/// Between two long walls, below the end of one and above the end of the other.
fn slalom(random: &mut Stream) -> Case {
    let (radius, x, y) = (random.uniform(0.05, 0.3), random.uniform(0.5, 2.0), random.uniform(0.2, 1.0));
    let shapes = vec![Shape::Segment { a: [-x, -y], b: [-x, 12.0] }, Shape::Segment { a: [x, y], b: [x, -12.0] }];
    let start = -x - random.uniform(0.5, 2.0);
    let (before, between) = ((-x - start).hypot(y), (2.0 * x).hypot(2.0 * y));
    let first = (-y).atan2(-x - start) - (radius / before).asin();
    let second = y.atan2(x) + (2.0 * radius / between).asin();
    let legs = 2.0 * (before * before - radius * radius).sqrt() + (between * between - 4.0 * radius * radius).sqrt();
    Case { shapes, radius, start: [start, 0.0], goal: [-start, 0.0], length: legs + 2.0 * radius * (second - first) }
}

#[test]
fn detours_known_by_hand() {
    let kinds: [(&str, Kind); 5] =
        [("disc", disc), ("corner", corner), ("wall end", wall_end), ("two corners", two_corners), ("slalom", slalom)];
    for (name, kind) in kinds {
        let mut worst: f64 = 0.0;
        for seed in 0..100 {
            let mut random = stream(seed);
            let case = kind(&mut random);
            let pose = Pose::new(random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0), random.uniform(-PI, PI));
            // From 1 m to 25 m.
            let scale = random.uniform(1.0, 25.0) / case.length;
            let goal_radius = f64::min([1e-6, 0.01, 0.3][seed as usize % 3], 0.1 * scale);
            worst = worst.max(case.placed(&pose, scale).error(goal_radius).abs());
        }
        println!("{name}: largest relative error {worst:.1e}");
        assert!(worst < 1e-9, "{name}: {worst}");
    }
}

#[test]
fn around_a_disc_of_1_m() {
    // Reach 1 m, 2 m before and behind: twice the tangent of sqrt(3) m and a sixth of a turn.
    let shapes = [Shape::Circle { center: [0.0, 0.0], radius: 0.75 }];
    let length = shortest_path(&shapes, 0.25, [-2.0, 0.0], [2.0, 0.0], 0.3).unwrap();
    assert!((length - (2.0 * 3.0f64.sqrt() + PI / 3.0 - 0.3)).abs() < 1e-12, "{length}");
}

#[test]
fn free_lines_are_straight() {
    let mut random = stream(0);
    for shapes in [Vec::new(), room(20.0)] {
        for _ in 0..200 {
            let (length, angle) = (random.uniform(0.31, 15.0), random.uniform(-PI, PI));
            let [x, y] = polar(length, angle);
            let found = shortest_path(&shapes, 0.25, [0.1, -0.2], [x + 0.1, y - 0.2], 0.3).unwrap();
            assert!((found - (length - 0.3)).abs() < 1e-12, "{length} {found}");
            assert!(!needs_detour(&shapes, 0.25, [0.1, -0.2], [x + 0.1, y - 0.2]));
        }
    }
    assert_eq!(shortest_path(&[], 0.25, [0.0, 0.0], [0.1, 0.2], 0.3), Some(0.0));
}

#[test]
fn a_goal_disc_is_entered_where_it_is_free() {
    // The wall keeps the robot 0.25 m away, the goal lies 0.06 m from it: the disc is open from 0.25 m on.
    let shapes = [Shape::Segment { a: [0.0, -40.0], b: [0.0, 40.0] }];
    let length = shortest_path(&shapes, 0.25, [3.0, 0.0], [0.06, 0.0], 0.3).unwrap();
    assert!((length - 2.64).abs() < 1e-12);
    // From aside the nearest open point is where the disc's border leaves the wall's reach.
    let length = shortest_path(&shapes, 0.25, [0.25, 3.0], [0.06, 0.0], 0.3).unwrap();
    assert!((length - (3.0 - (0.09f64 - 0.19 * 0.19).sqrt())).abs() < 1e-9, "{length}");
    // On the other side of the wall the disc reaches 0.24 m far: the way is around the wall's end.
    assert!(shortest_path(&shapes, 0.25, [-3.0, 0.0], [0.06, 0.0], 0.3).unwrap() > 80.0);
    // A disc wholly within reach of the wall cannot be entered.
    assert_eq!(shortest_path(&shapes, 0.25, [3.0, 0.0], [0.06, 0.0], 0.15), None);
}

#[test]
fn a_start_in_contact_has_no_path() {
    let shapes = [Shape::Circle { center: [0.0, 0.0], radius: 0.5 }, Shape::Segment { a: [3.0, -1.0], b: [3.0, 1.0] }];
    for start in [[0.1, 0.0], [0.6, 0.0], [0.0, 0.7498], [2.8, 0.0]] {
        assert_eq!(shortest_path(&shapes, 0.25, start, [5.0, 0.0], 0.3), None, "{start:?}");
    }
    // Contact by rounding is none.
    assert!(shortest_path(&shapes, 0.25, [0.74995, 0.0], [5.0, 0.0], 0.3).is_some());
    assert_eq!(shortest_path(&shapes, 0.25, [f64::NAN, 0.0], [5.0, 0.0], 0.3), None);
    assert_eq!(shortest_path(&shapes, 0.0, [1.0, 0.0], [5.0, 0.0], 0.3), None);
}

#[test]
fn gaps_count_to_the_micrometre() {
    for (gap, open) in [(0.5 - 1e-6, false), (0.5 + 1e-6, true), (0.0, false), (1.0, true)] {
        let mut shapes = room(3.0);
        shapes.push(Shape::Segment { a: [0.0, -3.0], b: [0.0, -0.5 * gap] });
        shapes.push(Shape::Box { center: [0.0, 0.5 * gap + 1.5], yaw: 0.0, length: 0.2, width: 3.0 });
        let length = shortest_path(&shapes, 0.25, [-2.0, 0.3], [2.0, 0.3], 0.3);
        assert_eq!(length.is_some(), open, "gap {gap}: {length:?}");
    }
}

#[test]
fn closed_rings_enclose() {
    let ring = |count: usize, radius: f64| -> Vec<Shape> {
        (0..count).map(|i| Shape::Circle { center: polar(2.0, TAU * i as f64 / count as f64 + 0.3), radius }).collect()
    };
    // Twelve discs on a circle of 2 m are 1.035 m apart.
    for (radius, closed) in [(0.26, false), (0.27, true)] {
        let shapes = ring(12, radius);
        for (start, goal) in [([0.1, 0.2], [4.0, 1.0]), ([4.0, 1.0], [0.1, 0.2])] {
            assert_eq!(shortest_path(&shapes, 0.25, start, goal, 0.3).is_none(), closed, "radius {radius}");
        }
        // Both inside, around nothing: the ring does not matter.
        assert!(shortest_path(&shapes, 0.25, [-0.9, 0.0], [0.9, 0.0], 0.1).is_some());
    }
    let walled = [room(2.0), vec![Shape::Circle { center: [0.0, 0.0], radius: 0.4 }]].concat();
    assert_eq!(shortest_path(&walled, 0.2, [-1.5, 0.0], [4.0, 0.0], 0.3), None);
    assert!(shortest_path(&walled, 0.2, [-1.5, 0.0], [1.5, 0.0], 0.3).is_some());
}

#[test]
fn detours_are_told_from_straight_lines() {
    let shapes = [Shape::Box { center: [0.0, 0.0], yaw: 0.3, length: 1.0, width: 0.5 }];
    assert!(needs_detour(&shapes, 0.25, [-2.0, 0.0], [2.0, 0.0]));
    assert!(needs_detour(&shapes, 0.25, [-2.0, 0.0], [-0.6, 0.0]));
    assert!(!needs_detour(&shapes, 0.25, [-2.0, 1.0], [2.0, 1.0]));
    assert!(!needs_detour(&[], 0.25, [-2.0, 0.0], [2.0, 0.0]));
}

#[test]
fn the_lower_bound_sees_corridors_without_play_and_is_not_long_in_them() {
    let mut worst: f64 = 0.0;
    for seed in 0..100 {
        let mut random = stream(seed);
        let pose = Pose::new(random.unit(), random.unit(), random.uniform(-PI, PI));
        let (length, radius, play) = (random.uniform(1.0, 20.0), 0.25, [1e-6, 0.02, 0.1][seed as usize % 3]);
        let wall = |y: f64| Shape::Segment { a: pose.transform([0.0, y]), b: pose.transform([length, y]) };
        let obstacles = [-1.0, 1.0].map(|side| GrownShape::new(&wall(side * (radius + 0.5 * play)), radius)).to_vec();
        let (start, goal) = (pose.transform([-0.5, 0.0]), pose.transform([length + 0.5, 0.0]));
        let bounds = [-25.0, -25.0, 25.0, 25.0];
        let world = GrownWorld::new(obstacles, bounds);
        let disc = GoalDisc::new(&world, &world.joints(), start, goal, 0.3).unwrap();
        let lower = LowerBound::new(&world, &world.joints(), &disc, bounds, radius, 1.0);
        worst = worst.max(lower.remaining(start) / (length + 0.7) - 1.0);
    }
    println!("largest relative excess {worst:.1e}");
    assert!(worst < 5e-3, "{worst}");
}
