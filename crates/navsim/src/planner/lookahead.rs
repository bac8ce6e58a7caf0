//! Intermediate goals along paths: what a robot drives to when a planner knows the way.

use crate::error::{Error, Result, expect_length};
use crate::grown::{Point, apart};

/// Paths of many robots and how far each robot has come.
#[derive(Debug, Clone)]
pub struct Lookahead {
    /// The points of all paths, one path after the other.
    points: Vec<Point>,
    /// Length (m) of its path up to each point.
    lengths: Vec<f64>,
    /// Robot i follows `points[starts[i]..starts[i + 1]]`.
    starts: Vec<usize>,
    /// Centre of each robot's goal, m.
    goals: Vec<Point>,
    /// Length (m) along the path of the place next to each robot; never falls.
    progress: Vec<f64>,
    /// m.
    distance: f64,
}

impl Lookahead {
    /// Robot i is to follow `paths[i]` to `goals[i]`, towards the point `distance` (m, in (0, 1000]) ahead of it.
    ///
    /// # Errors
    /// Paths and goals of different number, a coordinate that is not finite, or a distance out of range.
    pub fn new(paths: &[Vec<Point>], goals: &[Point], distance: f64) -> Result<Self> {
        expect_length("goals", paths.len(), goals.len())?;
        if !(distance > 0.0 && distance <= 1000.0) {
            let expected = "a number in (0, 1000]".into();
            return Err(Error::Setting { key: "distance", value: distance.to_string(), expected });
        }
        finite("paths", paths.iter().enumerate().flat_map(|(robot, path)| path.iter().map(move |p| (robot, p))))?;
        finite("goals", goals.iter().enumerate())?;
        let (mut points, mut lengths, mut starts) = (Vec::new(), Vec::new(), vec![0]);
        for path in paths {
            let mut length = 0.0;
            for (i, point) in path.iter().enumerate() {
                length += if i > 0 { apart(path[i - 1], *point) } else { 0.0 };
                points.push(*point);
                lengths.push(length);
            }
            starts.push(points.len());
        }
        Ok(Self { points, lengths, starts, goals: goals.to_vec(), progress: vec![0.0; paths.len()], distance })
    }

    /// Number of robots.
    pub fn len(&self) -> usize {
        self.goals.len()
    }

    /// Whether there is no robot.
    pub fn is_empty(&self) -> bool {
        self.goals.is_empty()
    }

    /// How far (m) each robot has come along its path.
    pub fn progress(&self) -> &[f64] {
        &self.progress
    }

    /// Writes the intermediate goal of each robot at `positions` (m) to `targets`.
    ///
    /// The robot's place on its path is the point nearest to it between where it was and one look-ahead distance
    /// further on: it never goes back, and where the path crosses itself it does not jump. The target lies the
    /// look-ahead distance beyond, or is the goal itself where the path ends before; a robot without a path drives at
    /// its goal.
    ///
    /// # Errors
    /// A position that is not finite, or arrays of another length; nothing has changed then.
    pub fn update(&mut self, positions: &[Point], targets: &mut [Point]) -> Result<()> {
        for (name, got) in [("positions", positions.len()), ("targets", targets.len())] {
            expect_length(name, self.len(), got)?;
        }
        finite("positions", positions.iter().enumerate())?;
        for (robot, target) in targets.iter_mut().enumerate() {
            let range = self.starts[robot]..self.starts[robot + 1];
            let (points, lengths) = (&self.points[range.clone()], &self.lengths[range]);
            let progress = &mut self.progress[robot];
            *progress = nearest(points, lengths, *progress, self.distance, positions[robot]);
            *target = at(points, lengths, *progress + self.distance).unwrap_or(self.goals[robot]);
        }
        Ok(())
    }
}

fn finite<'a>(name: &'static str, points: impl Iterator<Item = (usize, &'a Point)>) -> Result<()> {
    for (robot, point) in points {
        if let Some(value) = point.iter().find(|value| !value.is_finite()) {
            return Err(Error::NotFinite { name, value: *value as f32, robot });
        }
    }
    Ok(())
}

/// Index of the piece of a path that holds the place at `length` (m): it ends at that point.
fn piece(lengths: &[f64], length: f64) -> usize {
    lengths.partition_point(|end| *end <= length).max(1)
}

/// Length (m) along the path of the point nearest to `position`, from `from` to `from + window`; of several the first.
fn nearest(points: &[Point], lengths: &[f64], from: f64, window: f64, position: Point) -> f64 {
    let (mut best, mut place) = (f64::INFINITY, from);
    for end in piece(lengths, from)..points.len() {
        let (a, b, before) = (points[end - 1], points[end], lengths[end - 1]);
        if before > from + window {
            break;
        }
        let whole = lengths[end] - before;
        let along = [b[0] - a[0], b[1] - a[1]];
        let offset = [position[0] - a[0], position[1] - a[1]];
        let foot = if whole > 0.0 { (offset[0] * along[0] + offset[1] * along[1]) / whole } else { 0.0 };
        let foot = foot.clamp((from - before).max(0.0), (from + window - before).min(whole));
        let share = if whole > 0.0 { foot / whole } else { 0.0 };
        let away = apart([a[0] + share * along[0], a[1] + share * along[1]], position);
        if away < best {
            (best, place) = (away, before + foot);
        }
    }
    place
}

/// The point of the path at `length` (m); `None` beyond its end.
fn at(points: &[Point], lengths: &[f64], length: f64) -> Option<Point> {
    let end = piece(lengths, length);
    if end >= points.len() {
        return None;
    }
    let (a, b) = (points[end - 1], points[end]);
    let share = (length - lengths[end - 1]) / (lengths[end] - lengths[end - 1]);
    Some([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])])
}
