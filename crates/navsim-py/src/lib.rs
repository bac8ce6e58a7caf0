//! Python module `navrl._navsim`: checks arrays, releases the interpreter lock, calls the core, maps errors.

mod actor;
mod arguments;
mod batch;
mod controller;
mod learner;
mod planner;
mod scenario;

use pyo3::prelude::*;

/// The simulator core of navrl.
#[pymodule]
mod _navsim {
    /// |input of the actor's tanh| beyond which an output counts as saturated.
    #[pymodule_export]
    const SATURATED: f64 = navlearn::SATURATED;
    #[pymodule_export]
    use super::{check_world, isa};
    #[pymodule_export]
    use crate::actor::Actor;
    #[pymodule_export]
    use crate::batch::BatchSim;
    #[pymodule_export]
    use crate::controller::Controller;
    #[pymodule_export]
    use crate::learner::{Learner, UpdateRecord};
    #[pymodule_export]
    use crate::planner::{Lookahead, plan};
    #[pymodule_export]
    use crate::scenario::{Scenario, draw_list, needs_detour, read_list, shortest_path};
}

/// Instruction set that the scan kernels run on: "baseline", "avx2" or "avx512".
#[pyfunction]
fn isa() -> PyResult<&'static str> {
    navsim::cpu::Isa::current().map(|isa| isa.name()).map_err(arguments::refusal)
}

/// Refuses a configuration whose world cannot be set up for its robot; returns the share of the world's free area that
/// is cut off from the rest.
#[pyfunction]
fn check_world(config: &str) -> PyResult<f64> {
    let config = navsim::SimConfig::from_json(config).map_err(arguments::refusal)?;
    navsim::task::Task::new(config, None, 0, 0).map(|task| task.cut_off()).map_err(arguments::refusal)
}
