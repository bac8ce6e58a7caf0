//! The core of navrl.

pub mod config;
pub mod error;
pub mod pose;
pub mod rng;
pub mod robot;
pub mod world;
