//! The learner's updates for Python.

use crate::actor::{Asked, answers};
use crate::arguments::{copy_mask, refusal};
use navlearn::{
    Acting, Draws, Error, Helper, Isa, Layer, Mirror, Real, Record, Result, Settings, Trained, Updates, Vectors,
};
use numpy::ndarray::Dimension;
use numpy::{
    Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray, PyReadonlyArray1, PyReadonlyArray2,
    PyReadwriteArray1, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyArithmeticError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What one update tells.
#[pyclass(module = "navrl._navsim", frozen, get_all)]
pub struct UpdateRecord {
    critic_loss: f64,
    average_q: f64,
    maximum_q: f64,
    /// NaN without an actor step, as the next.
    actor_loss: f64,
    saturated_share: f64,
}

/// Updates of the networks of one learner; see navrl.native.
#[pyclass(module = "navrl._navsim", frozen)]
pub struct Learner {
    core: Core,
    helper: Option<Arc<Helper>>,
}

enum Core {
    Single(Kernels<f32>),
    Double(Kernels<f64>),
}

/// What makes updates, and what acts: one beside the other, from two threads.
struct Kernels<T> {
    updates: Mutex<navlearn::Learner<T>>,
    asked: Asked<T>,
}

impl<T: Real> Kernels<T> {
    fn new(settings: Settings, threads: usize, isa: Isa) -> Result<Self> {
        let acting = Acting::new(&settings.actor, settings.sizes[0], None, isa)?;
        Ok(Self { updates: Mutex::new(navlearn::Learner::new(settings, threads, isa)?), asked: Asked::new(acting) })
    }
}

/// Whoever comes second waits.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Parameters, targets and Adam's two moments of a network.
type Arrays<'py, T> = [Bound<'py, PyArray1<T>>; 4];

/// (inputs, outputs, place of W, place of b) of a layer.
pub(crate) type Place = (usize, usize, usize, usize);

pub(crate) fn layers(places: Vec<Place>) -> Vec<Layer> {
    places.into_iter().map(|(inputs, outputs, weight, bias)| Layer { inputs, outputs, weight, bias }).collect()
}

/// (permutation, signs) of a mirror.
pub(crate) type Reflection = (Vec<usize>, Vec<f32>);

pub(crate) fn reflection((permutation, signs): Reflection) -> Mirror {
    Mirror { permutation, signs }
}

/// The Python exception of a refusal: ValueError for sizes, ArithmeticError for NaN and infinity, RuntimeError for a
/// thread that does not start.
pub(crate) fn stopped(error: Error) -> PyErr {
    match error {
        Error::Size { .. } => PyValueError::new_err(error.to_string()),
        Error::Thread { .. } => PyRuntimeError::new_err(error.to_string()),
        _ => PyArithmeticError::new_err(error.to_string()),
    }
}

/// Where numbers lie in memory.
fn place<T>(numbers: &[T]) -> Range<usize> {
    let first = numbers.as_ptr() as usize;
    first..first + size_of_val(numbers)
}

/// Refuses vectors that share memory with each other or with what is read, which numpy's borrows do not see where their
/// owners differ.
fn refuse_overlap<T: Element>(vectors: &[&Bound<'_, PyArray1<T>>], read: [Range<usize>; 3]) -> PyResult<()> {
    let mut places: Vec<_> = vectors
        .iter()
        .map(|vector| {
            let first = vector.data() as usize;
            first..first + vector.len() * size_of::<T>()
        })
        .collect();
    places.sort_unstable_by_key(|place| place.start);
    let apart = places.windows(2).all(|pair| pair[0].end <= pair[1].start)
        && read.iter().all(|read| places.iter().all(|place| place.end <= read.start || read.end <= place.start));
    if apart {
        return Ok(());
    }
    Err(PyValueError::new_err(
        "actor, critic: expected vectors apart from each other and from what is read, got some that overlap",
    ))
}

/// The numbers of an array that is stored row by row.
pub(crate) fn numbers<'a, T: Element, D: Dimension>(
    name: &str,
    array: &'a PyReadonlyArray<'_, T, D>,
) -> PyResult<&'a [T]> {
    match array.as_slice() {
        Ok(row_by_row) if array.is_c_contiguous() => Ok(row_by_row),
        _ => Err(PyValueError::new_err(format!("{name}: expected a C-contiguous array"))),
    }
}

fn borrowed<'py, T: Element>(arrays: &Arrays<'py, T>) -> PyResult<Vec<PyReadwriteArray1<'py, T>>> {
    let borrow = |array: &Bound<'py, PyArray1<T>>| array.try_readwrite();
    arrays
        .iter()
        .map(borrow)
        .collect::<std::result::Result<_, _>>()
        .map_err(|e| PyValueError::new_err(format!("vectors: {e}")))
}

fn trained<'a, T: Element>(
    borrowed: &'a mut [PyReadwriteArray1<'_, T>],
    rate: f64,
    steps: u64,
) -> PyResult<Trained<'a, T>> {
    let mut slices = borrowed.iter_mut().map(|array| array.as_slice_mut().map_err(PyErr::from));
    let mut next = || slices.next().unwrap_or_else(|| Err(PyValueError::new_err("vectors: expected 4")));
    let vectors = Vectors { parameters: next()?, targets: next()?, first: next()?, second: next()? };
    Ok(Trained { vectors, rate, steps })
}

fn update<T: Real + Element>(
    py: Python<'_>,
    core: &Kernels<T>,
    [actor, critic]: [&Bound<'_, PyAny>; 2],
    rates: [f64; 2],
    steps: [u64; 2],
    draws: Draws<'_>,
) -> PyResult<(Vec<UpdateRecord>, bool)> {
    let (actor, critic): (Arrays<'_, T>, Arrays<'_, T>) = (actor.extract()?, critic.extract()?);
    let read = [place(draws.replay), place(draws.indices), place(draws.noise)];
    refuse_overlap(&actor.iter().chain(&critic).collect::<Vec<_>>(), read)?;
    let (mut actor, mut critic) = (borrowed(&actor)?, borrowed(&critic)?);
    let actor = trained(&mut actor, rates[0], steps[0])?;
    let critic = trained(&mut critic, rates[1], steps[1])?;
    let Updates { records, busy } = py.detach(|| lock(&core.updates).update(actor, critic, draws)).map_err(stopped)?;
    Ok((records.into_iter().map(UpdateRecord::from).collect(), busy))
}

impl From<Record> for UpdateRecord {
    fn from(Record { critic_loss, average_q, maximum_q, actor }: Record) -> Self {
        let [actor_loss, saturated_share] = actor.unwrap_or([f64::NAN; 2]);
        Self { critic_loss, average_q, maximum_q, actor_loss, saturated_share }
    }
}

fn act<'py, T: Real + Element>(
    py: Python<'py>,
    core: &Kernels<T>,
    actor: &Bound<'py, PyAny>,
    observations: &PyReadonlyArray2<'py, f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let actor: PyReadonlyArray1<'py, T> = actor.extract()?;
    let parameters = numbers("actor", &actor)?;
    answers(py, &core.asked, parameters, observations)
}

#[pymethods]
impl Learner {
    #[new]
    #[pyo3(signature = (*, double, actor, critic, action_weight, critics, batch, sizes, policy_delay, tau,
        pretanh_penalty, bounds, frozen_combined, mirror, threads))]
    #[expect(clippy::too_many_arguments, reason = "keywords, each a setting of the core")]
    fn new(
        double: bool,
        actor: Vec<Place>,
        critic: Vec<Place>,
        action_weight: usize,
        critics: usize,
        batch: usize,
        sizes: [usize; 2],
        policy_delay: u64,
        tau: f64,
        pretanh_penalty: f64,
        bounds: [f64; 2],
        frozen_combined: bool,
        mirror: Option<Reflection>,
        threads: usize,
    ) -> PyResult<Self> {
        let (actor, critic) = (layers(actor), layers(critic));
        let mirror = mirror.map(reflection);
        let settings = Settings {
            actor,
            critic,
            action_weight,
            critics,
            batch,
            sizes,
            policy_delay,
            tau,
            pretanh_penalty,
            bounds,
            frozen_combined,
            mirror,
        };
        let isa = Isa::current().map_err(refusal)?;
        let core = if double {
            Core::Double(Kernels::new(settings, threads, isa).map_err(stopped)?)
        } else {
            Core::Single(Kernels::new(settings, threads, isa).map_err(stopped)?)
        };
        let helper = match &core {
            Core::Single(kernels) => lock(&kernels.updates).helper(),
            Core::Double(kernels) => lock(&kernels.updates).helper(),
        };
        Ok(Self { core, helper })
    }

    /// Tells, also while updates are made, whether there is a processor for their second thread; at first there is.
    fn set_room(&self, room: bool) {
        if let Some(helper) = &self.helper {
            helper.set_room(room);
        }
    }

    /// As many updates as there are batches of indices; see `navlearn::Learner::update`.
    #[pyo3(signature = (*, actor, critic, rates, steps, replay, indices, mirrored, noise))]
    #[expect(clippy::too_many_arguments, reason = "keywords, each an array of the caller")]
    fn update(
        &self,
        py: Python<'_>,
        actor: &Bound<'_, PyAny>,
        critic: &Bound<'_, PyAny>,
        rates: [f64; 2],
        steps: [u64; 2],
        replay: PyReadonlyArray2<'_, f32>,
        indices: PyReadonlyArray1<'_, i64>,
        mirrored: &Bound<'_, PyAny>,
        noise: PyReadonlyArray1<'_, f32>,
    ) -> PyResult<(Vec<UpdateRecord>, bool)> {
        let mut mask = Vec::new();
        copy_mask("mirrored", mirrored, &[indices.len()], &mut mask)?;
        let draws = Draws {
            replay: numbers("replay", &replay)?,
            width: replay.shape()[1],
            indices: numbers("indices", &indices)?,
            mirrored: &mask,
            noise: numbers("noise", &noise)?,
        };
        let networks = [actor, critic];
        match &self.core {
            Core::Single(core) => update(py, core, networks, rates, steps, draws),
            Core::Double(core) => update(py, core, networks, rates, steps, draws),
        }
    }

    /// Actions (n, 2) of the actor for observations (n, inputs), also while updates of other vectors are made.
    #[pyo3(signature = (*, actor, observations))]
    fn act<'py>(
        &self,
        py: Python<'py>,
        actor: &Bound<'py, PyAny>,
        observations: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        match &self.core {
            Core::Single(core) => act(py, core, actor, &observations),
            Core::Double(core) => act(py, core, actor, &observations),
        }
    }
}
