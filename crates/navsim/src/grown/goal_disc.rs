//! The disc that a path ends at, and the pieces of its border that can be reached.

use super::enclosure::cut_off;
use super::grid::Grid;
use super::points::{Point, along, apart, sweep};
use super::world::{GrownWorld, Joint};
use std::f64::consts::TAU;

/// A goal disc of which at least one point can be reached from the start.
#[derive(Debug)]
pub(crate) struct GoalDisc {
    pub center: Point,
    /// m, >= 0.
    pub radius: f64,
    /// Pieces of its border that are free and not cut off from the start: first angle and extent, rad.
    arcs: Vec<[f64; 2]>,
}

impl GoalDisc {
    /// The disc of `radius` (m) about `center`; `None` if all of its border is blocked or cut off from `start`, which
    /// lies outside.
    pub fn new(world: &GrownWorld, joints: &[Joint], start: Point, center: Point, radius: f64) -> Option<Self> {
        let mut disc = Self::free(world, center, radius);
        let middles: Vec<Point> = disc.arcs.iter().map(|arc| disc.middle(arc)).collect();
        let mut cut = cut_off(world, joints, start, &middles).into_iter();
        disc.arcs.retain(|_| cut.next() == Some(false));
        (!disc.is_blocked()).then_some(disc)
    }

    /// The disc of `radius` (m) about `center`, with all of its border that is free.
    pub fn free(world: &GrownWorld, center: Point, radius: f64) -> Self {
        let mut angles = if radius > 0.0 { world.crossings(center, radius) } else { Vec::new() };
        angles.iter_mut().for_each(|angle| *angle = sweep(0.0, *angle, 1.0));
        angles.sort_by(f64::total_cmp);
        let mut arcs: Vec<[f64; 2]> = angles.windows(2).map(|pair| [pair[0], pair[1] - pair[0]]).collect();
        match (angles.first(), angles.last()) {
            (Some(first), Some(last)) => arcs.push([*last, first + TAU - last]),
            _ => arcs.push([0.0, TAU]),
        }
        let mut disc = Self { center, radius, arcs };
        disc.arcs = disc.arcs.iter().copied().filter(|arc| world.is_free(disc.middle(arc))).collect();
        disc
    }

    /// Whether no piece of its border is left.
    pub fn is_blocked(&self) -> bool {
        self.arcs.is_empty()
    }

    fn at(&self, angle: f64) -> Point {
        let (sin, cos) = libm::sincos(angle);
        [self.center[0] + self.radius * cos, self.center[1] + self.radius * sin]
    }

    fn middle(&self, arc: &[f64; 2]) -> Point {
        self.at(arc[0] + 0.5 * arc[1])
    }

    /// Straight distance (m) from `point`, negative inside.
    pub fn distance(&self, point: Point) -> f64 {
        apart(point, self.center) - self.radius
    }

    /// Points where a path may end that does not run straight at the centre: there the border meets an obstacle.
    pub fn ends(&self) -> Vec<Point> {
        self.arcs.iter().flat_map(|[from, extent]| [self.at(*from), self.at(from + extent)]).collect()
    }

    /// Nodes near the disc with their distance (m) from it: those around its border, and those that see it.
    pub fn sources(&self, world: &GrownWorld, grid: &Grid) -> Vec<(usize, f64)> {
        let mut sources = Vec::new();
        for [from, extent] in &self.arcs {
            let count = (2.0 * self.radius * extent / grid.cell).ceil() as usize + 1;
            for step in 0..=count {
                let node = grid.below(self.at(from + extent * step as f64 / count as f64));
                let around = [node, node + 1, node + grid.columns, node + grid.columns + 1];
                sources.extend(around.map(|node| (node, self.distance(grid.position(node)).max(0.0))));
            }
        }
        let [x, y] = self.center;
        let reach = self.radius + 4.0 * grid.cell;
        let [columns, rows] = grid.window([x - reach, y - reach, x + reach, y + reach]);
        for node in rows.flat_map(|row| columns.clone().map(move |column| row * grid.columns + column)) {
            let point = grid.position(node);
            let nearest = along(self.center, point, self.radius);
            if world.is_free(point) && world.is_free(nearest) && world.segment_is_free(point, nearest) {
                sources.push((node, self.distance(point).max(0.0)));
            }
        }
        sources
    }
}
