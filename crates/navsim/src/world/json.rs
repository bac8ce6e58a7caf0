//! Shapes and numbers as JSON: read with refusals that name the key and the value, written as short as they read back.

use super::shapes::Shape;
use crate::error::{Error, Result};
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;
use std::fmt::{self, Write as _};

/// Keys of the shapes, in the order in which they are written.
pub(crate) const SHAPE_KEYS: [&str; 4] = ["circles", "boxes", "segments", "polygons"];
/// Most shapes of one world.
const SHAPES_MAX: usize = 100_000;
/// Longest part of a refused value that is repeated in a message.
const VALUE_SHOWN: usize = 60;

/// The entries of a JSON object, in order, repeated keys included.
pub(crate) struct Object {
    entries: Vec<(String, Value)>,
}

impl<'de> Deserialize<'de> for Object {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = Object;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a JSON object")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Object, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Object { entries })
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

impl Object {
    /// Reads an object whose keys are all among `known` or the keys of shapes, each at most once.
    pub fn parse(text: &str, known: &[&str]) -> Result<Self> {
        let object: Self = serde_json::from_str(text).map_err(|e| Error::Parse(format!("not a JSON object: {e}")))?;
        let mut valid = known.to_vec();
        valid.extend(SHAPE_KEYS);
        object.check_keys("", &valid)?;
        Ok(object)
    }

    /// The object under `key`, whose keys are all among `known`.
    pub fn object(&self, key: &str, known: &[&str]) -> Result<Option<Self>> {
        match self.get(key) {
            None => Ok(None),
            Some(Value::Object(map)) => {
                let object = Self { entries: map.iter().map(|(k, v)| (k.clone(), v.clone())).collect() };
                object.check_keys(&format!("{key}."), known)?;
                Ok(Some(object))
            }
            Some(other) => Err(refusal(key, other, "an object")),
        }
    }

    fn check_keys(&self, prefix: &str, known: &[&str]) -> Result<()> {
        for (i, (key, _)) in self.entries.iter().enumerate() {
            if !known.contains(&key.as_str()) {
                let nearest = known.iter().min_by_key(|k| edit_distance(key, k)).copied().unwrap_or_default();
                return Err(Error::Parse(format!(
                    "unknown key '{prefix}{key}' (nearest: '{nearest}'): expected {}",
                    known.join(", ")
                )));
            }
            if self.entries[..i].iter().any(|(earlier, _)| earlier == key) {
                return Err(Error::Parse(format!("key '{prefix}{key}' stands twice: expected once")));
            }
        }
        Ok(())
    }

    /// The value under `key`.
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.entries.iter().find(|(k, _)| k == key).map(|(_, value)| value)
    }

    /// The value under a key that must be there.
    pub fn require(&self, key: &str) -> Result<&Value> {
        self.get(key).ok_or_else(|| Error::Parse(format!("key '{key}' is missing")))
    }

    /// All shapes: circles, boxes, segments, polygons, each valid.
    pub fn shapes(&self) -> Result<Vec<Shape>> {
        let mut shapes = Vec::new();
        for key in SHAPE_KEYS {
            let Some(value) = self.get(key) else { continue };
            let items = value.as_array().ok_or_else(|| refusal(key, value, "a list"))?;
            if shapes.len() + items.len() > SHAPES_MAX {
                return Err(Error::Parse(format!("more than {SHAPES_MAX} shapes")));
            }
            for (i, item) in items.iter().enumerate() {
                shapes.push(shape(key, item).map_err(|e| Error::Parse(format!("{key}[{i}]: {e}")))?);
            }
        }
        Ok(shapes)
    }
}

fn shape(kind: &str, value: &Value) -> Result<Shape> {
    let shape = match kind {
        "circles" => {
            let [x, y, radius] = numbers("circle", value, "[x, y, radius]")?;
            Shape::Circle { center: [x, y], radius }
        }
        "boxes" => {
            let [x, y, yaw, length, width] = numbers("box", value, "[x, y, yaw, length, width]")?;
            Shape::Box { center: [x, y], yaw, length, width }
        }
        "segments" => {
            let [x1, y1, x2, y2] = numbers("segment", value, "[x1, y1, x2, y2]")?;
            Shape::Segment { a: [x1, y1], b: [x2, y2] }
        }
        _ => {
            let corners = value.as_array().ok_or_else(|| refusal("polygon", value, "a list of [x, y]"))?;
            return Shape::polygon(corners.iter().map(|c| numbers("corner", c, "[x, y]")).collect::<Result<_>>()?);
        }
    };
    shape.validate()?;
    Ok(shape)
}

/// A refusal that names the key, the value and what was expected.
pub(crate) fn refusal(key: &str, value: &Value, expected: &str) -> Error {
    let mut text = value.to_string();
    if text.chars().count() > VALUE_SHOWN {
        text = text.chars().take(VALUE_SHOWN).chain("...".chars()).collect();
    }
    Error::Parse(format!("{key} = {text}: expected {expected}"))
}

/// The number `value`, called `key`.
pub(crate) fn number(key: &str, value: &Value, expected: &str) -> Result<f64> {
    value.as_f64().filter(|number| number.is_finite()).ok_or_else(|| refusal(key, value, expected))
}

/// The N numbers in the list `value`, called `key`.
pub(crate) fn numbers<const N: usize>(key: &str, value: &Value, expected: &str) -> Result<[f64; N]> {
    let list = value.as_array().filter(|list| list.len() == N).ok_or_else(|| refusal(key, value, expected))?;
    let mut numbers = [0.0; N];
    for (number, item) in numbers.iter_mut().zip(list) {
        *number = item.as_f64().filter(|n| n.is_finite()).ok_or_else(|| refusal(key, value, expected))?;
    }
    Ok(numbers)
}

/// Writes `key` and the shapes of each kind that occurs, with a comma before each.
pub(crate) fn write_shapes(text: &mut String, shapes: &[Shape]) {
    for key in SHAPE_KEYS {
        let mut separator = format!(",\"{key}\":[");
        for shape in shapes.iter().filter(|shape| key_of(shape) == key) {
            text.push_str(&separator);
            match shape {
                Shape::Circle { center: [x, y], radius } => write_numbers(text, &[*x, *y, *radius]),
                Shape::Box { center: [x, y], yaw, length, width } => {
                    write_numbers(text, &[*x, *y, *yaw, *length, *width]);
                }
                Shape::Segment { a: [x1, y1], b: [x2, y2] } => write_numbers(text, &[*x1, *y1, *x2, *y2]),
                Shape::Polygon { points } => {
                    for (i, point) in points.iter().enumerate() {
                        text.push(if i == 0 { '[' } else { ',' });
                        write_numbers(text, point);
                    }
                    text.push(']');
                }
            }
            separator = ",".into();
        }
        if separator == "," {
            text.push(']');
        }
    }
}

fn key_of(shape: &Shape) -> &'static str {
    match shape {
        Shape::Circle { .. } => "circles",
        Shape::Box { .. } => "boxes",
        Shape::Segment { .. } => "segments",
        Shape::Polygon { .. } => "polygons",
    }
}

/// Writes a list of numbers.
pub(crate) fn write_numbers(text: &mut String, numbers: &[f64]) {
    for (i, number) in numbers.iter().enumerate() {
        text.push(if i == 0 { '[' } else { ',' });
        write_number(text, *number);
    }
    text.push(']');
}

/// Writes the shortest text that reads back to the same finite number: with or without an exponent.
pub(crate) fn write_number(text: &mut String, number: f64) {
    let start = text.len();
    // Writing to a string cannot fail.
    let _ = write!(text, "{number}");
    if text.len() - start > 4 {
        let scientific = format!("{number:e}");
        if scientific.len() < text.len() - start {
            text.truncate(start);
            text.push_str(&scientific);
        }
    }
}

/// Insertions, removals and replacements that turn one word into the other.
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.chars().count()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.chars().enumerate() {
            let replaced = diagonal + usize::from(from != to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.chars().count()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_short_as_they_can_be() {
        for (number, expected) in [
            (1.0, "1"),
            (-0.5, "-0.5"),
            (1e-7, "1e-7"),
            (0.001, "1e-3"),
            (0.0001, "1e-4"),
            (-0.0, "-0"),
            (1e21, "1e21"),
        ] {
            let mut text = String::new();
            write_number(&mut text, number);
            assert_eq!(text, expected);
            let back: f64 = serde_json::from_str(&text).unwrap();
            assert_eq!(back.to_bits(), number.to_bits());
        }
    }

    #[test]
    fn edits_are_counted() {
        assert_eq!(edit_distance("circle", "circles"), 1);
        assert_eq!(edit_distance("boxs", "boxes"), 1);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("kitten", "sitting"), 3);
    }
}
