//! Distance to a set of sources around obstacles, on a grid, by fast marching.
//!
//! The distance T solves |grad T| = 1. Nodes are settled in the order of their value, each from its settled neighbours
//! by the upwind scheme (Sethian, "A fast marching level set method for monotonically advancing fronts", PNAS 93,
//! 1996), of second order where two settled nodes lie in a row (Sethian, "Fast marching methods", SIAM Review 41,
//! 1999).

use super::grid::{BORDER, Grid};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Distances from a set of sources over a grid.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    grid: Grid,
    /// Distance of every node, m; infinite where no source can be reached.
    distances: Vec<f64>,
}

impl Field {
    /// Marches from `sources` (node, distance that it keeps, m, >= 0) through the nodes that are not `blocked`.
    ///
    /// Nodes in the border, and sources that are blocked, are not entered; a source out of the grid panics. `blocked`
    /// has one element for each node; missing ones count as blocked.
    ///
    /// Error: second order in the open, if all nodes within a few cells of a point-like source are given as sources
    /// (0.13 % of the distance on 100 x 100 cells, 0.03 % on 200 x 200); at a corner of the blocked region of the order
    /// of a cell, as the region is made of nodes.
    pub fn march(grid: Grid, blocked: &[bool], sources: &[(usize, f64)]) -> Self {
        let (columns, rows, cell) = (grid.columns, grid.rows, grid.cell);
        let mut front =
            Front { columns, cell, distances: vec![f64::INFINITY; grid.len()], marks: vec![SETTLED; grid.len()] };
        for row in BORDER..rows.saturating_sub(BORDER) {
            for column in BORDER..columns.saturating_sub(BORDER) {
                let node = row * columns + column;
                if !blocked.get(node).copied().unwrap_or(true) {
                    front.marks[node] = OPEN;
                }
            }
        }
        let mut queue = BinaryHeap::with_capacity(4 * (columns + rows));
        for &(node, distance) in sources {
            if front.marks[node] != SETTLED && distance < front.distances[node] {
                front.marks[node] = SOURCE;
                front.distances[node] = distance;
                queue.push(queued(distance, node));
            }
        }
        while let Some(Reverse(entry)) = queue.pop() {
            let node = (entry & u64::from(u32::MAX)) as usize;
            if front.marks[node] == SETTLED {
                continue;
            }
            front.marks[node] = SETTLED;
            for neighbour in [node - 1, node + 1, node - columns, node + columns] {
                if front.marks[neighbour] == OPEN {
                    let distance = front.update(neighbour);
                    if distance < front.distances[neighbour] {
                        front.distances[neighbour] = distance;
                        queue.push(queued(distance, neighbour));
                    }
                }
            }
        }
        Self { grid, distances: front.distances }
    }

    /// The grid of the field.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Distance (m) of every node, infinite where no source can be reached; node indices are those of `Grid`.
    pub fn distances(&self) -> &[f64] {
        &self.distances
    }

    /// Distance (m) at `point`, bilinear between its four nodes; infinite where one of them was not reached, and
    /// outside the grid.
    pub fn at(&self, point: [f64; 2]) -> f64 {
        let grid = &self.grid;
        let (x, y) = ((point[0] - grid.origin[0]) / grid.cell, (point[1] - grid.origin[1]) / grid.cell);
        let inside = x >= 0.0 && y >= 0.0 && x < grid.columns as f64 - 1.0 && y < grid.rows as f64 - 1.0;
        if !inside {
            return f64::INFINITY;
        }
        let node = y as usize * grid.columns + x as usize;
        let (u, v) = (x - x.floor(), y - y.floor());
        let [a, b, c, d] =
            [node, node + 1, node + grid.columns, node + grid.columns + 1].map(|node| self.distances[node]);
        let between = (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d);
        if between.is_nan() { f64::INFINITY } else { between }
    }
}

/// Marks of a node: not to be entered (again), still to be settled from its neighbours, or to be settled as it was
/// given.
const SETTLED: u8 = 0;
const OPEN: u8 = 1;
const SOURCE: u8 = 2;

/// Entry of the queue: the distance in single precision (its bits sort as it does) above the node, so that a comparison
/// is one of integers. Nodes may so be settled out of order by 1e-7 of their distance.
fn queued(distance: f64, node: usize) -> Reverse<u64> {
    Reverse(u64::from((distance as f32).to_bits()) << 32 | node as u64)
}

/// The march under way.
struct Front {
    columns: usize,
    cell: f64,
    distances: Vec<f64>,
    marks: Vec<u8>,
}

impl Front {
    /// Distance of `node` from its settled neighbours.
    #[inline(always)]
    fn update(&self, node: usize) -> f64 {
        let x = self.upwind(node, 1);
        let y = self.upwind(node, self.columns);
        // Sum over the axes of weight (T - value)^2 = cell^2; an axis whose value is not below T says nothing.
        let (near, far) = if x.reached <= y.reached { (x, y) } else { (y, x) };
        if far.reached.is_finite() {
            let weight = near.weight + far.weight;
            let mean = (near.weight * near.value + far.weight * far.value) / weight;
            let apart = far.value - near.value;
            let square = self.cell * self.cell * weight - near.weight * far.weight * apart * apart;
            if square >= 0.0 {
                let distance = mean + square.sqrt() / weight;
                if distance >= far.reached {
                    return distance;
                }
            }
        }
        near.value + self.cell / near.weight.sqrt()
    }

    /// The better of the two neighbours of `node` that lie `stride` before and behind it.
    #[inline(always)]
    fn upwind(&self, node: usize, stride: usize) -> Upwind {
        let settled = |node: usize| if self.marks[node] == SETTLED { self.distances[node] } else { f64::INFINITY };
        let (before, behind) = (settled(node - stride), settled(node + stride));
        let (first, second) =
            if before <= behind { (before, settled(node - 2 * stride)) } else { (behind, settled(node + 2 * stride)) };
        if second <= first && first.is_finite() {
            // dT/dx = (3 T - 4 first + second) / (2 cell) = 3/2 (T - value) / cell
            return Upwind { reached: first, value: (4.0 * first - second) / 3.0, weight: 2.25 };
        }
        Upwind { reached: first, value: first, weight: 1.0 }
    }
}

/// One axis of the upwind scheme: weight (T - value)^2, from a neighbour of distance `reached`.
#[derive(Clone, Copy)]
struct Upwind {
    reached: f64,
    value: f64,
    weight: f64,
}
