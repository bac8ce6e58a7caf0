//! How far the goal is from every place, up to a few percent: what leads the search for the exact path.

use crate::grown::{Corner, Field, GoalDisc, Grid, GrownWorld, Joint, Point};

/// Cells of the marching grid per radius.
const CELLS_PER_RADIUS: f64 = 3.0;
/// Most nodes of the marching grid: 105 m x 105 m for a radius of 0.25 m; larger worlds get larger cells, which costs
/// time, not accuracy.
const NODES_MAX: f64 = 1.6e6;
/// Cells by which obstacles shrink on the marching grid. From the square root of 2 on, the four nodes around every
/// place that the robot may take are free; at 2 the march also runs straight through a corridor without any play: at
/// any angle it is then long by 0.1 % at most, at 1.5 by up to 4 %.
const SHRINK: f64 = 2.0;
/// Largest cell, in radii, for which overlapping obstacles are joined on the marching grid. Where a taut path bends it
/// is at least 0.73 radii (the corners form an equilateral triangle) away from the joint; the nodes around it are
/// within 1.42 cells of it, those of the joint within 0.71 cells.
const JOINED: f64 = 0.34;
/// Share of the marched distance that is trusted as a lower bound: the march was never long by more than 0.11 %, in
/// corridors without play, and not at all in 3,600 random worlds.
pub(super) const TRUST: f64 = 0.98;

/// Cells by which interpolation overestimates the distance near a goal disc that is smaller than a cell.
const TIP: f64 = 0.5;

/// Lower bounds of the distance to a goal disc.
#[derive(Debug)]
pub(super) struct LowerBound<'a> {
    pub goal: &'a GoalDisc,
    field: Field,
    trust: f64,
}

impl<'a> LowerBound<'a> {
    /// Marches from `goal` over the whole of `bounds` ([x0, y0, x1, y1], m) for a robot of `radius` (m).
    ///
    /// Obstacles are 2 cells thinner than they are, so that no gap is lost to the grid; those that overlap are joined
    /// by a row of nodes, so that no gap is won.
    pub fn new(
        world: &GrownWorld,
        joints: &[Joint],
        goal: &'a GoalDisc,
        bounds: [f64; 4],
        radius: f64,
        trust: f64,
    ) -> Self {
        let area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]);
        let grid = Grid::around(bounds, (radius / CELLS_PER_RADIUS).max((area / NODES_MAX).sqrt()));
        let shrink = SHRINK * grid.cell;
        let mut blocked = vec![false; grid.len()];
        if grid.cell <= JOINED * radius {
            joints.iter().for_each(|joint| block_line(&grid, &mut blocked, joint.from, joint.to));
        }
        for shape in world.shapes() {
            let [x0, y0, x1, y1] = shape.bounds();
            let [columns, rows] = grid.window([x0 + shrink, y0 + shrink, x1 - shrink, y1 - shrink]);
            for row in rows {
                for node in columns.clone().map(|column| row * grid.columns + column) {
                    blocked[node] = blocked[node] || shape.clearance(grid.position(node)) < -shrink;
                }
            }
        }
        Self { goal, field: Field::march(grid, &blocked, &goal.sources(world, &grid)), trust }
    }

    /// Distance between the nodes of the grid, m.
    pub fn cell(&self) -> f64 {
        self.field.grid().cell
    }

    /// Lower bound of the distance (m) from `point` to the goal disc.
    pub fn remaining(&self, point: Point) -> f64 {
        self.larger(self.goal.distance(point), self.field.at(point))
    }

    /// Lower bound of the distance (m) to the goal disc from every point of the arc about `corner`.
    pub fn remaining_from(&self, corner: &Corner) -> f64 {
        let (grid, [x, y]) = (self.field.grid(), corner.center);
        let reach = corner.reach + grid.cell;
        let [columns, rows] = grid.window([x - reach, y - reach, x + reach, y + reach]);
        let nodes = rows.flat_map(|row| &self.field.distances()[row * grid.columns..][columns.clone()]);
        let marched = nodes.fold(f64::INFINITY, |least: f64, distance| least.min(*distance));
        self.larger(self.goal.distance(corner.center) - corner.reach, marched)
    }

    /// Where the march did not come, only the straight distance is known.
    fn larger(&self, straight: f64, marched: f64) -> f64 {
        if marched.is_finite() { straight.max(self.trust * (marched - TIP * self.cell())) } else { straight }
    }
}

/// Blocks the nodes along the segment `a`-`b`, within 0.71 cells of it, so that no chain of neighbours crosses it.
fn block_line(grid: &Grid, blocked: &mut [bool], a: Point, b: Point) {
    let steps = ((b[0] - a[0]).abs().max((b[1] - a[1]).abs()) / grid.cell).ceil();
    let node = |at: f64, origin: f64| ((at - origin) / grid.cell).round() as usize;
    for step in 0..=steps as usize {
        let share = if steps > 0.0 { step as f64 / steps } else { 0.0 };
        let (x, y) = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]));
        blocked[node(y, grid.origin[1]) * grid.columns + node(x, grid.origin[0])] = true;
    }
}
