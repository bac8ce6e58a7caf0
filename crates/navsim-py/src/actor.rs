//! An actor's answers for Python.

use crate::arguments::refusal;
use crate::learner::{Place, Reflection, layers, numbers, reflection, stopped};
use navlearn::{ACTIONS, Acting, Isa, Result};
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

/// A trained actor; see navrl.policy.
#[pyclass(module = "navrl._navsim", frozen)]
pub struct Actor {
    inputs: usize,
    parameters: Vec<f32>,
    acting: Mutex<Acting<f32>>,
}

#[pymethods]
impl Actor {
    #[new]
    #[pyo3(signature = (places, parameters, mirror))]
    fn new(places: Vec<Place>, parameters: PyReadonlyArray1<'_, f32>, mirror: Option<Reflection>) -> PyResult<Self> {
        let parameters = numbers("parameters", &parameters)?.to_vec();
        let isa = Isa::current().map_err(refusal)?;
        let acting = Acting::new(&layers(places), parameters.len(), mirror.map(reflection), isa).map_err(stopped)?;
        Ok(Self { inputs: acting.inputs(), parameters, acting: Mutex::new(acting) })
    }

    /// Actions (n, 2) for observations (n, inputs).
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        answers(py, self.inputs, &observations, |rows, actions| {
            let mut acting = self.acting.lock().unwrap_or_else(PoisonError::into_inner);
            acting.act(&self.parameters, rows, actions)
        })
    }
}

/// Actions (n, 2) for observations (n, inputs) by what `act` makes of them, without the interpreter's lock.
pub(crate) fn answers<'py>(
    py: Python<'py>,
    inputs: usize,
    observations: &PyReadonlyArray2<'py, f32>,
    act: impl FnOnce(&[f32], &mut [f32]) -> Result<()> + Send,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (rows, width) = (numbers("observations", observations)?, observations.shape()[1]);
    if width != inputs {
        return Err(PyValueError::new_err(format!("observations: expected {inputs} columns, got {width}")));
    }
    let actions = PyArray2::zeros(py, [observations.shape()[0], ACTIONS], false);
    let mut borrowed = actions.readwrite();
    let result = borrowed.as_slice_mut()?;
    py.detach(|| act(rows, result)).map_err(stopped)?;
    drop(borrowed);
    Ok(actions)
}
