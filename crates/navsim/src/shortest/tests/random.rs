//! Random worlds: against a visibility graph of sampled arcs, against the same search without a lower bound, and the
//! properties that every shortest path has.

use super::super::{around, needs_detour, shortest_path};
use crate::grown::tests::{room, stream};
use crate::grown::{GrownShape, Point, apart};
use crate::rng::Stream;
use crate::world::Shape;
use crate::world::shapes::turn;
use std::f64::consts::{PI, TAU};

/// A world, as the reference sees it: edges and the distance that is kept from them.
pub(crate) struct Plain(Vec<(Vec<(Point, Point)>, f64)>);

fn to_edge(p: Point, a: Point, b: Point) -> f64 {
    let (edge, offset) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let square = edge[0] * edge[0] + edge[1] * edge[1];
    let share = ((offset[0] * edge[0] + offset[1] * edge[1]) / square.max(1e-30)).clamp(0.0, 1.0);
    (offset[0] - share * edge[0]).hypot(offset[1] - share * edge[1])
}

impl Plain {
    pub fn new(shapes: &[Shape], radius: f64) -> Self {
        let edges = |shape: &Shape| match shape {
            Shape::Circle { center, radius: own } => (vec![(*center, *center)], radius + own),
            _ => {
                let corners = shape.corners();
                ((0..corners.len()).map(|i| (corners[i], corners[(i + 1) % corners.len()])).collect(), radius)
            }
        };
        Self(shapes.iter().map(edges).collect())
    }

    pub fn is_free(&self, p: Point) -> bool {
        self.0.iter().all(|(edges, reach)| {
            let inside = edges.len() > 2 && edges.iter().all(|(a, b)| turn(*a, *b, p) > 0.0);
            !inside && edges.iter().all(|(a, b)| to_edge(p, *a, *b) >= reach - 1e-10)
        })
    }

    pub fn sees(&self, p: Point, q: Point) -> bool {
        self.0.iter().all(|(edges, reach)| {
            edges.iter().all(|(a, b)| {
                let crossed = turn(p, q, *a) * turn(p, q, *b) < 0.0 && turn(*a, *b, p) * turn(*a, *b, q) < 0.0;
                let ends = to_edge(p, *a, *b).min(to_edge(q, *a, *b)).min(to_edge(*a, p, q)).min(to_edge(*b, p, q));
                !crossed && ends >= reach - 1e-10
            })
        })
    }

    /// Points around which a path may bend: corners of regular polygons of `sides` around the arcs.
    fn bends(&self, sides: usize) -> Vec<Point> {
        let step = TAU / sides as f64;
        let mut points = Vec::new();
        for (edges, reach) in &self.0 {
            let reach = reach / (0.5 * step).cos();
            for (corner, _) in edges {
                let at = |angle: f64| [corner[0] + reach * angle.cos(), corner[1] + reach * angle.sin()];
                points.extend((0..sides).map(|i| at(i as f64 * step)));
            }
        }
        points.retain(|p| self.is_free(*p));
        points
    }

    /// Dijkstra over all bends that see each other: never too short, too long by what the polygons cut.
    fn reference(&self, start: Point, goal: Point, goal_radius: f64, sides: usize) -> Option<f64> {
        let points = [vec![start], self.bends(sides)].concat();
        let border: Vec<Point> = (0..4 * sides)
            .map(|i| TAU * i as f64 / (4 * sides) as f64)
            .map(|angle| [goal[0] + goal_radius * angle.cos(), goal[1] + goal_radius * angle.sin()])
            .filter(|p| self.is_free(*p))
            .collect();
        let mut lengths = vec![f64::INFINITY; points.len()];
        let mut settled = vec![false; points.len()];
        let mut best = f64::INFINITY;
        lengths[0] = 0.0;
        loop {
            let open = (0..points.len()).filter(|i| !settled[*i]);
            let Some(next) = open.min_by(|i, j| lengths[*i].total_cmp(&lengths[*j])) else { break };
            if lengths[next] >= best || lengths[next].is_infinite() {
                break;
            }
            settled[next] = true;
            let (here, length) = (points[next], lengths[next]);
            let share = goal_radius / apart(here, goal);
            let radial = [goal[0] + share * (here[0] - goal[0]), goal[1] + share * (here[1] - goal[1])];
            for end in border.iter().chain([&radial]) {
                let whole = length + if share >= 1.0 { 0.0 } else { apart(here, *end) };
                if whole < best && (share >= 1.0 || (self.sees(here, *end) && self.is_free(*end))) {
                    best = whole;
                }
            }
            for other in 0..points.len() {
                let whole = length + apart(here, points[other]);
                if !settled[other] && whole < lengths[other].min(best) && self.sees(here, points[other]) {
                    lengths[other] = whole;
                }
            }
        }
        best.is_finite().then_some(best)
    }
}

fn random_shape(random: &mut Stream, half: f64) -> Shape {
    let center = [random.uniform(-half, half), random.uniform(-half, half)];
    let around = |length: f64, angle: f64| [center[0] + length * angle.cos(), center[1] + length * angle.sin()];
    match (4.0 * random.unit()) as u32 {
        0 => Shape::Circle { center, radius: random.uniform(0.05, 0.6) },
        1 => {
            let [length, width] = [random.uniform(0.3, 1.2), random.uniform(0.3, 1.2)];
            Shape::Box { center, yaw: random.uniform(-PI, PI), length, width }
        }
        2 => Shape::Segment { a: center, b: around(random.uniform(0.5, 2.5), random.uniform(0.0, TAU)) },
        _ => {
            let corners = 3 + (4.0 * random.unit()) as usize;
            let (size, first) = (random.uniform(0.3, 0.9), random.uniform(0.0, TAU));
            let angle = |i: usize, random: &mut Stream| first + TAU * (i as f64 + 0.5 * random.unit()) / corners as f64;
            Shape::polygon((0..corners).map(|i| around(size, angle(i, random))).collect()).unwrap()
        }
    }
}

/// A random world with its robot: shapes, radius, start and goal (both free), goal radius.
pub(crate) struct World {
    pub shapes: Vec<Shape>,
    pub radius: f64,
    pub start: Point,
    pub goal: Point,
    pub goal_radius: f64,
}

impl World {
    pub fn new(seed: u64, count: usize) -> Self {
        let mut random = stream(seed);
        let mut shapes: Vec<Shape> = (0..count).map(|_| random_shape(&mut random, 3.0)).collect();
        if seed.is_multiple_of(2) {
            shapes.extend(room(3.0));
        }
        let radius = random.uniform(0.05, 0.3);
        let plain = Plain::new(&shapes, radius);
        let mut free = || loop {
            let point = [random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)];
            if plain.is_free(point) {
                return point;
            }
        };
        let (start, goal) = (free(), free());
        Self { shapes, radius, start, goal, goal_radius: if seed.is_multiple_of(3) { 0.01 } else { 0.3 } }
    }

    pub fn length(&self) -> Option<f64> {
        shortest_path(&self.shapes, self.radius, self.start, self.goal, self.goal_radius)
    }
}

#[test]
fn lengths_agree_with_a_visibility_graph() {
    let mut errors = Vec::new();
    let (mut enclosed, mut detours) = (0, 0);
    for seed in 0..240 {
        let world = World::new(seed, 6 + 7 * (seed as usize % 3));
        let World { start, goal, goal_radius, .. } = world;
        let found = world.length();
        let reference = Plain::new(&world.shapes, world.radius).reference(start, goal, goal_radius, 64);
        match (found, reference) {
            (Some(found), Some(reference)) => errors.push((reference - found) / found.max(0.1)),
            (None, None) => enclosed += 1,
            _ => panic!("seed {seed}: {found:?}, reference {reference:?}"),
        }
        detours += usize::from(needs_detour(&world.shapes, world.radius, start, goal));
    }
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let (least, p99, most) = (errors[0], errors[errors.len() * 99 / 100], errors[errors.len() - 1]);
    println!("reference longer by: least {least:.1e}, mean {mean:.1e}, p99 {p99:.1e}, most {most:.1e}");
    println!("{} worlds with a path, {enclosed} without, {detours} with a detour", errors.len());
    assert!(least > -1e-9 && most < 3e-3 && mean < 1e-4);
    assert!(enclosed >= 5 && detours >= 100);
}

#[test]
fn the_lower_bound_changes_nothing() {
    let mut detours = 0;
    for seed in 1000..1600 {
        let world = World::new(seed, 8 + seed as usize % 20);
        let World { start, goal, goal_radius, radius, .. } = world;
        if apart(start, goal) <= goal_radius {
            continue;
        }
        let obstacles: Vec<GrownShape> = world.shapes.iter().map(|shape| GrownShape::new(shape, radius)).collect();
        let blind = around(obstacles, radius, start, goal, goal_radius, 0.0);
        match (world.length(), blind) {
            (Some(guided), Some(blind)) => assert!((guided - blind).abs() < 1e-9, "seed {seed}: {guided} {blind}"),
            (guided, blind) => assert_eq!(guided, blind, "seed {seed}"),
        }
        detours += usize::from(needs_detour(&world.shapes, radius, start, goal));
    }
    assert!(detours > 300);
}

#[test]
fn there_and_back_are_equally_long() {
    for seed in 2000..2200 {
        let mut world = World::new(seed, 10);
        world.goal_radius = 0.0;
        let there = world.length();
        std::mem::swap(&mut world.start, &mut world.goal);
        match (there, world.length()) {
            (Some(there), Some(back)) => assert!((there - back).abs() < 1e-9, "seed {seed}: {there} {back}"),
            (there, back) => assert_eq!(there, back, "seed {seed}"),
        }
    }
}

#[test]
fn more_obstacles_and_smaller_goals_never_shorten_a_path() {
    for seed in 3000..3200 {
        let mut world = World::new(seed, 12);
        let straight = (apart(world.start, world.goal) - world.goal_radius).max(0.0);
        let full = world.length().unwrap_or(f64::INFINITY);
        let touches = needs_detour(&world.shapes, world.radius, world.start, world.goal);
        assert!(full >= straight - 1e-12 && (touches || full == straight), "seed {seed}");
        world.goal_radius += 0.1;
        let near = world.length().unwrap_or(f64::INFINITY);
        assert!(near <= full, "seed {seed}");
        world.goal_radius -= 0.1;
        let mut longest = full;
        while world.shapes.pop().is_some() {
            let length = world.length().unwrap_or(f64::INFINITY);
            assert!(length <= longest + 1e-9, "seed {seed}: {length} after {longest}");
            longest = length;
        }
        assert!((longest - straight).abs() < 1e-12);
    }
}
