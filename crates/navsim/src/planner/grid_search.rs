//! A* and Dijkstra's algorithm on a map: eight neighbours, the shortest way between two sets of nodes.
//!
//! A* is led by the octile distance (Hart, Nilsson and Raphael, "A formal basis for the heuristic determination of
//! minimum cost paths", IEEE Transactions on Systems Science and Cybernetics 4, 1968). The queue is a ring of buckets
//! of half a cell (Dial, "Algorithm 360: shortest-path forest with topological ordering", CACM 12, 1969): nodes of one
//! bucket are taken in any order, and once more if they turn out to be nearer than thought.

use super::occupancy::{Anchor, Map};
use crate::grown::{Grid, Point};
use std::f64::consts::SQRT_2;

/// Buckets of the ring. Keys in use at one time differ by less than 20 cells: an edge changes a key by 3 cells at most,
/// and starts lie within 3 cells of one point.
const BUCKETS: usize = 64;
/// Buckets per cell.
const BUCKETS_PER_CELL: f64 = 2.0;
/// Steps to the eight neighbours: columns, rows, length in cells.
pub(crate) const STEPS: [(isize, isize, f64); 8] = [
    (1, 0, 1.0),
    (1, 1, SQRT_2),
    (0, 1, 1.0),
    (-1, 1, SQRT_2),
    (-1, 0, 1.0),
    (-1, -1, SQRT_2),
    (0, -1, 1.0),
    (1, -1, SQRT_2),
];

/// Marks of a node: the step that led to it in the lower bits, or `FIRST` where a way begins.
const FIRST: u8 = 8;
const STEP: u8 = 15;
/// Taken from the queue since its length last fell.
const DONE: u8 = 16;
/// A way may end here.
const GOAL: u8 = 32;
const BLOCKED: u8 = 64;

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Route {
    /// Nodes from start to goal; empty if no way joins them.
    pub nodes: Vec<usize>,
    /// Length (m) with both anchors; infinite without a way.
    pub length: f64,
    /// Nodes taken from the queue.
    pub expansions: u64,
}

/// The shortest way from one of `starts` to one of `goals` (in rising order), the lengths of their anchors included.
/// With a `lead`, a point amid the goals, the octile distance to it leads the search (A*); without, all directions are
/// alike (Dijkstra).
pub(crate) fn search(map: &Map, starts: &[Anchor], goals: &[Anchor], lead: Option<Point>) -> Route {
    let mut search = Search::new(map, goals, lead);
    for &(node, length) in starts {
        search.offer(node, length, FIRST);
    }
    search.run(goals)
}

/// Length (m) of the shortest way of eight directions from a node to `point`.
#[inline(always)]
fn octile(grid: &Grid, column: usize, row: usize, point: Point) -> f64 {
    let x = (grid.origin[0] + grid.cell * column as f64 - point[0]).abs();
    let y = (grid.origin[1] + grid.cell * row as f64 - point[1]).abs();
    x.max(y) + (SQRT_2 - 1.0) * x.min(y)
}

struct Search<'a> {
    map: &'a Map,
    /// Length (m) of the best way to each node so far.
    lengths: Vec<f64>,
    marks: Vec<u8>,
    /// The point that leads, and how much (m) nearer than that a way may end.
    lead: Option<(Point, f64)>,
    ring: Vec<Vec<u32>>,
    /// Number of the bucket whose nodes are being taken; `usize::MAX` before the first.
    bucket: usize,
    /// Nodes in the ring.
    waiting: usize,
}

impl<'a> Search<'a> {
    fn new(map: &'a Map, goals: &[Anchor], lead: Option<Point>) -> Self {
        let mut marks: Vec<u8> = map.blocked.iter().map(|blocked| if *blocked { BLOCKED } else { 0 }).collect();
        goals.iter().for_each(|(node, _)| marks[*node] |= GOAL);
        // octile(n, lead) <= octile(n, g) + octile(g, lead) for every goal g.
        let columns = map.grid.columns;
        let nearer = |point: Point| {
            let win = |goal: &Anchor| octile(&map.grid, goal.0 % columns, goal.0 / columns, point) - goal.1;
            goals.iter().map(win).fold(0.0, f64::max)
        };
        let lead = lead.map(|point| (point, nearer(point)));
        let ring = vec![Vec::new(); BUCKETS];
        let lengths = vec![f64::INFINITY; marks.len()];
        Self { map, lengths, marks, lead, ring, bucket: usize::MAX, waiting: 0 }
    }

    /// Lower bound of the way (m) from a node to where it may end, its tail included.
    #[inline(always)]
    fn remaining(&self, column: usize, row: usize) -> f64 {
        self.lead.map_or(0.0, |(point, nearer)| (octile(&self.map.grid, column, row, point) - nearer).max(0.0))
    }

    /// Queues a node that is reached by a way of this length and a last step, if no shorter one is known.
    fn offer(&mut self, node: usize, length: f64, step: u8) {
        if self.marks[node] & BLOCKED == 0 && length < self.lengths[node] {
            let columns = self.map.grid.columns;
            self.queue(node, node % columns, node / columns, length, step);
        }
    }

    #[inline(always)]
    fn queue(&mut self, node: usize, column: usize, row: usize, length: f64, step: u8) {
        self.lengths[node] = length;
        self.marks[node] = self.marks[node] & GOAL | step;
        let key = (length + self.remaining(column, row)) * (BUCKETS_PER_CELL / self.map.grid.cell);
        // Rounding may put a key below the present bucket. The first start decides where the ring begins.
        let bucket = if self.bucket == usize::MAX { key as usize } else { (key as usize).max(self.bucket) };
        self.ring[bucket % BUCKETS].push(node as u32);
        self.waiting += 1;
    }

    fn run(mut self, goals: &[Anchor]) -> Route {
        let mut best = Route { nodes: Vec::new(), length: f64::INFINITY, expansions: 0 };
        let mut last = usize::MAX;
        self.bucket = self.first_bucket();
        while self.waiting > 0 && (self.bucket as f64) * self.map.grid.cell < best.length * BUCKETS_PER_CELL {
            while let Some(node) = self.ring[self.bucket % BUCKETS].pop() {
                let node = node as usize;
                self.waiting -= 1;
                let (column, row) = (node % self.map.grid.columns, node / self.map.grid.columns);
                let hopeless = self.lengths[node] + self.remaining(column, row) >= best.length;
                if hopeless || self.marks[node] & DONE != 0 {
                    continue;
                }
                self.marks[node] |= DONE;
                best.expansions += 1;
                if self.marks[node] & GOAL != 0 {
                    let tail =
                        goals.binary_search_by_key(&node, |anchor| anchor.0).map_or(f64::INFINITY, |i| goals[i].1);
                    if self.lengths[node] + tail < best.length {
                        (best.length, last) = (self.lengths[node] + tail, node);
                    }
                }
                self.expand(node, column, row);
            }
            self.bucket += 1;
        }
        if last != usize::MAX {
            best.nodes = self.way_to(last);
        }
        best
    }

    /// The lowest bucket with a start: all of them lie in less than half a ring.
    fn first_bucket(&self) -> usize {
        let key = |node: &u32| {
            let (node, columns) = (*node as usize, self.map.grid.columns);
            let length = self.lengths[node] + self.remaining(node % columns, node / columns);
            (length * (BUCKETS_PER_CELL / self.map.grid.cell)) as usize
        };
        self.ring.iter().flatten().map(key).min().unwrap_or(0)
    }

    #[inline(always)]
    fn expand(&mut self, node: usize, column: usize, row: usize) {
        let (columns, cell, length) = (self.map.grid.columns, self.map.grid.cell, self.lengths[node]);
        for (step, (right, up, cells)) in STEPS.iter().enumerate() {
            let next = node.wrapping_add_signed(up * columns as isize + right);
            let longer = length + cells * cell;
            if longer < self.lengths[next] && self.marks[next] & BLOCKED == 0 {
                self.queue(next, column.wrapping_add_signed(*right), row.wrapping_add_signed(*up), longer, step as u8);
            }
        }
    }

    fn way_to(&self, last: usize) -> Vec<usize> {
        let (mut node, mut nodes) = (last, vec![last]);
        while self.marks[node] & STEP != FIRST {
            let (right, up, _) = STEPS[usize::from(self.marks[node] & STEP)];
            node = node.wrapping_add_signed(-(up * self.map.grid.columns as isize + right));
            nodes.push(node);
        }
        nodes.reverse();
        nodes
    }
}
