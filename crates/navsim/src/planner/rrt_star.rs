//! RRT*: a random tree whose ways grow shorter with every sample.
//!
//! Karaman and Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 30, 2011. Once a path is known,
//! samples come from the ellipse of the places that a shorter one may visit (Gammell, Srinivasa and Barfoot, "Informed
//! RRT*", IROS 2014).

use super::budget::Budget;
use super::config::PlannerConfig;
use super::neighbours::Neighbours;
use super::problem::Problem;
use super::rrt::{sample, steer, way_to};
use crate::grown::{Point, apart};
use crate::rng::Stream;
use std::f64::consts::TAU;

/// Neighbours that are looked at, per logarithm of the number of points: above e (1 + 1/2), with which the ways become
/// optimal in the plane.
const REWIRED: f64 = 4.1;
/// End of a list of children.
const NONE: usize = usize::MAX;

/// The tree: points with their parents, children and lengths.
struct Tree<'a> {
    problem: &'a Problem,
    places: Neighbours,
    parents: Vec<usize>,
    /// Length (m) of the way from the start.
    lengths: Vec<f64>,
    first_child: Vec<usize>,
    next_sibling: Vec<usize>,
    /// Points from which a straight way leads into the goal circle, with its length (m).
    ends: Vec<(usize, f64)>,
}

/// The shortest path after all samples of the budget, or `None`. Its length never rises with more samples of one
/// stream.
pub(crate) fn rrt_star(
    problem: &Problem,
    config: &PlannerConfig,
    random: &mut Stream,
    budget: &mut Budget,
) -> Option<Vec<Point>> {
    let mut tree = Tree::new(problem);
    tree.add(problem.start, 0, 0.0, config.step);
    let mut near = Vec::new();
    let straight = problem.to_circle(problem.start);
    loop {
        let best = tree.best();
        // Nothing is shorter than the straight way.
        if best.is_some_and(|(_, length)| length <= straight) || !budget.spend() {
            break;
        }
        let sample = match best {
            Some((_, length)) => informed(problem, length, random),
            None => Some(sample(problem, config.goal_bias, random)),
        };
        let Some(sample) = sample else { continue };
        tree.places.closest(sample, 1, &mut near);
        let nearest = near[0].1;
        let Some(point) = steer(problem, tree.places.points()[nearest], sample, config.step) else { continue };
        let count = REWIRED * libm::log(tree.parents.len() as f64 + 1.0);
        tree.places.closest(point, count.ceil() as usize, &mut near);
        let number = tree.connect(point, nearest, &near, config.step);
        tree.rewire(number, &near);
    }
    let (number, _) = tree.best()?;
    let mut path = way_to(tree.places.points(), &tree.parents, number);
    path.push(problem.entry(path[path.len() - 1])?);
    Some(path)
}

/// A place from which a path through it could be shorter than `length` (m): uniform over the ellipse about start and
/// goal; `None` if it lies out of bounds.
fn informed(problem: &Problem, length: f64, random: &mut Stream) -> Option<Point> {
    let (start, goal) = (problem.start, problem.goal);
    let focal = apart(start, goal);
    // The path ends in the circle: its foci are start and goal, its sum of distances the length up to the centre.
    let sum = (length + problem.goal_radius).max(focal);
    let (major, minor) = (0.5 * sum, 0.5 * (sum * sum - focal * focal).sqrt());
    let (sin, cos) = libm::sincos(random.uniform(0.0, TAU));
    let radius = random.unit().sqrt();
    let (along, across) = (radius * major * cos, radius * minor * sin);
    let axis = [(goal[0] - start[0]) / focal, (goal[1] - start[1]) / focal];
    let point = [
        0.5 * (start[0] + goal[0]) + along * axis[0] - across * axis[1],
        0.5 * (start[1] + goal[1]) + along * axis[1] + across * axis[0],
    ];
    let [x0, y0, x1, y1] = problem.bounds;
    ((x0..=x1).contains(&point[0]) && (y0..=y1).contains(&point[1])).then_some(point)
}

impl<'a> Tree<'a> {
    fn new(problem: &'a Problem) -> Self {
        let places = Neighbours::new(problem.bounds);
        let (parents, lengths, ends) = (Vec::new(), Vec::new(), Vec::new());
        Self { problem, places, parents, lengths, first_child: Vec::new(), next_sibling: Vec::new(), ends }
    }

    /// Adds a point; the first is the root. A way into the goal circle from it may have `reach` (m).
    fn add(&mut self, point: Point, parent: usize, length: f64, reach: f64) -> usize {
        let number = self.places.push(point);
        self.parents.push(parent);
        self.lengths.push(length);
        self.first_child.push(NONE);
        self.next_sibling.push(NONE);
        if number != parent {
            self.adopt(number, parent);
        }
        let rest = self.problem.to_circle(point);
        if rest <= reach && self.problem.entry(point).is_some() {
            self.ends.push((number, rest.max(0.0)));
        }
        number
    }

    /// Adds `point` below that of the `near` points (distance, number) over which its way is shortest and clear; below
    /// `nearest`, from where it is clear, if that is none of them.
    fn connect(&mut self, point: Point, nearest: usize, near: &[(f64, usize)], reach: f64) -> usize {
        let over = |number: usize, away: f64| self.lengths[number] + away;
        let mut best = (over(nearest, apart(self.places.points()[nearest], point)), nearest);
        for &(away, number) in near {
            let shorter = over(number, away) < best.0;
            if shorter && self.problem.is_clear(self.places.points()[number], point) {
                best = (over(number, away), number);
            }
        }
        self.add(point, best.1, best.0, reach)
    }

    /// Leads the ways to the `near` points over the point `number` where that is shorter and clear.
    fn rewire(&mut self, number: usize, near: &[(f64, usize)]) {
        let point = self.places.points()[number];
        for &(away, other) in near {
            let length = self.lengths[number] + away;
            if length < self.lengths[other] && self.problem.is_clear(point, self.places.points()[other]) {
                self.leave(other);
                self.adopt(other, number);
                self.shorten(other, length);
            }
        }
    }

    fn adopt(&mut self, child: usize, parent: usize) {
        self.parents[child] = parent;
        self.next_sibling[child] = self.first_child[parent];
        self.first_child[parent] = child;
    }

    /// Takes a point out of the list of its parent's children.
    fn leave(&mut self, child: usize) {
        let parent = self.parents[child];
        let mut at = self.first_child[parent];
        if at == child {
            self.first_child[parent] = self.next_sibling[child];
            return;
        }
        while self.next_sibling[at] != child {
            at = self.next_sibling[at];
        }
        self.next_sibling[at] = self.next_sibling[child];
    }

    /// Gives a point and all below it their new lengths.
    fn shorten(&mut self, number: usize, length: f64) {
        self.lengths[number] = length;
        let mut below = vec![number];
        while let Some(parent) = below.pop() {
            let mut child = self.first_child[parent];
            while child != NONE {
                let points = self.places.points();
                self.lengths[child] = self.lengths[parent] + apart(points[parent], points[child]);
                below.push(child);
                child = self.next_sibling[child];
            }
        }
    }

    /// The point over which a path is shortest, and its length (m) to the end.
    fn best(&self) -> Option<(usize, f64)> {
        let whole = self.ends.iter().map(|(number, rest)| (*number, self.lengths[*number] + rest));
        whole.min_by(|a, b| a.1.total_cmp(&b.1))
    }
}
