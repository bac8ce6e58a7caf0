//! The true shortest path of a disc to a goal circle: the l of SPL (Anderson et al., "On evaluation of embodied
//! navigation agents", 2018).
//!
//! A shortest path around grown obstacles is a taut string. Whether there is one is decided exactly (`grown`). Fast
//! marching on a coarse grid then says for every place how far the goal is, up to a few percent (`lower_bound`), and A*
//! over the straight legs and arcs of taut strings, led by that field, finds the best one and its exact length
//! (`taut_string`). So neither the grid's resolution nor a gap narrower than a cell shows in the result.

mod lower_bound;
mod taut_string;

use crate::grown::{GoalDisc, GrownShape, GrownWorld, Point, along, apart, bounds};
use crate::world::Shape;
use lower_bound::{LowerBound, TRUST};
use taut_string::Search;

/// A start whose clearance is below the radius by no more than this (m) counts as free: single precision elsewhere in
/// the simulator cannot tell. The path is then found for a radius that is smaller by as much.
const SLACK: f64 = 1e-4;

/// Length (m) of the shortest curve from `start` to the disc of `goal_radius` (m, >= 0) about `goal` on which a disc of
/// `radius` (m, > 0) touches no shape; for a rectangle give its circumscribed radius. `shapes` must have passed
/// `Shape::validate`.
///
/// `None` if there is no such curve, if the start's clearance is below `radius` (by more than 1e-4 m), or if a number
/// is not finite. Zero if the start lies in the goal disc. The goal disc may be partly blocked: what can be reached
/// counts.
///
/// Error: that of rounding (1e-15 of the length in the analytic tests, 1e-9 m in the sum of all tolerances). A second
/// best way around the obstacles could be returned only where the marched distance is more than 2 % above the true one;
/// the most that was found is 0.11 %, and the same lengths came without that bound. Its grid takes 20 MB at
/// most; where a world is so large that its cells exceed a third of the radius (100 m for 0.25 m) the bound grows weak,
/// and the search slow rather than wrong.
pub fn shortest_path(shapes: &[Shape], radius: f64, start: Point, goal: Point, goal_radius: f64) -> Option<f64> {
    let numbers = [radius, start[0], start[1], goal[0], goal[1], goal_radius];
    if numbers.iter().any(|number| !number.is_finite()) || radius <= 0.0 {
        return None;
    }
    let obstacles = grow(shapes, radius);
    let clearance = obstacles.iter().fold(0.0, |nearest: f64, solid| nearest.min(solid.clearance(start)));
    if clearance < -SLACK {
        return None;
    }
    let radius = radius + clearance;
    let obstacles = if clearance < 0.0 { grow(shapes, radius) } else { obstacles };
    let straight = apart(start, goal) - goal_radius;
    if straight <= 0.0 {
        return Some(0.0);
    }
    let circle = along(start, goal, straight);
    if !obstacles.iter().any(|shape| shape.crosses(start, circle)) {
        return Some(straight);
    }
    around(obstacles, radius, start, goal, goal_radius, TRUST)
}

/// `shortest_path` where the straight line is blocked; `trust` is the share of the marched distance that is taken for a
/// lower bound, 0 for a search that is led by the straight distance alone.
pub(super) fn around(
    obstacles: Vec<GrownShape>,
    radius: f64,
    start: Point,
    goal: Point,
    goal_radius: f64,
    trust: f64,
) -> Option<f64> {
    let bounds = bounds(&obstacles, start, goal, goal_radius);
    let world = GrownWorld::new(obstacles, bounds);
    let joints = world.joints();
    let goal = GoalDisc::new(&world, &joints, start, goal, goal_radius)?;
    let lower = LowerBound::new(&world, &joints, &goal, bounds, radius, trust);
    Search::new(&world, &lower).run(start)
}

/// Whether the segment from `start` to `goal`, swept by a disc of `radius` (m, > 0), touches a shape.
pub fn needs_detour(shapes: &[Shape], radius: f64, start: Point, goal: Point) -> bool {
    grow(shapes, radius).iter().any(|shape| shape.clearance(start) < 0.0 || shape.crosses(start, goal))
}

fn grow(shapes: &[Shape], radius: f64) -> Vec<GrownShape> {
    shapes.iter().map(|shape| GrownShape::new(shape, radius)).collect()
}

#[cfg(test)]
pub(crate) mod tests;
