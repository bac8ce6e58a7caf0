//! Shortest paths with a detour through random worlds of many shapes, and every planner.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, criterion_group, criterion_main};
use navsim::Scenario;
use navsim::planner::{Planner, PlannerConfig, plan};
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::shortest::{needs_detour, shortest_path};
use navsim::world::Shape;
use std::f64::consts::{PI, TAU};

type Draw = fn(&mut Stream, f64) -> Shape;

fn circle(random: &mut Stream, half: f64) -> Shape {
    let center = [random.uniform(-half, half), random.uniform(-half, half)];
    Shape::Circle { center, radius: random.uniform(0.03, 0.1) }
}

fn large_box(random: &mut Stream, half: f64) -> Shape {
    let center = [random.uniform(-half, half), random.uniform(-half, half)];
    let [length, width] = [random.uniform(0.3, 1.2), random.uniform(0.3, 1.2)];
    Shape::Box { center, yaw: random.uniform(-PI, PI), length, width }
}

fn wall(random: &mut Stream, half: f64) -> Shape {
    let a = [random.uniform(-half, half), random.uniform(-half, half)];
    let (length, angle) = (random.uniform(0.2, 1.0), random.uniform(0.0, TAU));
    Shape::Segment { a, b: [a[0] + length * angle.cos(), a[1] + length * angle.sin()] }
}

/// A world of `count` shapes in a room of half side `half`, with a start and a goal that a disc of `radius` joins only
/// by a detour.
fn route(draw: Draw, count: usize, half: f64, radius: f64, seed: u64) -> Option<(Vec<Shape>, [f64; 2], [f64; 2])> {
    let mut random = Stream::new(StreamName::new(seed, Purpose::World, Split::Test, 0, 0));
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let mut world: Vec<Shape> = (0..4).map(|i| Shape::Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect();
    world.extend((0..count).map(|_| draw(&mut random, half)));
    let mut point = || [random.uniform(-0.95 * half, 0.95 * half), random.uniform(-0.95 * half, 0.95 * half)];
    let (start, goal) = (point(), point());
    let joined = shortest_path(&world, radius, start, goal, 0.3).is_some() && needs_detour(&world, radius, start, goal);
    joined.then_some((world, start, goal))
}

fn shortest(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("shortest");
    group.sample_size(20);
    for (name, draw, count, half, radius) in [
        ("16 boxes, 10.7 m", large_box as Draw, 16, 5.35, 0.25),
        ("1,000 circles, 20 m", circle, 1000, 10.0, 0.1),
        ("2,000 walls, 40 m", wall, 2000, 20.0, 0.25),
    ] {
        let routes: Vec<_> = (0..1000).filter_map(|seed| route(draw, count, half, radius, seed)).take(8).collect();
        let mut next = routes.iter().cycle();
        group.bench_function(name, |bencher| {
            bencher.iter(|| next.next().map(|(world, start, goal)| shortest_path(world, radius, *start, *goal, 0.3)));
        });
    }
    group.finish();
}

/// With Python's defaults, but on a map of about 1,000 x 1,000 nodes and without a margin.
fn plans(criterion: &mut Criterion) {
    let mut settings = PlannerConfig::from_json(include_str!("../../crates/navsim/tests/planner.json")).unwrap();
    (settings.margin, settings.resolution) = (0.0, 0.01);
    let mut group = criterion.benchmark_group("plan");
    group.sample_size(20);
    let task = |(shapes, start, goal): (Vec<Shape>, [f64; 2], [f64; 2])| {
        let start = Pose::new(start[0], start[1], 0.0);
        Scenario { start, goal, goal_radius: 0.3, time_limit: 50.0, shapes, shortest: None }
    };
    let routes = (0..1000).filter_map(|seed| route(large_box, 16, 4.6, 0.25, seed));
    let tasks: Vec<Scenario> = routes.take(8).map(task).collect();
    for (name, planner) in Planner::ALL {
        let mut next = tasks.iter().cycle();
        group.bench_function(format!("{name}, 16 boxes, 9.2 m"), |bencher| {
            bencher.iter(|| next.next().map(|task| plan(task, planner, 0.25, &settings, 0, 0).unwrap().length));
        });
    }
    group.finish();
}

criterion_group!(benches, shortest, plans);
criterion_main!(benches);
