//! What is done to a path once it is found: cut at the goal circle, pulled tight, divided evenly.

use super::problem::Problem;
use crate::grown::{Point, along, apart};

/// Pieces into which a path is divided before points are joined straight.
const PIECES: f64 = 200.0;
/// Most times that all corners are cut.
const PASSES: usize = 40;
/// Share of the length that a corner must win to be cut, and a pass for another one.
const WIN: f64 = 1e-5;
/// Smallest share of its two sides at which a corner is cut.
const CUT_MIN: f64 = 0.01;

/// Length (m) of a path.
pub(crate) fn length(path: &[Point]) -> f64 {
    path.windows(2).map(|pair| apart(pair[0], pair[1])).sum()
}

/// Ends the path where it first enters the goal circle.
pub(crate) fn cut(problem: &Problem, path: &mut Vec<Point>) {
    let Some(inside) = path.iter().position(|point| problem.to_circle(*point) <= 0.0) else { return };
    path.truncate(inside + 1);
    if inside > 0 {
        path[inside] = entry(path[inside - 1], path[inside], problem.goal, problem.goal_radius);
    }
}

/// Where the line from `outside` to `inside` meets the circle about `center`.
fn entry(outside: Point, inside: Point, center: Point, radius: f64) -> Point {
    let (whole, offset) = (apart(outside, inside), [outside[0] - center[0], outside[1] - center[1]]);
    let unit = [(inside[0] - outside[0]) / whole, (inside[1] - outside[1]) / whole];
    let middle = -(unit[0] * offset[0] + unit[1] * offset[1]);
    let square = radius * radius - (offset[0] * offset[0] + offset[1] * offset[1] - middle * middle);
    // The far end is within the circle, whatever rounding says.
    along(outside, inside, (middle - square.max(0.0).sqrt()).clamp(0.0, whole))
}

/// Shortens a path by straight lines that keep the clearance, up to where it is taut. Start and goal stay.
///
/// A path that can be led on to the goal's centre is pulled tight towards that: the shortest way into a circle points
/// at its centre.
pub(crate) fn pull_tight(problem: &Problem, path: &mut Vec<Point>) {
    if let Some(end) = path.last().copied().filter(|end| apart(*end, problem.goal) > 0.0)
        && problem.is_clear(end, problem.goal)
    {
        path.push(problem.goal);
    }
    for _ in 0..2 {
        *path = skip(problem, &divide(path, length(path) / PIECES));
        path.reverse();
    }
    let mut before = length(path);
    for _ in 0..PASSES {
        *path = cut_corners(problem, path, WIN * before);
        let now = length(path);
        if now > (1.0 - WIN) * before {
            break;
        }
        before = now;
    }
    cut(problem, path);
}

/// Cuts every corner straight across, as deep as is clear, where that wins `least` (m): that of a taut path lies at an
/// obstacle.
fn cut_corners(problem: &Problem, path: &[Point], least: f64) -> Vec<Point> {
    let mut cut = vec![path[0]];
    for pair in path[1..].windows(2) {
        let (from, corner, to) = (cut[cut.len() - 1], pair[0], pair[1]);
        if problem.is_clear(from, to) {
            continue;
        }
        let between = |point: Point, share: f64| {
            [corner[0] + share * (point[0] - corner[0]), corner[1] + share * (point[1] - corner[1])]
        };
        let mut share = 0.5;
        while share > CUT_MIN && !problem.is_clear(between(from, share), between(to, share)) {
            share *= 0.5;
        }
        let across = [between(from, share), between(to, share)];
        if share > CUT_MIN && share * length(&[from, corner, to]) - length(&across) > least {
            cut.extend(across);
        } else {
            cut.push(corner);
        }
    }
    cut.push(path[path.len() - 1]);
    cut
}

/// From every point straight to the last one that it can be joined with.
fn skip(problem: &Problem, path: &[Point]) -> Vec<Point> {
    let (mut at, last) = (0, path.len() - 1);
    let mut kept = vec![path[0]];
    while at < last {
        at = (at + 2..=last).rev().find(|next| problem.is_clear(path[at], path[*next])).unwrap_or(at + 1);
        kept.push(path[at]);
    }
    kept
}

/// The same path with points at most `spacing` (m, > 0) apart, evenly within each of its straight pieces; its corners
/// stay, so that it touches nothing new.
pub(crate) fn divide(path: &[Point], spacing: f64) -> Vec<Point> {
    let mut points = vec![path[0]];
    for pair in path.windows(2) {
        let count = (apart(pair[0], pair[1]) / spacing).ceil().max(1.0);
        let between = |step: usize| {
            let share = step as f64 / count;
            [pair[0][0] + share * (pair[1][0] - pair[0][0]), pair[0][1] + share * (pair[1][1] - pair[0][1])]
        };
        points.extend((1..count as usize).map(between));
        points.push(pair[1]);
    }
    points
}
