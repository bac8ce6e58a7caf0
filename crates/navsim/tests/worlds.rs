//! Drawn episodes are fair: checked by geometry of the test's own.
#![allow(clippy::unwrap_used)]

use navsim::config::WorldConfig;
use navsim::error::Error;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::robot::Footprint;
use navsim::world::{Generator, Layout, Shape};
use std::collections::{BinaryHeap, HashSet};

fn world(name: &str, boxes: usize) -> WorldConfig {
    WorldConfig {
        name: name.into(),
        boxes,
        random_yaw: true,
        goal_range_start: 10.0,
        goal_range_growth: 0.004,
        goal_range_max: 10.0,
    }
}

const DISC: Footprint = Footprint::Disc { radius: 0.25 };

fn draw(generator: &Generator, seed: u64, index: u32, episode: u64, layout: &mut Layout) -> Result<(), Error> {
    let name = StreamName::new(seed, Purpose::World, Split::Train, index, episode);
    generator.draw(&mut Stream::new(name), episode, layout)
}

/// Resets per world: 20,000, or 1,000,000 with NAVRL_FULL=1.
fn resets() -> u64 {
    if std::env::var("NAVRL_FULL").is_ok_and(|v| v == "1") { 1_000_000 } else { 20_000 }
}

type Point = [f64; 2];

/// A shape by its corners (a circle: its centre) and a radius around them.
struct Solid {
    edges: Vec<(Point, Point)>,
    radius: f64,
}

/// > 0 if c lies left of the line from a to b.
fn side(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn to_edge(p: Point, a: Point, b: Point) -> f64 {
    let (ux, uy) = (b[0] - a[0], b[1] - a[1]);
    let t = (((p[0] - a[0]) * ux + (p[1] - a[1]) * uy) / (ux * ux + uy * uy).max(1e-300)).clamp(0.0, 1.0);
    (p[0] - a[0] - t * ux).hypot(p[1] - a[1] - t * uy)
}

impl Solid {
    fn new(shape: &Shape) -> Self {
        let (corners, radius) = match shape {
            Shape::Box { center, yaw, length, width } => {
                let (sin, cos) = yaw.sin_cos();
                let corner = |(i, j): &(f64, f64)| {
                    let (x, y) = (i * length, j * width);
                    [center[0] + x * cos - y * sin, center[1] + x * sin + y * cos]
                };
                ([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].iter().map(corner).collect(), 0.0)
            }
            Shape::Segment { a, b } => (vec![*a, *b], 0.0),
            Shape::Polygon { points } => (points.clone(), 0.0),
            Shape::Circle { center, radius } => (vec![*center], *radius),
        };
        let n = corners.len();
        Self { edges: (0..n).map(|i| (corners[i], corners[(i + 1) % n])).collect(), radius }
    }

    /// Distance from a point, 0 inside.
    fn distance(&self, p: Point) -> f64 {
        if self.edges.len() > 2 && self.edges.iter().all(|(a, b)| side(*a, *b, p) >= 0.0) {
            return 0.0;
        }
        let nearest = self.edges.iter().map(|(a, b)| to_edge(p, *a, *b)).fold(f64::INFINITY, f64::min);
        (nearest - self.radius).max(0.0)
    }

    /// Whether two shapes touch: edges cross, or one holds a corner of the other.
    fn touches(&self, other: &Solid) -> bool {
        let cross = |(p, q): (Point, Point), (r, s): (Point, Point)| {
            side(p, q, r) * side(p, q, s) < 0.0 && side(r, s, p) * side(r, s, q) < 0.0
        };
        self.edges.iter().any(|mine| other.edges.iter().any(|theirs| cross(*mine, *theirs)))
            || self.edges.iter().any(|(corner, _)| other.distance(*corner) <= self.radius)
            || other.edges.iter().any(|(corner, _)| self.distance(*corner) <= other.radius)
    }
}

fn clearance(p: Point, solids: &[Solid]) -> f64 {
    solids.iter().map(|solid| solid.distance(p)).fold(f64::INFINITY, f64::min)
}

/// Whether a disc of 0.25 m gets from start to goal, given that one of 0.3 m does: the centres of 5 cm cells that hold
/// a way with 0.3 m of clearance have 0.3 - 0.025 sqrt(2) = 0.2646 m, and between neighbours (0.0707 m) at least
/// sqrt(0.2646^2 - 0.0354^2) = 0.262 m is left. Nearest to the goal first.
fn is_reachable(start: Point, goal: Point, solids: &[Solid]) -> bool {
    const CELL: f64 = 0.05;
    let at = |(i, j): (i64, i64)| [start[0] + CELL * i as f64, start[1] + CELL * j as f64];
    let to_goal = |cell| {
        let here = at(cell);
        (here[0] - goal[0]).hypot(here[1] - goal[1])
    };
    let mut seen = HashSet::from([(0, 0)]);
    let mut queue = BinaryHeap::from([(0, (0, 0))]);
    while let Some((_, cell)) = queue.pop() {
        if to_goal(cell) <= CELL {
            return true;
        }
        for (di, dj) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)] {
            let next = (cell.0 + di, cell.1 + dj);
            if next.0.abs().max(next.1.abs()) < 400 && seen.insert(next) && clearance(at(next), solids) >= 0.2646 {
                queue.push((-(to_goal(next) * 1e6) as i64, next));
            }
        }
    }
    false
}

/// The clearance rules of a world.
struct Rules {
    clearance: f64,
    goal_distance: f64,
    box_distance: f64,
    half_area: f64,
    apart: bool,
}

fn check_resets(config: &WorldConfig, rules: &Rules) {
    let generator = Generator::new(config, &DISC).unwrap();
    let fixed = generator.static_shapes().len();
    let mut solids: Vec<Solid> = generator.static_shapes().iter().map(Solid::new).collect();
    let mut layout = Layout::default();
    for episode in 0..resets() {
        draw(&generator, 1, (episode % 7) as u32, episode, &mut layout).unwrap();
        let (start, goal) = ([layout.start.x, layout.start.y], layout.goal);
        solids.truncate(fixed);
        for shape in &layout.moved {
            shape.validate().unwrap();
            let solid = Solid::new(shape);
            if rules.apart {
                assert!(!solids.iter().any(|other| solid.touches(other)), "{episode}: {shape:?} in {layout:?}");
            }
            if let Shape::Box { center, .. } = shape {
                for point in [start, goal] {
                    assert!((point[0] - center[0]).hypot(point[1] - center[1]) >= rules.box_distance);
                }
            }
            solids.push(solid);
        }
        for point in [start, goal] {
            let room = clearance(point, &solids);
            assert!(room >= rules.clearance - 1e-9, "{episode}: {point:?} has {room}");
            assert!(point.iter().all(|v| v.abs() <= rules.half_area), "{episode}: {point:?}");
        }
        assert!((start[0] - goal[0]).hypot(start[1] - goal[1]) >= rules.goal_distance);
        if episode % 100 == 0 {
            assert!(is_reachable(start, goal, &solids), "{episode}: {layout:?}");
        }
    }
}

#[test]
fn td3_is_fair() {
    let rules = Rules { clearance: 0.5, goal_distance: 1.0, box_distance: 1.5, half_area: 4.5, apart: true };
    check_resets(&world("td3", 8), &rules);
}

#[test]
fn boxes_is_fair() {
    let rules = Rules { clearance: 0.45, goal_distance: 2.0, box_distance: 0.0, half_area: 4.55, apart: true };
    check_resets(&world("boxes", 8), &rules);
}

#[test]
fn open8_is_fair() {
    let rules = Rules { clearance: 0.4, goal_distance: 1.0, box_distance: 0.0, half_area: 4.6, apart: false };
    check_resets(&world("open8", 8), &rules);
}
