//! Tests of what cuts ends off and of fast marching; and what tests of paths share.

use super::enclosure::cut_off;
use super::{Field, Grid, GrownShape, GrownWorld, Point};
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::world::Shape;
use std::f64::consts::TAU;

pub(crate) fn stream(seed: u64) -> Stream {
    Stream::new(StreamName::new(seed, Purpose::World, Split::Test, 0, 0))
}

/// Four walls around a square of half side `half`.
pub(crate) fn room(half: f64) -> Vec<Shape> {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    (0..4).map(|i| Shape::Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect()
}

#[test]
fn however_many_ends_there_are_each_is_told_to_be_cut_off_or_not() {
    let world =
        GrownWorld::new(room(2.0).iter().map(|wall| GrownShape::new(wall, 0.2)).collect(), [-9.0, -9.0, 9.0, 9.0]);
    let ends: Vec<Point> = (0..200)
        .map(|i| ([1.0, 4.0][i % 2], TAU * i as f64 / 200.0))
        .map(|(length, angle)| [length * angle.cos(), length * angle.sin()])
        .collect();
    for (start, apart) in [([0.1, 0.2], 1), ([5.0, 0.3], 0)] {
        let cut = cut_off(&world, &world.joints(), start, &ends);
        assert_eq!(cut, (0..200).map(|i| i % 2 == apart).collect::<Vec<_>>());
    }
}

#[test]
fn marching_is_second_order_in_the_open() {
    let mut errors = Vec::new();
    for cells in [50, 100, 200] {
        let grid = Grid::around([-1.0, -1.0, 1.0, 1.0], 2.0 / f64::from(cells));
        let from_center = |node: usize| grid.position(node)[0].hypot(grid.position(node)[1]);
        let sources: Vec<(usize, f64)> =
            (0..grid.len()).map(|node| (node, from_center(node))).filter(|(_, distance)| *distance < 0.2).collect();
        let field = Field::march(grid, &vec![false; grid.len()], &sources);
        let marched = (0..grid.len()).filter(|node| field.distances()[*node].is_finite());
        let worst =
            marched.map(|node| (field.distances()[node] - from_center(node)).abs() / from_center(node).max(0.2));
        errors.push(worst.fold(0.0, f64::max));
        let inside = field.at([0.533, 0.217]);
        println!("{inside} {}", inside / 0.533f64.hypot(0.217) - 1.0);
        assert!(field.at([2.0, 0.0]).is_infinite());
    }
    println!("largest relative errors at 50, 100, 200 cells: {errors:?}");
    assert!(errors[1] < 1.5e-3 && errors[1] < 0.5 * errors[0] && errors[2] < 0.5 * errors[1], "{errors:?}");
}

#[test]
fn marching_goes_around_blocked_nodes_and_not_through() {
    let grid = Grid { origin: [0.0, 0.0], cell: 0.1, columns: 60, rows: 60 };
    let wall = |node: usize| (29..32).contains(&(node % 60)) && node / 60 < 40;
    let blocked: Vec<bool> = (0..grid.len()).map(wall).collect();
    let [start, goal] = [10 * 60 + 20, 10 * 60 + 40];
    let field = Field::march(grid, &blocked, &[(goal, 0.0)]);
    // Over the wall's end, nodes (28..32, 40).
    let exact = 2.0 * 0.8f64.hypot(3.0) + 0.4;
    assert!((field.distances()[start] / exact - 1.0).abs() < 0.03, "{} {exact}", field.distances()[start]);
    assert!(field.distances()[10 * 60 + 30].is_infinite());
    let closed: Vec<bool> = (0..grid.len()).map(|node| (29..32).contains(&(node % 60))).collect();
    assert!(Field::march(grid, &closed, &[(goal, 0.0)]).distances()[start].is_infinite());
}
