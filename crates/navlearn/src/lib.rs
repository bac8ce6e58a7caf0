//! navlearn: the update of TD3 and DDPG (equations 7 to 10) on one thread, on parameters that belong to the caller; and
//! the actor's answers.
//!
//! The flow of one update:
//!
//! `batch -> network (layer -> kernels) -> update -> adam`
//!
//! * [`batch`]: rows of replay, drawn by index, mirrored where told, laid out for the networks.
//! * [`network`]: the actor (equation 8) and the critics (equation 7), forward and back; a [`layer`] is one dense layer
//!   of them in its place in the packed parameters.
//! * [`update`]: [`Learner`], targets (equation 9), losses, and how often what is stepped (equation 10).
//! * [`act`]: the actor's actions for many observations.
//! * [`settings`]: sizes and options of an update, checked.
//! * [`adam`]: one step over a packed vector, with the targets' soft update in the same pass.
//! * [`kernels`]: matrix products and loops over slices, chosen for the processor; [`real`]: f32 and f64.
//!
//! Every matrix is stored by rows with the batch along the columns: a layer's output is (units, batch), its weight
//! (outputs, inputs), and so it computes Y = relu(W X + b).
//!
//! Determinism: the same inputs give the same bits on the same processor, however updates are grouped into calls and
//! whether or not the caller flushes denormal numbers to zero; with AVX2 and FMA and with AVX-512 they are the same.
//! Where there is neither, or `NAVRL_ISA` forbids both, products round otherwise.

#![deny(unsafe_code)]

pub mod act;
pub mod adam;
pub mod batch;
pub mod error;
pub mod kernels;
pub mod layer;
pub mod network;
pub mod real;
pub mod settings;
pub mod update;

pub use error::{Error, Result};
pub use real::Real;
pub use settings::Settings;
pub use update::{Draws, Learner, Record, Trained};
