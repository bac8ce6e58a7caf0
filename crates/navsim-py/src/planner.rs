//! Planners and look-ahead for Python.

use crate::arguments::{copy_array, refusal, rows, whole};
use crate::scenario::Scenario;
use navsim::planner::{Planner, PlannerConfig};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Array<'py> = Bound<'py, PyArray2<f64>>;

/// Points as an array (K, 2).
fn array<'py>(py: Python<'py>, points: &[[f64; 2]]) -> PyResult<Array<'py>> {
    PyArray1::from_slice(py, points.as_flattened()).reshape([points.len(), 2])
}

/// Points from an array (K, 2) of any K.
fn points(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 2]>> {
    let mut values = Vec::new();
    copy_array(name, argument, &[rows(name, argument)?, 2], &mut values)?;
    Ok(values.as_chunks::<2>().0.to_vec())
}

/// Plans the way of a scenario; see navrl.planners.plan.
#[pyfunction]
#[allow(clippy::type_complexity)] // a plan's fields, written out in the stub
pub fn plan<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    planner: &str,
    radius: f64,
    config: &str,
    seed: &Bound<'py, PyAny>,
    index: &Bound<'py, PyAny>,
) -> PyResult<(&'static str, Array<'py>, f64, f64, u64, f64)> {
    let (seed, index) = (whole("seed", seed, 0..=u64::MAX)?, whole("index", index, 0..=u32::MAX.into())? as u32);
    let unknown = || {
        let names = Planner::ALL.map(|(name, _)| name).join(", ");
        PyValueError::new_err(format!("planner = '{planner}': expected one of {names}"))
    };
    let planner = Planner::named(planner).ok_or_else(unknown)?;
    let config = PlannerConfig::from_json(config).map_err(refusal)?;
    let plan = py.detach(|| navsim::planner::plan(&scenario.core, planner, radius, &config, seed, index));
    let plan = plan.map_err(refusal)?;
    Ok((plan.status.name(), array(py, &plan.path)?, plan.length, plan.clearance, plan.expansions, plan.time))
}

/// Intermediate goals along paths; see navrl.planners.Lookahead.
#[pyclass(subclass, module = "navrl._navsim")]
pub struct Lookahead {
    core: navsim::planner::Lookahead,
}

#[pymethods]
impl Lookahead {
    #[new]
    fn new(paths: Vec<Bound<'_, PyAny>>, goals: &Bound<'_, PyAny>, distance: f64) -> PyResult<Self> {
        let paths = paths.iter().map(|path| points("paths", path)).collect::<PyResult<Vec<_>>>()?;
        let core = navsim::planner::Lookahead::new(&paths, &points("goals", goals)?, distance);
        Ok(Self { core: core.map_err(refusal)? })
    }

    fn update<'py>(&mut self, py: Python<'py>, positions: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        let mut values = Vec::new();
        copy_array("positions", positions, &[self.core.len(), 2], &mut values)?;
        let positions = values.as_chunks::<2>().0;
        let mut targets = vec![[0.0; 2]; positions.len()];
        py.detach(|| self.core.update(positions, &mut targets)).map_err(refusal)?;
        array(py, &targets)
    }

    #[getter]
    fn progress<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.core.progress())
    }
}
