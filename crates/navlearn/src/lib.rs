//! navlearn: the update of TD3 and DDPG (equations 7 to 10) on parameters that belong to the caller; and
//! the actor's answers.
//!
//! The flow of one update:
//!
//! `update (helper, team) -> call -> part (batch, network (layer -> kernels)) -> adam`
//!
//! * `update`: [`Learner`], which checks what comes and makes updates in one thread or two.
//! * `call`: the phases of an update, each in two halves; `helper`: a second thread, `team`: how two threads meet.
//! * `part`: what actor and critics make of some rows of a batch or all: targets (equation 9), losses and gradients.
//! * `batch`: rows of replay, drawn by index, mirrored where told, laid out for the networks.
//! * `network`: the actor (equation 8) and the critics (equation 7), forward and back; a `layer` is one dense layer of
//!   them in its place in the `packed` parameters.
//! * `adam`: one step over a packed vector, with the targets' soft update (equation 10) in the same pass.
//! * `act`: the actor's actions for many observations, asked from one side or both.
//! * `settings`: sizes and options of an update, checked.
//! * `kernels`: matrix products and loops over slices, chosen for the processor; `real`: f32 and f64; `aligned`: memory.
//!
//! Every matrix is stored by rows with the batch along the columns: a layer's output is (units, batch), its weight
//! (outputs, inputs), and so it computes Y = relu(W X + b).
//!
//! Determinism: the same inputs give the same bits on the same processor, in one thread or two and however updates are
//! grouped into calls; with AVX2 and FMA and with AVX-512 they are the same. Where there is neither, or `NAVRL_ISA` forbids
//! both, products round otherwise. Parameters, targets and moments are never denormal; where errors are so small that their
//! gradients are, the bits depend on whether the threads flush such numbers to zero, as navrl's do.
//!
//! Threads: two halves of a batch give the same bits as the whole, for every sum over its rows is made in two parts
//! (`part`). Of two critics each thread takes one for all rows. What two threads write is theirs by a lock that nobody else
//! wants at that time.

#![deny(unsafe_code)]

mod act;
mod adam;
mod aligned;
mod batch;
mod call;
mod error;
mod helper;
mod kernels;
mod layer;
mod network;
mod packed;
mod part;
mod real;
mod settings;
mod team;
mod update;

pub use act::Acting;
pub use adam::Vectors;
pub use batch::{ACTIONS, Mirror};
pub use error::{Error, Result};
pub use helper::Helper;
pub use kernels::Isa;
pub use layer::Layer;
pub use part::SATURATED;
pub use real::Real;
pub use settings::Settings;
pub use update::{Draws, Learner, Record, Trained, Updates};
