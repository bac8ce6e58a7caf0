//! Drawn episodes are fair: checked by geometry of the test's own.
#![allow(clippy::unwrap_used)]
use navsim::config::{CollisionRule, TaskConfig, WorldConfig};
use navsim::error::Error;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::robot::Footprint;
use navsim::world::{Generator, Layout, Scenario, Shape, Worlds};
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

/// The world of a file with this text.
fn from_file(name: &str, text: &str) -> Generator {
    let path = std::env::temp_dir().join(format!("navsim-{name}-{}.json", std::process::id()));
    std::fs::write(&path, text).unwrap();
    let generator = Generator::new(&world(path.to_str().unwrap(), 8), &DISC);
    std::fs::remove_file(&path).unwrap();
    generator.unwrap()
}

fn draw(generator: &Generator, seed: u64, index: u32, episode: u64, layout: &mut Layout) -> Result<(), Error> {
    let name = StreamName::new(seed, Purpose::World, Split::Train, index, episode);
    generator.draw(&mut Stream::new(name), episode, layout)
}

fn as_scenario(generator: &Generator, layout: &Layout) -> Scenario {
    let (collision, sensor_range) = (CollisionRule::Footprint, 0.35);
    let task = TaskConfig { period: 0.1, time_limit: 50.0, goal_radius: 0.3, collision, sensor_range };
    generator.scenario(layout.start, layout.goal, &layout.moved, &task)
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

#[test]
fn walls_is_fair() {
    let rules = Rules { clearance: 0.4, goal_distance: 1.0, box_distance: 0.0, half_area: 4.6, apart: false };
    check_resets(&world("walls", 8), &rules);
}

/// Robot and scenario k of "mixed" meet what they would meet in the world that is theirs.
#[test]
fn mixed_gives_each_robot_a_world_of_its_own() {
    let parts = ["td3", "boxes", "open8", "boxes", "td3", "boxes", "walls", "boxes"];
    let counts = [8, 4, 8, 8, 8, 12, 8, 16];
    let mixed = Worlds::new(&world("mixed", 8), &DISC).unwrap();
    let mut layouts = mixed.layouts();
    assert_eq!(layouts.len(), parts.len());
    for (k, (name, boxes)) in (0..).zip(parts.into_iter().zip(counts).cycle().take(19)) {
        let own = Generator::new(&world(name, boxes), &DISC).unwrap();
        let mut layout = Layout::default();
        draw(&own, 6, k, 3, &mut layout).unwrap();
        let (generator, place) = (mixed.of(k as usize), k as usize % parts.len());
        draw(generator, 6, k, 3, &mut layouts[place]).unwrap();
        assert_eq!(as_scenario(generator, &layouts[place]), as_scenario(&own, &layout));
    }
}

#[test]
fn td3_has_the_published_geometry() {
    let generator = Generator::new(&world("td3", 8), &DISC).unwrap();
    let obstacles = generator.static_obstacles();
    assert_eq!(obstacles.len(), 18);
    let solids: Vec<Solid> = generator.static_shapes().iter().map(Solid::new).collect();
    for (point, expected) in [
        // The free square of 10.7 m: inner faces at 5.35.
        ([0.0, 5.0], 0.35),
        ([-5.0, -5.0], 0.35),
        ([5.0, 0.0], 0.35),
        // The lower right corner of the cross's flat arm: (-2.152 + 1.25, 1.857 - 0.075).
        ([0.0, 0.0], 0.902f64.hypot(1.782)),
        // Left and right of the upright arms of the cross and of the L.
        ([-1.5, 0.9], 2.155 - 0.075 - 1.5),
        ([4.0, -1.0], 4.0 - 3.206 - 0.075),
        // Below the hydrant, above the bookshelf and the table.
        ([-4.572, 3.851], 0.5),
        ([4.784, -3.43], 0.3),
        ([-4.342, 0.367], 0.5),
        // Within the closed block, 2.6 - 2.214 below its middle.
        ([2.7, 2.6], 2.6 - 2.214 - 0.075),
    ] {
        let exact = clearance(point, &solids);
        assert!((exact - expected).abs() < 1e-9, "{point:?}: {exact}");
        assert!((f64::from(obstacles.distance(point, 10.0)) - exact).abs() < 1e-5);
    }
}

#[test]
fn rooms_that_trap_the_robot_are_never_drawn() {
    // A robot so small that it would fit into the closed block and the triangle of td3.
    let generator = Generator::new(&world("td3", 8), &Footprint::Disc { radius: 0.02 }).unwrap();
    let solids: Vec<Solid> = generator.static_shapes().iter().map(Solid::new).collect();
    // A closed room of 2 m beside a corridor twice as large, both wide enough for start and goal.
    let text = r#"{"area": [0, 0, 6, 2], "segments": [[0,0,6,0],[6,0,6,2],[6,2,0,2],[0,2,0,0],[2,0,2,2]]}"#;
    let rooms = from_file("rooms", text);
    let mut layout = Layout::default();
    for episode in 0..2000 {
        draw(&rooms, 3, 0, episode, &mut layout).unwrap();
        for [x, y] in [[layout.start.x, layout.start.y], layout.goal] {
            assert!((2.3..=5.7).contains(&x) && (0.3..=1.7).contains(&y), "{x} {y}");
        }
        draw(&generator, 3, 0, episode, &mut layout).unwrap();
        assert!(is_reachable([layout.start.x, layout.start.y], layout.goal, &solids));
    }
}

#[test]
fn the_name_of_a_stream_decides_everything() {
    for name in ["td3", "boxes", "open8", "walls"] {
        let generator = Generator::new(&world(name, 8), &DISC).unwrap();
        let (mut fresh, mut used) = (Layout::default(), Layout::default());
        for episode in 0..50 {
            draw(&generator, 4, 2, episode + 1000, &mut used).unwrap();
            draw(&generator, 4, 2, episode, &mut used).unwrap();
            draw(&generator, 4, 2, episode, &mut fresh).unwrap();
            let scenario = as_scenario(&generator, &fresh);
            assert_eq!(scenario, as_scenario(&generator, &used));
            scenario.check(&DISC).unwrap();
            for (seed, index, other) in [(5, 2, episode), (4, 3, episode), (4, 2, episode + 1)] {
                draw(&generator, seed, index, other, &mut used).unwrap();
                assert_ne!(scenario.start, used.start);
                assert_ne!(scenario.goal, used.goal);
                assert_ne!(fresh.moved, used.moved);
            }
        }
    }
}

#[test]
fn goals_move_away_as_episodes_pass() {
    let mut config = world("td3", 8);
    (config.goal_range_start, config.goal_range_growth, config.goal_range_max) = (1.0, 0.01, 3.0);
    let generator = Generator::new(&config, &DISC).unwrap();
    let mut layout = Layout::default();
    for (episode, range) in [(0, 1.0), (100, 2.0), (200, 3.0), (100_000, 3.0)] {
        let mut farthest: f64 = 0.0;
        for index in 0..1000 {
            draw(&generator, 0, index, episode, &mut layout).unwrap();
            let (dx, dy) = (layout.goal[0] - layout.start.x, layout.goal[1] - layout.start.y);
            farthest = farthest.max(dx.abs()).max(dy.abs());
        }
        assert!(farthest <= range && farthest > 0.9 * range, "{episode}: {farthest}");
    }
    config.goal_range_start = 0.7;
    let Err(Error::Setting { key, .. }) = Generator::new(&config, &DISC) else { panic!("accepted") };
    assert_eq!(key, "world.goal_range_start");
}

#[test]
fn a_full_world_is_refused_after_bounded_tries() {
    // Start and goal fit into the room of 4 m, but no box of 3.5 m beside them.
    let walls = "[[0,0,4,0],[4,0,4,4],[4,4,0,4],[0,4,0,0]]";
    let boxes = r#"{"count": 1, "sides": [3.5, 3.5], "clearance": 1}"#;
    let text = format!(r#"{{"area": [0, 0, 4, 4], "segments": {walls}, "random_boxes": {boxes}}}"#);
    let error = draw(&from_file("full", &text), 0, 0, 0, &mut Layout::default()).unwrap_err();
    assert!(error.to_string().contains("no place for obstacle 1 of 1 with 1.000 m"), "{error}");
    assert!(matches!(&error, Error::WorldTooFull { tries: 1000, .. }), "{error}");
    let message = Generator::new(&world("boxes", 8), &Footprint::Disc { radius: 5.0 }).unwrap_err().to_string();
    assert!(message.contains("wider than the free space") && message.contains("radius 5.000 m + 0.05 m"), "{message}");
    assert!(!message.contains('\n'));
}

#[test]
fn larger_robots_get_larger_clearances() {
    let footprint = Footprint::Rectangle { length: 1.2, width: 0.5 };
    let generator = Generator::new(&world("td3", 8), &footprint).unwrap();
    let mut layout = Layout::default();
    for episode in 0..500 {
        draw(&generator, 0, 0, episode, &mut layout).unwrap();
        let scenario = as_scenario(&generator, &layout);
        let solids: Vec<Solid> = scenario.shapes.iter().map(Solid::new).collect();
        assert!(clearance([layout.start.x, layout.start.y], &solids) >= 0.65 + 0.05);
        assert!(clearance(layout.goal, &solids) >= 0.65 + 0.05);
        scenario.check(&footprint).unwrap();
    }
}

#[test]
fn yaw_of_the_boxes_can_be_fixed() {
    let config = WorldConfig { random_yaw: false, ..world("td3", 8) };
    let generator = Generator::new(&config, &DISC).unwrap();
    let mut layout = Layout::default();
    draw(&generator, 0, 0, 0, &mut layout).unwrap();
    assert_eq!(layout.moved.len(), 4);
    for shape in &layout.moved {
        assert!(matches!(shape, Shape::Box { yaw: 0.0, length: 0.5, width: 0.4, .. }), "{shape:?}");
    }
}

/// A shape far outside of the area neither blocks the corridor nor makes the grid too coarse to see through it.
#[test]
fn a_far_shape_changes_nothing() {
    let corridor = |more: &str| {
        let walls = "[[0, 0, 20, 0], [20, 0, 20, 1], [20, 1, 0, 1], [0, 1, 0, 0]]";
        let generator = from_file("far", &format!(r#"{{"area": [0, 0, 20, 1], "segments": {walls}{more}}}"#));
        let mut layout = Layout::default();
        draw(&generator, 1, 0, 0, &mut layout).unwrap();
        (layout.start, layout.goal)
    };
    let alone = corridor("");
    assert_eq!(alone, corridor(r#", "circles": [[900, 900, 1]]"#));
    assert_eq!(alone, corridor(r#", "circles": [[10, 900, 895]]"#));
}

/// The random boxes of an L-shaped room stand inside of it, and not in the quarter of its area that lies outside.
#[test]
fn random_boxes_of_a_file_stand_where_robots_drive() {
    let walls = "[[0,0,8,0],[8,0,8,4],[8,4,4,4],[4,4,4,8],[4,8,0,8],[0,8,0,0]]";
    let boxes = r#"{"count": 3, "sides": [0.3, 0.6], "clearance": 0.45}"#;
    let generator =
        from_file("l", &format!(r#"{{"area": [0, 0, 8, 8], "segments": {walls}, "random_boxes": {boxes}}}"#));
    let mut layout = Layout::default();
    for episode in 0..300 {
        draw(&generator, 0, 0, episode, &mut layout).unwrap();
        assert_eq!(layout.moved.len(), 3);
        for shape in &layout.moved {
            let Shape::Box { center: [x, y], .. } = shape else { panic!("{shape:?}") };
            assert!(*x < 4.0 || *y < 4.0, "episode {episode}: {shape:?}");
        }
    }
}
