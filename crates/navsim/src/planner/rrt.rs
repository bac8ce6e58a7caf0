//! Rapidly exploring random tree: the first path that random samples find.
//!
//! LaValle, "Rapidly-exploring random trees: a new tool for path planning", Iowa State University TR 98-11, 1998.

use super::budget::Budget;
use super::config::PlannerConfig;
use super::neighbours::Neighbours;
use super::problem::Problem;
use crate::grown::{Point, along, apart};
use crate::rng::Stream;

/// Grows a tree from the start, by at most `step` (m) towards every sample, until a straight way of at most `step`
/// leads from a new point into the goal circle. `None` if the budget is spent first.
pub(crate) fn rrt(
    problem: &Problem,
    config: &PlannerConfig,
    random: &mut Stream,
    budget: &mut Budget,
) -> Option<Vec<Point>> {
    let mut tree = Neighbours::new(problem.bounds);
    let (mut parents, mut near) = (vec![0], Vec::new());
    tree.push(problem.start);
    if problem.to_circle(problem.start) <= config.step
        && let Some(end) = problem.entry(problem.start)
    {
        return Some(vec![problem.start, end]);
    }
    while budget.spend() {
        let sample = sample(problem, config.goal_bias, random);
        tree.closest(sample, 1, &mut near);
        let nearest = near[0].1;
        let Some(point) = steer(problem, tree.points()[nearest], sample, config.step) else { continue };
        let number = tree.push(point);
        parents.push(nearest);
        if problem.to_circle(point) <= config.step
            && let Some(end) = problem.entry(point)
        {
            let mut path = way_to(tree.points(), &parents, number);
            path.push(end);
            return Some(path);
        }
    }
    None
}

/// The goal with probability `bias`, else a place uniform over the bounds.
pub(crate) fn sample(problem: &Problem, bias: f64, random: &mut Stream) -> Point {
    let [x0, y0, x1, y1] = problem.bounds;
    if random.unit() < bias { problem.goal } else { [random.uniform(x0, x1), random.uniform(y0, y1)] }
}

/// The place at most `step` (m) from `from` towards `sample`, if the way is clear and not of length 0.
pub(crate) fn steer(problem: &Problem, from: Point, sample: Point, step: f64) -> Option<Point> {
    let away = apart(from, sample);
    let point = if away > step { along(from, sample, step) } else { sample };
    (away > 0.0 && problem.is_clear(from, point)).then_some(point)
}

/// Points from the root, which is its own parent, to the point of that number.
pub(crate) fn way_to(points: &[Point], parents: &[usize], mut number: usize) -> Vec<Point> {
    let mut path = vec![points[number]];
    while parents[number] != number {
        number = parents[number];
        path.push(points[number]);
    }
    path.reverse();
    path
}
