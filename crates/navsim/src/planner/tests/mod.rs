//! Tests of the planners: `analytic` with lengths known by hand, `random` against a search of another kind, `maps` and
//! `grids` against brute force, `plans` by an independent check of every path, `trees` and `guides`.

mod analytic;
mod grids;
mod guides;
mod maps;
mod plans;
mod random;
mod trees;

use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::world::Shape;

type Point = [f64; 2];

fn stream(seed: u64) -> Stream {
    Stream::new(StreamName::new(seed, Purpose::World, Split::Test, 0, 0))
}

/// Four walls around a square of half side `half`.
fn room(half: f64) -> Vec<Shape> {
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    (0..4).map(|i| Shape::Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect()
}
