//! The way down a field of distances: a path from any place to the goal of a march.

use super::occupancy::{Map, TAIL_CELLS};
use super::problem::Problem;
use crate::grown::{Field, Point, along, apart};

/// Length of a step against the gradient, in cells.
const STEP: f64 = 0.5;
/// Share of its length by which a step must bring the goal nearer.
const DESCENT: f64 = 0.5;

/// The path from the problem's start down `field`, which was marched on `map` from the goal; `None` if the start cannot
/// be joined to a node that was reached.
pub(crate) fn descend(problem: &Problem, map: &Map, field: &Field) -> Option<Vec<Point>> {
    let tail = TAIL_CELLS * map.grid.cell;
    let (mut point, mut value) = (problem.start, f64::INFINITY);
    let mut path = vec![point];
    loop {
        if problem.to_circle(point) <= tail
            && let Some(end) = problem.entry(point)
        {
            path.push(end);
            return Some(path);
        }
        (point, value) = step(problem, field, point).or_else(|| hop(problem, map, field, point, value))?;
        path.push(point);
    }
}

/// A short step against the gradient, if the field is known there and says that it leads nearer.
fn step(problem: &Problem, field: &Field, point: Point) -> Option<(Point, f64)> {
    let length = STEP * field.grid().cell;
    let here = field.at(point);
    let slope = [
        field.at([point[0] + length, point[1]]) - field.at([point[0] - length, point[1]]),
        field.at([point[0], point[1] + length]) - field.at([point[0], point[1] - length]),
    ];
    if !(slope[0].is_finite() && slope[1].is_finite()) {
        return None;
    }
    let next = along(point, [point[0] - slope[0], point[1] - slope[1]], length);
    let there = field.at(next);
    (there < here - DESCENT * length && problem.is_clear(point, next)).then_some((next, there))
}

/// To the node around `point` over which the goal is nearest, among those that are nearer than `value` (m). There
/// always is one where a march came: the whole of a cell between four free nodes is free.
fn hop(problem: &Problem, map: &Map, field: &Field, point: Point, value: f64) -> Option<(Point, f64)> {
    let nodes = map.around(problem, point).into_iter().map(|(node, away)| (node, away, field.distances()[node]));
    let lower = nodes.filter(|(_, _, distance)| *distance < value);
    let (node, _, distance) = lower.min_by(|a, b| (a.1 + a.2).total_cmp(&(b.1 + b.2)))?;
    let next = map.grid.position(node);
    debug_assert!(apart(point, next) < 5.0 * map.grid.cell);
    Some((next, distance))
}
