//! The free places of a known world on a grid.
//!
//! The grid is conservative, as that of `world::free_space`: a node is free if its clearance is at least
//! `rolling_clearance`. So no edge between neighbours needs a test of its own and no corner is cut. What is lost are
//! passages little wider than the robot.

use super::problem::Problem;
use crate::error::{Error, Result};
use crate::grown::{BORDER, Grid, GrownShape, Point, apart};
use crate::world::rolling_clearance;

/// Cells around a point within which it is joined to nodes by straight lines.
const ANCHOR_CELLS: f64 = 3.0;
/// Cells around the goal circle from which a path ends straight.
pub(crate) const TAIL_CELLS: f64 = 4.0;

/// A node and the length (m) of the straight way that joins it to the start or the goal.
pub(crate) type Anchor = (usize, f64);

/// A grid and what is blocked of it.
#[derive(Debug)]
pub(crate) struct Map {
    pub grid: Grid,
    /// One for each node; the nodes of the border are blocked.
    pub blocked: Vec<bool>,
}

/// A square of nodes.
#[derive(Clone, Copy)]
struct Block {
    column: usize,
    row: usize,
    side: usize,
}

impl Map {
    /// The map of `problem` with cells of the side `cell` (m), which the setting `key` names,
    /// and at most `most` nodes.
    ///
    /// # Errors
    /// The map would have more nodes; the message says which cells would do.
    pub fn new(problem: &Problem, key: &'static str, cell: f64, most: usize) -> Result<Self> {
        let [x0, y0, x1, y1] = problem.bounds;
        let (width, height) = (x1 - x0, y1 - y0);
        let nodes = |cell: f64| (width / cell + 7.0) * (height / cell + 7.0);
        if nodes(cell) > most as f64 {
            let mut least = cell;
            while nodes(least) > most as f64 {
                least *= 1.01;
            }
            let expected = format!(
                "at least {:.3} m: a map of this world, {width:.1} m x {height:.1} m, has at most {most} nodes",
                (1e3 * least).ceil() / 1e3
            );
            return Err(Error::Setting { key, value: cell.to_string(), expected });
        }
        let grid = Grid::around(problem.bounds, cell);
        let mut map = Self { grid, blocked: vec![true; grid.len()] };
        let inner = BORDER..grid.columns - BORDER;
        for row in BORDER..grid.rows - BORDER {
            map.blocked[row * grid.columns..][inner.clone()].fill(false);
        }
        let clearance = problem.clearance;
        let lift = rolling_clearance(clearance, cell) - clearance;
        let shapes = problem.world.shapes();
        let mut near: Vec<u32> = (0..shapes.len() as u32).collect();
        let side = grid.columns.max(grid.rows).next_power_of_two();
        map.carve(shapes, lift, Block { column: 0, row: 0, side }, &mut near, 0);
        Ok(map)
    }

    /// Blocks the nodes of `block` that lie nearer than `lift` (m) to one of the grown shapes `near[first..]`.
    ///
    /// Clearances change by no more than the distance between two points: one at the middle of the block tells which
    /// shapes matter in it, and mostly that none does or one covers it.
    fn carve(&mut self, shapes: &[GrownShape], lift: f64, block: Block, near: &mut Vec<u32>, first: usize) {
        let Block { column, row, side } = block;
        let grid = self.grid;
        if column >= grid.columns || row >= grid.rows {
            return;
        }
        let half = 0.5 * (side - 1) as f64;
        let middle =
            [grid.origin[0] + grid.cell * (column as f64 + half), grid.origin[1] + grid.cell * (row as f64 + half)];
        // At a single node the sign alone decides.
        let reach = half * grid.cell * (std::f64::consts::SQRT_2 + 1e-9);
        let (kept, mut covered) = (near.len(), false);
        for i in first..kept {
            let clearance = shapes[near[i] as usize].clearance(middle) - lift;
            covered |= clearance < -reach;
            if clearance < reach {
                near.push(near[i]);
            }
        }
        if covered {
            let columns = column..(column + side).min(grid.columns);
            for row in row..(row + side).min(grid.rows) {
                self.blocked[row * grid.columns..][columns.clone()].fill(true);
            }
        } else if near.len() > kept {
            let side = side / 2;
            for (right, up) in [(0, 0), (side, 0), (0, side), (side, side)] {
                self.carve(shapes, lift, Block { column: column + right, row: row + up, side }, near, kept);
            }
        }
        near.truncate(kept);
    }

    /// Indices of the free nodes within `reach` (m) of `point` along both axes.
    fn free_nodes(&self, [x, y]: Point, reach: f64) -> impl Iterator<Item = usize> {
        let [columns, rows] = self.grid.window([x - reach, y - reach, x + reach, y + reach]);
        let nodes = rows.flat_map(move |row| columns.clone().map(move |column| row * self.grid.columns + column));
        nodes.filter(|node| !self.blocked[*node])
    }

    /// Free nodes near `point` (free) that a clear straight way joins to it.
    pub fn around(&self, problem: &Problem, point: Point) -> Vec<Anchor> {
        let nodes = self.free_nodes(point, ANCHOR_CELLS * self.grid.cell).map(|node| (node, self.grid.position(node)));
        let clear = nodes.filter(|(_, position)| problem.is_clear(point, *position));
        clear.map(|(node, position)| (node, apart(point, position))).collect()
    }

    /// Free nodes in and around the goal circle from which a clear straight way enters it, in rising order.
    pub fn goals(&self, problem: &Problem) -> Vec<Anchor> {
        let tail = TAIL_CELLS * self.grid.cell;
        let nodes = self.free_nodes(problem.goal, problem.goal_radius + tail);
        let near = nodes.map(|node| (node, self.grid.position(node))).filter(|(_, at)| problem.to_circle(*at) <= tail);
        let joined = near.filter(|(_, at)| problem.entry(*at).is_some());
        joined.map(|(node, at)| (node, problem.to_circle(at).max(0.0))).collect()
    }
}
