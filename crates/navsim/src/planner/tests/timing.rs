//! How long a path and a field take:
//! `cargo test --release -p navsim planner::tests::timing -- --ignored --nocapture`.

use super::super::{Field, Grid, needs_detour, shortest_path};
use super::{Point, room, stream};
use crate::rng::Stream;
use crate::world::Shape;
use std::f64::consts::{PI, TAU};
use std::time::Instant;

/// Prints the times of `count` routes with a detour through worlds of `draw`, in a room of half side `half`.
fn print_times(name: &str, count: u64, half: f64, draw: fn(&mut Stream, f64) -> Shape, shapes: usize, radius: f64) {
    let mut times = Vec::new();
    for seed in 0..count {
        let mut random = stream(seed);
        let mut world = room(half);
        world.extend((0..shapes).map(|_| draw(&mut random, half)));
        let mut point = || [random.uniform(-0.95 * half, 0.95 * half), random.uniform(-0.95 * half, 0.95 * half)];
        let (start, goal): (Point, Point) = (point(), point());
        let begin = Instant::now();
        let length = shortest_path(&world, radius, start, goal, 0.3);
        let time = 1e3 * begin.elapsed().as_secs_f64();
        if length.is_some() && needs_detour(&world, radius, start, goal) {
            times.push(time);
        }
    }
    times.sort_by(f64::total_cmp);
    let (median, most) = (times[times.len() / 2], times[times.len() - 1]);
    println!("{name}: min {:.2} median {median:.2} max {most:.2} ms of {} routes", times[0], times.len());
}

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

#[test]
#[ignore = "prints times"]
fn paths_and_fields() {
    print_times("16 boxes, 10.7 m", 400, 5.35, large_box, 16, 0.25);
    print_times("1,000 circles, 20 m", 100, 10.0, circle, 1000, 0.25);
    print_times("1,000 circles, 20 m, radius 0.1 m", 40, 10.0, circle, 1000, 0.1);
    print_times("2,000 walls, 40 m", 40, 20.0, wall, 2000, 0.25);
    print_times("5,000 walls, 100 m", 20, 50.0, wall, 5000, 0.25);
    let grid = Grid { origin: [0.0, 0.0], cell: 0.01, columns: 1000, rows: 1000 };
    let begin = Instant::now();
    let field = Field::march(grid, &vec![false; grid.len()], &[(333_333, 0.0)]);
    println!("field of 1,000 x 1,000: {:.1} ms", 1e3 * begin.elapsed().as_secs_f64());
    assert!(field.distances()[500_500].is_finite());
}
