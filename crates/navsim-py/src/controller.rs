//! `Controller` for Python.

use crate::arguments::{copy_array, refusal, rows, whole};
use navsim::SimConfig;
use navsim::controller::{self, ControllersConfig, Inputs, Kind};
use numpy::{Ix2, PyArray, PyArrayMethods, ToPyArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A classical controller of many robots; see navrl.controllers.Controller.
#[pyclass(subclass, module = "navrl._navsim")]
pub struct Controller {
    core: controller::Controller,
    ranges: Vec<f32>,
    goal: Vec<f64>,
    velocity: Vec<f64>,
    robots: Vec<u32>,
}

#[pymethods]
impl Controller {
    #[new]
    fn new(name: &str, settings: &str, sim: &str, seed: &Bound<'_, PyAny>) -> PyResult<Self> {
        let names = Kind::ALL.map(Kind::name).join(", ");
        let kind = Kind::named(name)
            .ok_or_else(|| PyValueError::new_err(format!("controller '{name}': expected one of {names}")))?;
        let (settings, sim) = (ControllersConfig::from_json(settings), SimConfig::from_json(sim));
        let seed = whole("seed", seed, 0..=u64::MAX)?;
        let core = controller::Controller::new(kind, &settings.map_err(refusal)?, &sim.map_err(refusal)?, seed);
        let (ranges, goal, velocity, robots) = Default::default();
        Ok(Self { core: core.map_err(refusal)?, ranges, goal, velocity, robots })
    }

    fn forget(&mut self) {
        self.core.reset();
    }

    fn commands<'py>(
        &mut self,
        py: Python<'py>,
        ranges: &Bound<'py, PyAny>,
        goal: &Bound<'py, PyAny>,
        velocity: &Bound<'py, PyAny>,
        robots: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray<f64, Ix2>>> {
        let Self { core, .. } = self;
        let count = rows("ranges", ranges)?;
        copy_array("ranges", ranges, &[count, core.beams()], &mut self.ranges)?;
        copy_array("goal", goal, &[count, 2], &mut self.goal)?;
        copy_array("velocity", velocity, &[count, 2], &mut self.velocity)?;
        if let Some(robots) = robots {
            copy_array("robots", robots, &[count], &mut self.robots)?;
        }
        let inputs = Inputs {
            robots: robots.map(|_| self.robots.as_slice()),
            ranges: &self.ranges,
            goals: &self.goal,
            velocities: &self.velocity,
        };
        let mut commands = vec![0.0; 2 * count];
        py.detach(|| core.command(&inputs, &mut commands)).map_err(refusal)?;
        commands.to_pyarray(py).reshape([count, 2])
    }
}
