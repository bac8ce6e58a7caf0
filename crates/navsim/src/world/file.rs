//! A user's world file: shapes, the area of start and goal, and how many boxes are strewn in.

use super::json::{Object, number, numbers, refusal};
use super::shapes::{COORDINATE_MAX, Shape};
use crate::error::{Error, Result};

const KEYS: [&str; 2] = ["area", "random_boxes"];
const RANDOM_BOXES_KEYS: [&str; 3] = ["count", "sides", "clearance"];
/// Most random boxes.
const COUNT_MAX: usize = 1000;

/// A world as a file describes it. Without walls it is open.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldFile {
    /// What does not move.
    pub shapes: Vec<Shape>,
    /// Start and goal are drawn from [x0, y0, x1, y1], m.
    pub area: [f64; 4],
    /// Boxes that are drawn anew in every episode.
    pub random_boxes: Option<RandomBoxes>,
}

/// Boxes of uniform position within the area, uniform sides and uniform yaw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomBoxes {
    /// How many, 0 to 1,000.
    pub count: usize,
    /// Shortest and longest side (full length), m.
    pub sides: [f64; 2],
    /// Smallest distance of a box from the robot's centre at the start and from the goal, m.
    pub clearance: f64,
}

impl WorldFile {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// `Error::Setting` for a file that cannot be read, `Error::Parse` with the file, the key, its value and what was
    /// expected for its content.
    pub fn read(path: &str) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::Setting {
            key: "world.name",
            value: format!("'{path}'"),
            expected: format!("td3, boxes, open8 or a readable world file ({e})"),
        })?;
        Self::from_json(&text).map_err(|e| Error::Parse(format!("{path}: {e}")))
    }

    /// Reads the text of a world file.
    ///
    /// # Errors
    /// `Error::Parse` with the key, its value and what was expected.
    pub fn from_json(text: &str) -> Result<Self> {
        let object = Object::parse(text.strip_prefix('\u{feff}').unwrap_or(text), &KEYS)?;
        let (value, expected) = (object.require("area")?, "[x0, y0, x1, y1] with x0 < x1 and y0 < y1 within +-1000");
        let area: [f64; 4] = numbers("area", value, expected)?;
        if area[0] >= area[2] || area[1] >= area[3] || area.iter().any(|v| v.abs() > COORDINATE_MAX) {
            return Err(refusal("area", value, expected));
        }
        let random_boxes = object.object("random_boxes", &RANDOM_BOXES_KEYS)?;
        let random_boxes = random_boxes.map(|table| RandomBoxes::from_object(&table)).transpose()?;
        Ok(Self { shapes: object.shapes()?, area, random_boxes })
    }
}

impl RandomBoxes {
    fn from_object(table: &Object) -> Result<Self> {
        let named = |key: &'static str| -> Result<_> {
            Ok((format!("random_boxes.{key}"), table.require(key).map_err(|_| missing(key))?))
        };
        let (key, value) = named("count")?;
        let count = value.as_u64().and_then(|count| usize::try_from(count).ok()).filter(|count| *count <= COUNT_MAX);
        let count = count.ok_or_else(|| refusal(&key, value, "a whole number from 0 to 1000"))?;
        let (key, value) = named("sides")?;
        let expected = "[min, max] with 0.001 <= min <= max <= 100";
        let sides: [f64; 2] = numbers(&key, value, expected)?;
        if !(sides[0] >= 1e-3 && sides[0] <= sides[1] && sides[1] <= 100.0) {
            return Err(refusal(&key, value, expected));
        }
        let (key, value) = named("clearance")?;
        let clearance = number(&key, value, "a number in [0, 100]")?;
        if !(0.0..=100.0).contains(&clearance) {
            return Err(refusal(&key, value, "a number in [0, 100]"));
        }
        Ok(Self { count, sides, clearance })
    }
}

fn missing(key: &str) -> Error {
    Error::Parse(format!("key 'random_boxes.{key}' is missing"))
}
