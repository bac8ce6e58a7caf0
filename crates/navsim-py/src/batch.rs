//! `BatchSim` for Python.

use crate::arguments::{copy_array, copy_mask, refusal, whole};
use crate::scenario::Scenario;
use navsim::batch::{ROBOTS_MAX, THREADS_MAX};
use navsim::{Results, SimConfig};
use numpy::ndarray::{ArrayView, IntoDimension};
use numpy::{Element, Ix1, Ix2, PyArray, PyArrayMethods};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// Many robots stepped together; see navrl.BatchSim.
#[pyclass(subclass, module = "navrl._navsim")]
pub struct BatchSim {
    core: navsim::BatchSim,
    actions: Vec<f32>,
    mask: Vec<bool>,
}

/// A read-only numpy view of one of the result arrays.
fn view<'py, T, D>(
    this: &Bound<'py, BatchSim>,
    select: impl Fn(&Results) -> &[T],
    shape: impl Fn(usize, &navsim::BatchSim) -> D,
) -> PyResult<Bound<'py, PyArray<T, D::Dim>>>
where
    T: Element,
    D: IntoDimension,
{
    let borrowed = this.try_borrow()?;
    let shape = shape(borrowed.core.num_envs(), &borrowed.core);
    view_of(this, select(borrowed.core.results()), shape)
}

/// A read-only numpy view of `values`, an array of results of `this`.
fn view_of<'py, T: Element, D: IntoDimension>(
    this: &Bound<'py, BatchSim>,
    values: &[T],
    shape: D,
) -> PyResult<Bound<'py, PyArray<T, D::Dim>>> {
    let values = ArrayView::from_shape(shape.into_dimension(), values);
    let values = values.map_err(|e| PyValueError::new_err(e.to_string()))?;
    // SAFETY: the core allocates an array of results once and never moves it, and the view keeps `this` alive. A step
    // in another thread may change what a view shows, as with any numpy array.
    let array = unsafe { PyArray::borrow_from_array(&values, this.clone().into_any()) };
    Ok((*array.readwrite().make_nonwriteable()).clone())
}

#[pymethods]
impl BatchSim {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "keywords of navrl.BatchSim")]
    fn new(
        py: Python<'_>,
        config: &str,
        num_envs: &Bound<'_, PyAny>,
        seed: &Bound<'_, PyAny>,
        num_threads: &Bound<'_, PyAny>,
        autoreset: bool,
        scenarios: Option<Vec<PyRef<'_, Scenario>>>,
        first: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let first = whole("first", first, 0..=ROBOTS_MAX as u64)? as usize;
        let num_envs = whole("num_envs", num_envs, 1..=ROBOTS_MAX as u64)? as usize;
        let seed = whole("seed", seed, 0..=u64::MAX)?;
        let num_threads = whole("num_threads", num_threads, 1..=THREADS_MAX as u64)? as usize;
        let config = SimConfig::from_json(config).map_err(refusal)?;
        let scenarios = scenarios.map(|list| list.iter().map(|s| s.core.clone()).collect());
        let part = || navsim::BatchSim::part(config, num_envs, seed, num_threads, autoreset, scenarios, first);
        let core = py.detach(part);
        Ok(Self { core: core.map_err(refusal)?, actions: Vec::new(), mask: Vec::new() })
    }

    #[pyo3(signature = (mask=None))]
    fn reset(&mut self, py: Python<'_>, mask: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Self { core, mask: values, .. } = self;
        if let Some(mask) = mask {
            copy_mask("mask", mask, &[core.num_envs()], values)?;
        }
        let mask = mask.map(|_| values.as_slice());
        py.detach(|| core.reset(mask)).map_err(refusal)
    }

    fn step(&mut self, py: Python<'_>, actions: &Bound<'_, PyAny>) -> PyResult<()> {
        let Self { core, actions: values, .. } = self;
        copy_array("actions", actions, &[core.num_envs(), 2], values)?;
        py.detach(|| core.step(values)).map_err(refusal)
    }

    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &py.detach(|| self.core.state()).map_err(refusal)?))
    }

    fn restore(&mut self, py: Python<'_>, state: &[u8]) -> PyResult<()> {
        py.detach(|| self.core.restore(state)).map_err(refusal)
    }

    fn scenario(&self, robot: i64) -> PyResult<Scenario> {
        let scenario = usize::try_from(robot).ok().and_then(|robot| self.core.scenario(robot));
        let last = self.core.num_envs() - 1;
        let refused = || PyIndexError::new_err(format!("robot: expected 0 to {last}, got {robot}"));
        scenario.map(|core| Scenario { core }).ok_or_else(refused)
    }

    #[getter]
    fn num_envs(&self) -> usize {
        self.core.num_envs()
    }

    #[getter]
    fn observation_size(&self) -> usize {
        self.core.observation_size()
    }

    #[getter]
    fn observations<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f32, Ix2>>> {
        view(this, |results| &results.observations, |n, core| (n, core.observation_size()))
    }

    #[getter]
    fn rewards<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f32, Ix1>>> {
        view(this, |results| &results.rewards, |n, _| n)
    }

    #[getter]
    fn terminated<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<bool, Ix1>>> {
        view(this, |results| &results.terminated, |n, _| n)
    }

    #[getter]
    fn truncated<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<bool, Ix1>>> {
        view(this, |results| &results.truncated, |n, _| n)
    }

    #[getter]
    fn final_observations<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f32, Ix2>>> {
        view(this, |results| &results.final_observations, |n, core| (n, core.observation_size()))
    }

    #[getter]
    fn outcome<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<u8, Ix1>>> {
        view(this, |results| &results.outcome, |n, _| n)
    }

    #[getter]
    fn ranges<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f32, Ix2>>> {
        {
            let core = &mut this.try_borrow_mut()?.core;
            this.py().detach(|| core.keep_ranges()).map_err(refusal)?;
        }
        let core = &this.try_borrow()?.core;
        view_of(this, core.ranges(), (core.num_envs(), core.config().lidar.beams))
    }

    #[getter]
    fn poses<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f64, Ix2>>> {
        view(this, |results| &results.poses, |n, _| (n, 3))
    }

    #[getter]
    fn odometry<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray<f64, Ix2>>> {
        PyArray::from_iter(py, self.core.odometry().flatten()).reshape([self.core.num_envs(), 3])
    }

    #[getter]
    fn clearances<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray<f32, Ix1>> {
        PyArray::from_iter(py, self.core.clearances())
    }

    #[getter]
    fn goals<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f64, Ix2>>> {
        view(this, |results| &results.goals, |n, _| (n, 2))
    }

    #[getter]
    fn velocities<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f64, Ix2>>> {
        view(this, |results| &results.velocities, |n, _| (n, 2))
    }

    #[getter]
    fn episode_returns<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f64, Ix1>>> {
        view(this, |results| &results.episode_returns, |n, _| n)
    }

    #[getter]
    fn episode_steps<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<u32, Ix1>>> {
        view(this, |results| &results.episode_steps, |n, _| n)
    }

    #[getter]
    fn episode_path<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f64, Ix1>>> {
        view(this, |results| &results.episode_path, |n, _| n)
    }

    #[getter]
    fn episode_clearance<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<f64, Ix1>>> {
        view(this, |results| &results.episode_clearance, |n, _| n)
    }

    #[getter]
    fn episodes<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray<u64, Ix1>>> {
        view(this, |results| &results.episodes, |n, _| n)
    }
}
