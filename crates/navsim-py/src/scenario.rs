//! `Scenario` for Python, and the functions that draw and read scenarios.

use crate::arguments::{refusal, whole};
use navsim::pose::Pose;
use navsim::rng::Split;
use navsim::world::{ScenarioList, Shape, Worlds};
use navsim::{SimConfig, robot::Footprint};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Start, goal and obstacles as a value; see navrl.Scenario.
#[pyclass(frozen, eq, module = "navrl._navsim")]
#[derive(PartialEq)]
pub struct Scenario {
    pub core: navsim::Scenario,
}

type Point = [f64; 2];

#[pymethods]
impl Scenario {
    #[new]
    #[pyo3(signature = (*, start, goal, goal_radius, time_limit, circles=vec![], boxes=vec![], segments=vec![], polygons=vec![], shortest=None))]
    #[allow(clippy::too_many_arguments)] // one keyword for each key of the file format
    fn new(
        start: [f64; 3],
        goal: Point,
        goal_radius: f64,
        time_limit: f64,
        circles: Vec<[f64; 3]>,
        boxes: Vec<[f64; 5]>,
        segments: Vec<[f64; 4]>,
        polygons: Vec<Vec<Point>>,
        shortest: Option<f64>,
    ) -> PyResult<Self> {
        let mut shapes = Vec::new();
        shapes.extend(circles.iter().map(|&[x, y, radius]| Shape::Circle { center: [x, y], radius }));
        shapes.extend(boxes.iter().map(|&[x, y, yaw, length, width]| Shape::Box {
            center: [x, y],
            yaw,
            length,
            width,
        }));
        shapes.extend(segments.iter().map(|&[x1, y1, x2, y2]| Shape::Segment { a: [x1, y1], b: [x2, y2] }));
        for points in polygons {
            shapes.push(Shape::polygon(points).map_err(refusal)?);
        }
        let [x, y, yaw] = start;
        let core = navsim::Scenario { start: Pose { x, y, yaw }, goal, goal_radius, time_limit, shapes, shortest };
        core.validate().map_err(refusal)?;
        Ok(Self { core })
    }

    #[classmethod]
    fn from_json(_class: &Bound<'_, PyType>, line: &str) -> PyResult<Self> {
        Ok(Self { core: navsim::Scenario::from_json(line).map_err(refusal)? })
    }

    fn to_json(&self) -> String {
        self.core.to_json()
    }

    #[getter]
    fn start(&self) -> (f64, f64, f64) {
        let Pose { x, y, yaw } = self.core.start;
        (x, y, yaw)
    }

    #[getter]
    fn goal(&self) -> (f64, f64) {
        self.core.goal.into()
    }

    #[getter]
    fn goal_radius(&self) -> f64 {
        self.core.goal_radius
    }

    #[getter]
    fn time_limit(&self) -> f64 {
        self.core.time_limit
    }

    #[getter]
    fn shortest(&self) -> Option<f64> {
        self.core.shortest
    }

    #[getter]
    fn circles(&self) -> Vec<(f64, f64, f64)> {
        let circle = |shape: &Shape| match shape {
            Shape::Circle { center: [x, y], radius } => Some((*x, *y, *radius)),
            _ => None,
        };
        self.core.shapes.iter().filter_map(circle).collect()
    }

    #[getter]
    fn boxes(&self) -> Vec<(f64, f64, f64, f64, f64)> {
        let oriented_box = |shape: &Shape| match shape {
            Shape::Box { center: [x, y], yaw, length, width } => Some((*x, *y, *yaw, *length, *width)),
            _ => None,
        };
        self.core.shapes.iter().filter_map(oriented_box).collect()
    }

    #[getter]
    fn segments(&self) -> Vec<(f64, f64, f64, f64)> {
        let segment = |shape: &Shape| match shape {
            Shape::Segment { a, b } => Some((a[0], a[1], b[0], b[1])),
            _ => None,
        };
        self.core.shapes.iter().filter_map(segment).collect()
    }

    #[getter]
    fn polygons(&self) -> Vec<Vec<(f64, f64)>> {
        let polygon = |shape: &Shape| match shape {
            Shape::Polygon { points } => Some(points.iter().map(|&[x, y]| (x, y)).collect()),
            _ => None,
        };
        self.core.shapes.iter().filter_map(polygon).collect()
    }

    fn __hash__(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.core.to_json().hash(&mut hasher);
        hasher.finish()
    }

    fn __reduce__(this: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (String,))> {
        Ok((this.get_type().getattr("from_json")?.unbind(), (this.get().to_json(),)))
    }

    fn __repr__(&self) -> String {
        format!("Scenario.from_json('{}')", self.core.to_json())
    }
}

/// Scenarios `first` to `first + count - 1` of a split of the configured world.
#[pyfunction]
pub fn draw_list(
    py: Python<'_>,
    config: &str,
    split: &str,
    first: &Bound<'_, PyAny>,
    count: &Bound<'_, PyAny>,
    seed: &Bound<'_, PyAny>,
) -> PyResult<Vec<Scenario>> {
    let first = whole("first", first, 0..=u32::MAX.into())? as u32;
    let count = whole("count", count, 0..=u32::MAX.into())? as u32;
    let seed = whole("seed", seed, 0..=u64::MAX)?;
    let config = SimConfig::from_json(config).map_err(refusal)?;
    let split = Split::named(split).ok_or_else(|| PyValueError::new_err(format!("split: unknown name '{split}'")))?;
    let draw = || {
        let worlds = Worlds::new(&config.world, &Footprint::new(&config.robot))?;
        let indices = first..first.saturating_add(count);
        indices
            .map(|index| worlds.of(index as usize).draw_listed(split, seed, index, &config.task))
            .map(|drawn| drawn.map(|core| Scenario { core }))
            .collect::<navsim::Result<Vec<_>>>()
    };
    py.detach(draw).map_err(refusal)
}

/// Reads JSON Lines: the scenarios that the robot can run with their line numbers, and (line, reason) of the refused.
#[pyfunction]
#[allow(clippy::type_complexity)] // two plain lists, written out in the stub
pub fn read_list(py: Python<'_>, text: &str, config: &str) -> PyResult<(Vec<(usize, Scenario)>, Vec<(usize, String)>)> {
    let config = SimConfig::from_json(config).map_err(refusal)?;
    let footprint = Footprint::new(&config.robot);
    let list = py.detach(|| ScenarioList::read(text, &footprint));
    let scenarios = list.scenarios.into_iter().map(|core| Scenario { core });
    Ok((list.lines.into_iter().zip(scenarios).collect(), list.refused.iter().map(refused_line).collect()))
}

fn refused_line(error: &navsim::Error) -> (usize, String) {
    match error {
        navsim::Error::Line { line, reason } => (*line, reason.clone()),
        other => (0, other.to_string()),
    }
}

/// Length (m) of the shortest path of a disc of `radius` from the start to the goal circle; None if there is none.
#[pyfunction]
pub fn shortest_path(py: Python<'_>, scenario: &Scenario, radius: f64) -> Option<f64> {
    let core = &scenario.core;
    let start = [core.start.x, core.start.y];
    py.detach(|| navsim::shortest::shortest_path(&core.shapes, radius, start, core.goal, core.goal_radius))
}

/// Whether the segment from start to goal, swept by a disc of `radius`, touches an obstacle.
#[pyfunction]
pub fn needs_detour(py: Python<'_>, scenario: &Scenario, radius: f64) -> bool {
    let core = &scenario.core;
    let start = [core.start.x, core.start.y];
    py.detach(|| navsim::shortest::needs_detour(&core.shapes, radius, start, core.goal))
}
