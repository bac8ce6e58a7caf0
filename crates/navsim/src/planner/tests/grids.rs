//! A* and Dijkstra's algorithm: answers known by hand, and against Bellman and Ford's relaxation of every edge.

use super::super::grid_search::{Route, search};
use super::super::occupancy::{Anchor, Map};
use crate::grown::tests::stream;
use crate::grown::{BORDER, Grid, Point};
use std::f64::consts::SQRT_2;

/// A map from rows of text, the top row first: `#` is blocked.
fn drawn(rows: &[&str]) -> Map {
    let (width, height) = (rows[0].len(), rows.len());
    let mut map = walled(width, height, 1.0);
    for (row, line) in rows.iter().rev().enumerate() {
        for (column, mark) in line.bytes().enumerate() {
            let node = at(&map, column, row);
            map.blocked[node] = mark == b'#';
        }
    }
    map
}

/// A free map of that many nodes within its border.
fn walled(width: usize, height: usize, cell: f64) -> Map {
    let (columns, rows) = (width + 2 * BORDER, height + 2 * BORDER);
    let grid = Grid { origin: [-3.0, 7.0], cell, columns, rows };
    let mut blocked = vec![true; grid.len()];
    for row in BORDER..rows - BORDER {
        blocked[row * columns + BORDER..(row + 1) * columns - BORDER].fill(false);
    }
    Map { grid, blocked }
}

fn at(map: &Map, column: usize, row: usize) -> usize {
    (row + BORDER) * map.grid.columns + column + BORDER
}

/// The shortest length by relaxing every edge until nothing changes.
fn relaxed(map: &Map, starts: &[Anchor], goals: &[Anchor]) -> f64 {
    let columns = map.grid.columns as isize;
    let mut lengths = vec![f64::INFINITY; map.grid.len()];
    let free = |node: usize| !map.blocked[node];
    for (node, length) in starts.iter().filter(|(node, _)| free(*node)) {
        lengths[*node] = length.min(lengths[*node]);
    }
    let mut changed = true;
    while changed {
        changed = false;
        for node in (0..lengths.len()).filter(|node| free(*node)) {
            for up in [-1, 0, 1] {
                for right in [-1, 0, 1] {
                    let from = node.wrapping_add_signed(up * columns + right);
                    let step = map.grid.cell * if up * right == 0 { 1.0 } else { SQRT_2 };
                    if free(from) && lengths[from] + step < lengths[node] - 1e-12 {
                        lengths[node] = lengths[from] + step;
                        changed = true;
                    }
                }
            }
        }
    }
    goals.iter().fold(f64::INFINITY, |best, (node, tail)| best.min(lengths[*node] + tail))
}

/// A* and Dijkstra between two sets of nodes.
fn both(map: &Map, starts: &[Anchor], goals: &[Anchor], lead: Point) -> [Route; 2] {
    [search(map, starts, goals, Some(lead)), search(map, starts, goals, None)]
}

fn between(map: &Map, start: usize, goal: usize) -> [Route; 2] {
    both(map, &[(start, 0.0)], &[(goal, 0.0)], map.grid.position(goal))
}

#[test]
fn lengths_known_by_hand() {
    let open = walled(10, 6, 1.0);
    for route in between(&open, at(&open, 0, 0), at(&open, 9, 4)) {
        assert!((route.length - (5.0 + 4.0 * SQRT_2)).abs() < 1e-12);
        assert_eq!(route.nodes.len(), 10);
    }
    let wall = drawn(&["......", ".####.", ".#..#.", "...#..", "......"]);
    // Out of the pocket between two blocked nodes, which leave room by what a free node is, and up on the right.
    for route in between(&wall, at(&wall, 2, 2), at(&wall, 5, 3)) {
        assert!((route.length - (2.0 + 2.0 * SQRT_2)).abs() < 1e-12, "{route:?}");
    }
    for route in between(&wall, at(&wall, 2, 2), at(&wall, 2, 2)) {
        assert_eq!((route.length, route.nodes), (0.0, vec![at(&wall, 2, 2)]));
    }
    let closed = drawn(&[".....", ".###.", ".#.#.", ".###.", "....."]);
    for route in between(&closed, at(&closed, 2, 2), at(&closed, 4, 4)) {
        assert_eq!((route.length, route.nodes), (f64::INFINITY, vec![]));
    }
}

#[test]
fn random_grids_agree_with_brute_force() {
    let (mut joined, mut cut) = (0, 0);
    for seed in 0..1500 {
        let mut random = stream(seed);
        let mut whole = |low: usize, high: usize| low + (random.unit() * (high - low + 1) as f64) as usize;
        let (width, height) = (whole(1, 23), whole(1, 17));
        let mut map = walled(width, height, [0.05, 0.3, 1.7][seed as usize % 3]);
        let density = [0.0, 0.2, 0.35, 0.45][seed as usize / 3 % 4];
        let ends =
            [at(&map, whole(0, width - 1), whole(0, height - 1)), at(&map, whole(0, width - 1), whole(0, height - 1))];
        for row in 0..height {
            for column in 0..width {
                let node = at(&map, column, row);
                map.blocked[node] = !ends.contains(&node) && random.unit() < density;
            }
        }
        let cell = map.grid.cell;
        // Several starts and goals, each with a length of its own.
        let near = |node: usize, reach: f64| {
            let [x, y] = map.grid.position(node);
            let apart = |[u, v]: [f64; 2]| (u - x).hypot(v - y);
            (0..map.grid.len()).filter(move |other| apart(map.grid.position(*other)) <= reach).collect::<Vec<usize>>()
        };
        let radius = if seed % 2 == 0 { 0.0 } else { 2.2 * cell };
        let mut anchors = |nodes: Vec<usize>| {
            let free = nodes.into_iter().filter(|node| !map.blocked[*node]);
            free.map(|node| (node, 2.0 * cell * random.unit())).collect::<Vec<Anchor>>()
        };
        let (starts, goals) = (anchors(near(ends[0], 0.8 * radius)), anchors(near(ends[1], radius)));
        let expected = relaxed(&map, &starts, &goals);
        let [led, blind] = both(&map, &starts, &goals, map.grid.position(ends[1]));
        for route in [&led, &blind] {
            if expected.is_infinite() {
                assert_eq!((route.length, route.nodes.len()), (f64::INFINITY, 0), "seed {seed}");
                continue;
            }
            assert!((route.length - expected).abs() < 1e-9, "seed {seed}: {} {expected}", route.length);
            let steps: f64 = route.nodes.windows(2).map(|pair| step(&map, pair[0], pair[1])).sum();
            let anchor = |anchors: &[Anchor], node: usize| anchors.iter().find(|a| a.0 == node).map(|a| a.1);
            let first = anchor(&starts, route.nodes[0]).expect("a start");
            let last = anchor(&goals, route.nodes[route.nodes.len() - 1]).expect("a goal");
            assert!((first + steps + last - expected).abs() < 1e-9, "seed {seed}");
            assert!(route.nodes.iter().all(|node| !map.blocked[*node]));
        }
        if expected.is_finite() { joined += 1 } else { cut += 1 }
    }
    assert!(joined > 800 && cut > 100, "{joined} {cut}");
}

/// Length (m) of the step between two neighbours.
fn step(map: &Map, from: usize, to: usize) -> f64 {
    let ([x, y], [u, v]) = (map.grid.position(from), map.grid.position(to));
    let length = (u - x).hypot(v - y);
    assert!(length < 1.5 * map.grid.cell);
    length
}

#[test]
fn the_lead_saves_work() {
    let map = walled(200, 200, 0.05);
    let [led, blind] = between(&map, at(&map, 20, 100), at(&map, 180, 110));
    assert!((led.length - blind.length).abs() < 1e-9);
    assert!(led.expansions < 1000 && blind.expansions > 30_000, "{} {}", led.expansions, blind.expansions);
}
