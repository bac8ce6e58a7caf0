//! Drawn episodes are fair: checked by geometry of the test's own.

use navsim::config::WorldConfig;
use navsim::error::Error;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::robot::Footprint;
use navsim::world::{Generator, Layout, Shape};

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

/// Signed area test: > 0 if c lies left of the line from a to b.
fn side(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn to_edge(p: Point, a: Point, b: Point) -> f64 {
    let (ux, uy) = (b[0] - a[0], b[1] - a[1]);
    let t = (((p[0] - a[0]) * ux + (p[1] - a[1]) * uy) / (ux * ux + uy * uy)).clamp(0.0, 1.0);
    (p[0] - a[0] - t * ux).hypot(p[1] - a[1] - t * uy)
}

/// Corners of a box or segment of these worlds by complex multiplication; circles have none.
fn corners(shape: &Shape) -> Vec<Point> {
    match shape {
        Shape::Box { center, yaw, length, width } => [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
            .iter()
            .map(|(i, j)| {
                let (x, y) = (i * length, j * width);
                [center[0] + x * yaw.cos() - y * yaw.sin(), center[1] + x * yaw.sin() + y * yaw.cos()]
            })
            .collect(),
        Shape::Segment { a, b } => vec![*a, *b],
        Shape::Polygon { points } => points.clone(),
        Shape::Circle { .. } => vec![],
    }
}

fn edges(corners: &[Point]) -> Vec<(Point, Point)> {
    (0..corners.len()).map(|i| (corners[i], corners[(i + 1) % corners.len()])).collect()
}

/// Distance from a point to a shape by its corners, 0 inside.
fn distance(p: Point, shape: &Shape) -> f64 {
    if let Shape::Circle { center, radius } = shape {
        return ((p[0] - center[0]).hypot(p[1] - center[1]) - radius).max(0.0);
    }
    let edges = edges(&corners(shape));
    if edges.len() > 2 && edges.iter().all(|(a, b)| side(*a, *b, p) >= 0.0) {
        return 0.0;
    }
    edges.iter().map(|(a, b)| to_edge(p, *a, *b)).fold(f64::INFINITY, f64::min)
}

fn clearance<'a>(p: Point, shapes: impl IntoIterator<Item = &'a Shape>) -> f64 {
    shapes.into_iter().map(|shape| distance(p, shape)).fold(f64::INFINITY, f64::min)
}

/// Whether two shapes touch: edges cross, or one holds a corner of the other.
fn touch(a: &Shape, b: &Shape) -> bool {
    if let Shape::Circle { center, radius } = a {
        return distance(*center, b) <= *radius;
    }
    if matches!(b, Shape::Circle { .. }) {
        return touch(b, a);
    }
    let (mine, theirs) = (corners(a), corners(b));
    let cross = edges(&mine).iter().any(|(p, q)| {
        edges(&theirs)
            .iter()
            .any(|(r, s)| side(*p, *q, *r) * side(*p, *q, *s) <= 0.0 && side(*r, *s, *p) * side(*r, *s, *q) <= 0.0)
    });
    cross || mine.iter().any(|c| distance(*c, b) == 0.0) || theirs.iter().any(|c| distance(*c, a) == 0.0)
}

/// Whether a point gets from start to goal with `radius` of clearance, by breadth-first search over a grid of 5 cm
/// whose moves are checked every centimetre.
fn is_reachable(start: Point, goal: Point, shapes: &[Shape], radius: f64) -> bool {
    const STEP: f64 = 0.05;
    const SIDE: i64 = 240;
    let at = |(i, j): (i64, i64)| [start[0] + STEP * i as f64, start[1] + STEP * j as f64];
    let index = |(i, j): (i64, i64)| ((i + SIDE) * (2 * SIDE + 1) + j + SIDE) as usize;
    let mut seen = vec![false; ((2 * SIDE + 1) * (2 * SIDE + 1)) as usize];
    let mut queue = std::collections::VecDeque::from([(0i64, 0i64)]);
    seen[index((0, 0))] = true;
    while let Some(cell) = queue.pop_front() {
        let here = at(cell);
        if (here[0] - goal[0]).hypot(here[1] - goal[1]) < 2.0 * STEP {
            return true;
        }
        for (di, dj) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)] {
            let next = (cell.0 + di, cell.1 + dj);
            if next.0.abs() > SIDE || next.1.abs() > SIDE || seen[index(next)] {
                continue;
            }
            seen[index(next)] = true;
            if clearance(at(next), shapes) >= radius {
                queue.push_back(next);
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
    let fixed = generator.static_shapes().to_vec();
    let mut layout = Layout::default();
    for episode in 0..resets() {
        draw(&generator, 1, (episode % 7) as u32, episode, &mut layout).unwrap();
        let (start, goal) = ([layout.start.x, layout.start.y], layout.goal);
        for point in [start, goal] {
            let room = clearance(point, fixed.iter().chain(&layout.moved));
            assert!(room >= rules.clearance - 1e-9, "{episode}: {point:?} has {room}");
            assert!(point.iter().all(|v| v.abs() <= rules.half_area), "{episode}: {point:?}");
        }
        assert!((start[0] - goal[0]).hypot(start[1] - goal[1]) >= rules.goal_distance);
        for (i, shape) in layout.moved.iter().enumerate() {
            shape.validate().unwrap();
            if let Shape::Box { center, .. } = shape {
                for point in [start, goal] {
                    assert!((point[0] - center[0]).hypot(point[1] - center[1]) >= rules.box_distance);
                }
            }
            if rules.apart {
                let other = fixed.iter().chain(&layout.moved[..i]).find(|other| touch(shape, other));
                assert!(other.is_none(), "{episode}: {shape:?} touches {other:?}");
            }
        }
        if episode % 100 == 0 {
            let shapes: Vec<Shape> = fixed.iter().chain(&layout.moved).cloned().collect();
            assert!(is_reachable(start, goal, &shapes, 0.295), "{episode}: {start:?} {goal:?} {shapes:?}");
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
