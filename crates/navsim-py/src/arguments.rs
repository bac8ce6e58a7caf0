//! Arguments from Python: arrays checked by name, errors mapped.

use navsim::Error;
use numpy::{Element, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, dtype};
use pyo3::exceptions::{PyOverflowError, PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBool;
use std::ops::RangeInclusive;

/// The Python exception of a refusal: ValueError, or RuntimeError where the machine and not the caller is at fault.
pub fn refusal(error: Error) -> PyErr {
    match error {
        Error::Forked { .. } | Error::Threads { .. } => PyRuntimeError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// A whole number in `range`; whatever is none, or a bool, is a TypeError.
pub fn whole(name: &str, argument: &Bound<'_, PyAny>, range: RangeInclusive<u64>) -> PyResult<u64> {
    let number = if argument.is_instance_of::<PyBool>() { None } else { Some(argument.extract::<u64>()) };
    match number {
        Some(Ok(number)) if range.contains(&number) => Ok(number),
        Some(Err(error)) if !error.is_instance_of::<PyOverflowError>(argument.py()) => {
            Err(not_a_number(name, argument))
        }
        None => Err(not_a_number(name, argument)),
        Some(_) => {
            let (least, most) = range.into_inner();
            Err(PyValueError::new_err(format!("{name} = {argument}: expected {least} to {most}")))
        }
    }
}

fn not_a_number(name: &str, argument: &Bound<'_, PyAny>) -> PyErr {
    PyTypeError::new_err(format!("{name}: expected a whole number, got {}", type_name(argument)))
}

fn type_name(argument: &Bound<'_, PyAny>) -> String {
    argument.get_type().name().map_or_else(|_| "an object".into(), |name| name.to_string())
}

fn untyped<'a, 'py>(name: &str, argument: &'a Bound<'py, PyAny>) -> PyResult<&'a Bound<'py, PyUntypedArray>> {
    argument
        .cast::<PyUntypedArray>()
        .map_err(|_| PyTypeError::new_err(format!("{name}: expected a numpy array, got {}", type_name(argument))))
}

/// Number of rows of a numpy array.
pub fn rows(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<usize> {
    untyped(name, argument)?
        .shape()
        .first()
        .copied()
        .ok_or_else(|| PyValueError::new_err(format!("{name}: expected rows, got a number")))
}

/// Copies a numpy array of exactly this type and shape into `values`, whatever its strides. The copy is what makes an
/// argument safe that overlaps a result or is written by another thread during the call.
pub fn copy_array<T: Element + Copy>(
    name: &str,
    argument: &Bound<'_, PyAny>,
    shape: &[usize],
    values: &mut Vec<T>,
) -> PyResult<()> {
    check_array::<T>(name, argument, shape)?;
    copy_values(argument, values)
}

/// As `copy_array` for truth values. numpy takes every byte but 0 for true, also those that are no `bool` of Rust.
pub fn copy_mask(name: &str, argument: &Bound<'_, PyAny>, shape: &[usize], values: &mut Vec<bool>) -> PyResult<()> {
    check_array::<bool>(name, argument, shape)?;
    let mut bytes: Vec<u8> = Vec::new();
    copy_values(&argument.call_method1("view", ("uint8",))?, &mut bytes)?;
    values.clear();
    values.extend(bytes.iter().map(|byte| *byte != 0));
    Ok(())
}

/// Refuses what is not an aligned numpy array of exactly this type and shape.
fn check_array<T: Element>(name: &str, argument: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<()> {
    let (py, array) = (argument.py(), untyped(name, argument)?);
    if !array.dtype().is_equiv_to(&dtype::<T>(py)) {
        let (expected, got) = (dtype::<T>(py), array.dtype());
        return Err(PyTypeError::new_err(format!("{name}: expected dtype {expected}, got {got}")));
    }
    if array.shape() != shape {
        let got = array.shape();
        return Err(PyValueError::new_err(format!("{name}: expected shape {shape:?}, got {got:?}")));
    }
    // A field of a structured array may lie between the places where a T can be read.
    let whole = |stride: &isize| stride % size_of::<T>() as isize == 0;
    if !array.is_aligned() || !array.strides().iter().all(whole) {
        return Err(PyValueError::new_err(format!(
            "{name}: expected aligned elements, got strides {:?}",
            array.strides()
        )));
    }
    Ok(())
}

fn copy_values<T: Element + Copy>(array: &Bound<'_, PyAny>, values: &mut Vec<T>) -> PyResult<()> {
    let array = array.cast::<PyArrayDyn<T>>()?.readonly();
    values.clear();
    match array.as_slice() {
        Ok(row_by_row) if array.is_c_contiguous() => values.extend_from_slice(row_by_row),
        _ => values.extend(array.as_array().iter().copied()),
    }
    Ok(())
}
