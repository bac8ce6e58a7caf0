//! navsim: many planar mobile robots with 2-D lidar, stepped together.
//!
//! The flow of navrl, of which this crate is the first half:
//!
//! `config -> world -> batch (kinematics -> collision -> lidar -> observation, reward, episode) -> env`
//!
//! * [`config`]: every setting, checked.
//! * [`world`]: shapes, scenarios and the generators that draw them.
//! * [`batch`]: [`BatchSim`], arrays in and arrays out, the only user of threads. A step of one robot is
//!   [`robot`] (kinematics), [`collision`], [`lidar`], and [`task`] (observation, reward, episode).
//! * [`shortest`]: true shortest paths; [`planner`]: paths in the ways that robots use.
//! * [`controller`]: classical local controllers, from scan, goal and speed to a command.
//! * [`cpu`]: instruction sets, chosen at run time; [`pose`] and [`error`]: what all lean on.
//!
//! Units are SI and radians; x is forward, y left, angles are counter-clockwise. Random numbers come from named
//! streams ([`rng`]), so that results depend neither on the number of threads nor on the size of the batch.

#![deny(unsafe_code)]

pub mod batch;
pub mod collision;
pub mod config;
pub mod controller;
pub mod cpu;
pub mod error;
mod grown;
pub mod lidar;
pub mod planner;
pub mod pose;
mod results;
pub mod rng;
pub mod robot;
pub mod shortest;
pub mod task;
pub mod world;

pub use batch::BatchSim;
pub use config::SimConfig;
pub use error::{Error, Result};
pub use results::Results;
pub use world::Scenario;
