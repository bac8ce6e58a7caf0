//! The learner's updates for Python.

use crate::actor::answers;
use crate::arguments::{copy_mask, refusal};
use navlearn::{Draws, Error, Layer, Mirror, Real, Record, Settings, Trained, Updates, Vectors};
use numpy::ndarray::Dimension;
use numpy::{
    Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray, PyReadonlyArray1, PyReadonlyArray2,
    PyReadwriteArray1, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyArithmeticError, PyValueError};
use pyo3::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether there is room for a second thread to learn; one thread may say so while another one makes updates.
#[pyclass(module = "navrl._navsim", frozen)]
pub struct Room(Arc<AtomicBool>);

#[pymethods]
impl Room {
    #[new]
    fn new(free: bool) -> Self {
        Self(Arc::new(AtomicBool::new(free)))
    }

    /// Sets it.
    fn set(&self, free: bool) {
        self.0.store(free, Ordering::Relaxed);
    }
}

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
#[pyclass(module = "navrl._navsim")]
pub struct Learner {
    core: Core,
    room: Arc<AtomicBool>,
    /// Which rows of the present call are mirrored.
    mirrored: Vec<bool>,
}

enum Core {
    Single(navlearn::Learner<f32>),
    Double(navlearn::Learner<f64>),
}

/// Parameters, targets and Adam's two moments of a network.
type Arrays<'py, T> = [Bound<'py, PyArray1<T>>; 4];

/// (inputs, outputs, place of W, place of b) of a layer.
pub(crate) type Place = (usize, usize, usize, usize);

pub(crate) fn layers(places: Vec<Place>) -> Vec<Layer> {
    places.into_iter().map(|(inputs, outputs, weight, bias)| Layer { inputs, outputs, weight, bias }).collect()
}

/// The Python exception of a refusal: ValueError for sizes, ArithmeticError for NaN and infinity.
pub(crate) fn stopped(error: Error) -> PyErr {
    match error {
        Error::Size { .. } => PyValueError::new_err(error.to_string()),
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
    array.as_slice().map_err(|_| PyValueError::new_err(format!("{name}: expected a C-contiguous array")))
}

fn borrowed<'py, T: Element>(arrays: &Arrays<'py, T>) -> PyResult<Vec<PyReadwriteArray1<'py, T>>> {
    let borrow = |array: &Bound<'py, PyArray1<T>>| array.try_readwrite();
    arrays.iter().map(borrow).collect::<Result<_, _>>().map_err(|e| PyValueError::new_err(format!("vectors: {e}")))
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
    core: &mut navlearn::Learner<T>,
    [actor, critic]: [&Bound<'_, PyAny>; 2],
    rates: [f64; 2],
    steps: [u64; 2],
    draws: Draws<'_>,
    room: &AtomicBool,
) -> PyResult<(Vec<UpdateRecord>, bool)> {
    let (actor, critic): (Arrays<'_, T>, Arrays<'_, T>) = (actor.extract()?, critic.extract()?);
    let read = [place(draws.replay), place(draws.indices), place(draws.noise)];
    refuse_overlap(&actor.iter().chain(&critic).collect::<Vec<_>>(), read)?;
    let (mut actor, mut critic) = (borrowed(&actor)?, borrowed(&critic)?);
    let actor = trained(&mut actor, rates[0], steps[0])?;
    let critic = trained(&mut critic, rates[1], steps[1])?;
    let Updates { records, busy } = py.detach(|| core.update(actor, critic, draws, room)).map_err(stopped)?;
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
    core: &mut navlearn::Learner<T>,
    actor: &Bound<'py, PyAny>,
    observations: &PyReadonlyArray2<'py, f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let actor: PyReadonlyArray1<'py, T> = actor.extract()?;
    let (parameters, acting) = (numbers("actor", &actor)?, core.acting());
    answers(py, acting.inputs(), observations, |rows, actions| acting.act(parameters, rows, actions))
}

#[pymethods]
impl Learner {
    #[new]
    #[pyo3(signature = (*, double, actor, critic, action_weight, critics, batch, sizes, policy_delay, tau,
        pretanh_penalty, bounds, frozen_combined, mirror, threads, room))]
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
        mirror: Option<(Vec<usize>, Vec<f32>)>,
        threads: usize,
        room: &Bound<'_, Room>,
    ) -> PyResult<Self> {
        let (actor, critic) = (layers(actor), layers(critic));
        let mirror = mirror.map(|(permutation, signs)| Mirror { permutation, signs });
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
        let isa = navlearn::Isa::current().map_err(refusal)?;
        let core = if double {
            Core::Double(navlearn::Learner::new(settings, threads, isa).map_err(stopped)?)
        } else {
            Core::Single(navlearn::Learner::new(settings, threads, isa).map_err(stopped)?)
        };
        Ok(Self { core, room: room.get().0.clone(), mirrored: Vec::new() })
    }

    /// As many updates as there are batches of indices; see `navlearn::Learner::update`.
    #[pyo3(signature = (*, actor, critic, rates, steps, replay, indices, mirrored, noise))]
    #[expect(clippy::too_many_arguments, reason = "keywords, each an array of the caller")]
    fn update(
        &mut self,
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
        let Self { core, room, mirrored: mask } = self;
        copy_mask("mirrored", mirrored, &[indices.len()], mask)?;
        let draws = Draws {
            replay: numbers("replay", &replay)?,
            width: replay.shape()[1],
            indices: numbers("indices", &indices)?,
            mirrored: mask,
            noise: numbers("noise", &noise)?,
        };
        let networks = [actor, critic];
        match core {
            Core::Single(core) => update(py, core, networks, rates, steps, draws, room),
            Core::Double(core) => update(py, core, networks, rates, steps, draws, room),
        }
    }

    /// Actions (n, 2) of the actor for observations (n, inputs).
    #[pyo3(signature = (*, actor, observations))]
    fn act<'py>(
        &mut self,
        py: Python<'py>,
        actor: &Bound<'py, PyAny>,
        observations: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        match &mut self.core {
            Core::Single(core) => act(py, core, actor, &observations),
            Core::Double(core) => act(py, core, actor, &observations),
        }
    }
}
