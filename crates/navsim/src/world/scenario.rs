//! A scenario as a value: where the robot starts, where it shall go and what stands in the way.

use super::distance::{Solid, Solids};
use super::free_space::is_reachable;
use super::json::{Object, number, numbers, refusal, write_number, write_numbers, write_shapes};
use super::shapes::{COORDINATE_MAX, Shape};
use crate::error::{Error, Result};
use crate::pose::Pose;
use crate::robot::Footprint;

const KEYS: [&str; 5] = ["start", "goal", "goal_radius", "time_limit", "shortest"];
/// Clearance (m) below which a footprint counts as in contact: what single precision resolves in a step.
const START_MARGIN: f64 = 1e-4;
/// Largest radius of a goal, m.
const GOAL_RADIUS_MAX: f64 = 100.0;
/// Longest episode, s: as many control periods of the longest kind as a task may have.
const TIME_LIMIT_MAX: f64 = 1e7;

/// One task for one robot. A scenario without walls is open.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Pose of the robot at the beginning (m, rad).
    pub start: Pose,
    /// Centre of the goal, m.
    pub goal: [f64; 2],
    /// The goal is reached below this distance of the robot's centre, m, in (0, 100].
    pub goal_radius: f64,
    /// Longest episode, s, in (0, 1e7].
    pub time_limit: f64,
    /// What stands in the way.
    pub shapes: Vec<Shape>,
    /// Length (m, >= 0) of the shortest way of the centre to the goal's circle, where it is known.
    pub shortest: Option<f64>,
}

impl Scenario {
    /// Reads one line of a scenario list. The shapes come in the order circles, boxes, segments, polygons.
    ///
    /// # Errors
    /// `Error::Parse` with the key, its value and what was expected: no JSON object, an unknown, repeated or missing
    /// key, a number out of range, a degenerate shape.
    pub fn from_json(line: &str) -> Result<Self> {
        let object = Object::parse(line, &KEYS)?;
        let [x, y, yaw] = numbers("start", object.require("start")?, "[x, y, yaw]")?;
        let goal = numbers("goal", object.require("goal")?, "[x, y]")?;
        let positive = |key: &str, max: f64| {
            let (value, expected) = (object.require(key)?, format!("a number in (0, {max}]"));
            let number = number(key, value, &expected)?;
            if number > 0.0 && number <= max { Ok(number) } else { Err(refusal(key, value, &expected)) }
        };
        let scenario = Self {
            start: Pose::new(x, y, yaw),
            goal,
            goal_radius: positive("goal_radius", GOAL_RADIUS_MAX)?,
            time_limit: positive("time_limit", TIME_LIMIT_MAX)?,
            shortest: object.get("shortest").map(|v| number("shortest", v, "a number >= 0")).transpose()?,
            shapes: object.shapes()?,
        };
        scenario.validate()?;
        Ok(scenario)
    }

    /// Writes the scenario as one line of a list, without a line break; kinds of shapes that do not occur are left out.
    /// Every number, yaw included, is the shortest text that reads back to the same value.
    pub fn to_json(&self) -> String {
        let mut text = String::from("{\"start\":");
        write_numbers(&mut text, &[self.start.x, self.start.y, self.start.yaw]);
        text.push_str(",\"goal\":");
        write_numbers(&mut text, &self.goal);
        for (key, value) in [("goal_radius", Some(self.goal_radius)), ("time_limit", Some(self.time_limit))]
            .into_iter()
            .chain([("shortest", self.shortest)])
        {
            if let Some(value) = value {
                text.push_str(&format!(",\"{key}\":"));
                write_number(&mut text, value);
            }
        }
        write_shapes(&mut text, &self.shapes);
        text.push('}');
        text
    }

    /// Checks every number, without regard to a robot.
    ///
    /// # Errors
    /// `Error::Scenario` or `Error::Shape` with the first number that is out of range.
    pub fn validate(&self) -> Result<()> {
        let refuse = |key: &str, value: f64, expected: String| {
            Err(Error::Scenario(format!("{key} = {value}: expected {expected}")))
        };
        let Pose { x, y, yaw } = self.start;
        for (key, value) in [("start", x), ("start", y), ("start", yaw), ("goal", self.goal[0]), ("goal", self.goal[1])]
        {
            if !value.is_finite() || value.abs() > COORDINATE_MAX {
                return refuse(key, value, format!("numbers within +-{COORDINATE_MAX}"));
            }
        }
        for (key, value, max) in
            [("goal_radius", self.goal_radius, GOAL_RADIUS_MAX), ("time_limit", self.time_limit, TIME_LIMIT_MAX)]
        {
            if !(value > 0.0 && value <= max) {
                return refuse(key, value, format!("a number in (0, {max}]"));
            }
        }
        if let Some(shortest) = self.shortest.filter(|length| !(length.is_finite() && *length >= 0.0)) {
            return refuse("shortest", shortest, "a number >= 0".into());
        }
        self.shapes.iter().try_for_each(Shape::validate)
    }

    /// Checks that a robot of this `footprint` can run the scenario: it starts without contact, its centre can stand in
    /// the goal, and there is a way. A start within the goal is allowed. A passage that only just fits, within about 5
    /// % of the footprint's smaller radius, is taken as open.
    ///
    /// # Errors
    /// `Error::Scenario` or `Error::Shape` with the clearance or the number that is at fault.
    pub fn check(&self, footprint: &Footprint) -> Result<()> {
        self.validate()?;
        let solids = Solids::new(&self.shapes);
        self.check_start(footprint, &solids)?;
        let (inner, outer) = (inscribed_radius(footprint), footprint.circumscribed_radius());
        let start = [self.start.x, self.start.y];
        let standing_room = solids.distance(self.goal);
        if standing_room < inner {
            return Err(Error::Scenario(format!(
                "goal [{}, {}] cannot be stood on: its centre has a clearance of {standing_room:.4} m, the robot needs \
                 {inner:.4} m",
                self.goal[0], self.goal[1]
            )));
        }
        if !is_reachable(&solids, start, self.goal, inner, outer) {
            return Err(Error::Scenario(format!(
                "goal [{}, {}] is unreachable from [{}, {}] for a robot of radius {inner:.4} m",
                self.goal[0], self.goal[1], start[0], start[1]
            )));
        }
        Ok(())
    }

    fn check_start(&self, footprint: &Footprint, solids: &Solids) -> Result<()> {
        let clearance = clearance(solids, footprint, &self.start);
        if clearance < START_MARGIN {
            return Err(Error::Scenario(format!(
                "start [{}, {}, {}] is in contact: the footprint's clearance is {clearance:.4} m, expected at least \
                 {START_MARGIN} m",
                self.start.x, self.start.y, self.start.yaw
            )));
        }
        Ok(())
    }
}

/// Radius (m) of the largest disc about the centre within the footprint.
fn inscribed_radius(footprint: &Footprint) -> f64 {
    match footprint {
        Footprint::Disc { radius } => *radius,
        Footprint::Rectangle { length, width } => 0.5 * length.min(*width),
    }
}

/// Distance (m) between the footprint at `pose` and the nearest solid, 0 in contact; infinite without solids.
fn clearance(solids: &Solids, footprint: &Footprint, pose: &Pose) -> f64 {
    match *footprint {
        Footprint::Disc { radius } => (solids.distance([pose.x, pose.y]) - radius).max(0.0),
        Footprint::Rectangle { length, width } => {
            let (sin, cos) = libm::sincos(pose.yaw);
            let robot = Solid::turned_box([pose.x, pose.y], [cos, sin], 0.5 * length, 0.5 * width);
            solids.all.iter().fold(f64::INFINITY, |d, solid| d.min(robot.distance_to(solid)))
        }
    }
}

/// A scenario list after every line has been read and checked.
#[derive(Debug, Clone, Default)]
pub struct ScenarioList {
    /// What can be run, in order.
    pub scenarios: Vec<Scenario>,
    /// Line number, from 1, of each scenario.
    pub lines: Vec<usize>,
    /// Why each of the other lines is refused: `Error::Line`.
    pub refused: Vec<Error>,
}

impl ScenarioList {
    /// Reads a list (JSON Lines), checks every scenario for this `footprint`, and keeps refusals beside the rest.
    /// Blank lines, carriage returns and a byte order mark are passed over.
    pub fn read(text: &str, footprint: &Footprint) -> Self {
        let mut list = Self::default();
        for (line, scenario) in read_lines(text) {
            match scenario.and_then(|scenario| scenario.check(footprint).map(|()| scenario)) {
                Ok(scenario) => {
                    list.scenarios.push(scenario);
                    list.lines.push(line);
                }
                Err(error) => list.refused.push(at_line(line, &error)),
            }
        }
        list
    }
}

fn at_line(line: usize, error: &Error) -> Error {
    Error::Line { line, reason: error.to_string() }
}

fn read_lines(text: &str) -> impl Iterator<Item = (usize, Result<Scenario>)> {
    let lines = text.strip_prefix('\u{feff}').unwrap_or(text).lines().enumerate();
    lines.filter(|(_, line)| !line.trim().is_empty()).map(|(i, line)| (i + 1, Scenario::from_json(line)))
}
