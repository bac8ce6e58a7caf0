//! An actor's answers for Python.

use crate::arguments::refusal;
use crate::learner::{Place, Reflection, layers, numbers, reflection, stopped};
use navlearn::{ACTIONS, Acting, Isa, Real, Result};
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Mutex;

/// What answers several threads at once: whoever finds its memory in use, or left in use by a thread that a fork did not
/// take along, takes memory of its own.
pub(crate) struct Asked<T> {
    usual: Mutex<Acting<T>>,
    another: Acting<T>,
}

impl<T: Real> Asked<T> {
    pub(crate) fn new(acting: Acting<T>) -> Self {
        Self { usual: Mutex::new(acting.clone()), another: acting }
    }

    fn act(&self, parameters: &[T], observations: &[f32], actions: &mut [f32]) -> Result<()> {
        match self.usual.try_lock() {
            Ok(mut acting) => acting.act(parameters, observations, actions),
            Err(_) => self.another.clone().act(parameters, observations, actions),
        }
    }
}

/// A trained actor; see navrl.policy.
#[pyclass(module = "navrl._navsim", frozen)]
pub struct Actor {
    parameters: Vec<f32>,
    asked: Asked<f32>,
}

#[pymethods]
impl Actor {
    #[new]
    #[pyo3(signature = (places, parameters, mirror))]
    fn new(places: Vec<Place>, parameters: PyReadonlyArray1<'_, f32>, mirror: Option<Reflection>) -> PyResult<Self> {
        let parameters = numbers("parameters", &parameters)?.to_vec();
        let isa = Isa::current().map_err(refusal)?;
        let acting = Acting::new(&layers(places), parameters.len(), mirror.map(reflection), isa).map_err(stopped)?;
        Ok(Self { parameters, asked: Asked::new(acting) })
    }

    /// Actions (n, 2) for observations (n, inputs).
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        answers(py, &self.asked, &self.parameters, &observations)
    }
}

/// Actions (n, 2) for observations (n, inputs), without the interpreter's lock.
pub(crate) fn answers<'py, T: Real>(
    py: Python<'py>,
    asked: &Asked<T>,
    parameters: &[T],
    observations: &PyReadonlyArray2<'py, f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (rows, width, inputs) =
        (numbers("observations", observations)?, observations.shape()[1], asked.another.inputs());
    if width != inputs {
        return Err(PyValueError::new_err(format!("observations: expected {inputs} columns, got {width}")));
    }
    let actions = PyArray2::zeros(py, [observations.shape()[0], ACTIONS], false);
    let mut borrowed = actions.readwrite();
    let result = borrowed.as_slice_mut()?;
    py.detach(|| asked.act(parameters, rows, result)).map_err(stopped)?;
    drop(borrowed);
    Ok(actions)
}
