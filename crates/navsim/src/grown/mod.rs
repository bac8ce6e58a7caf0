//! What shortest paths and planners share: a world whose shapes are grown by what the robot's centre keeps from them.
//!
//! A `shape` is grown exactly, a `world` finds its shapes by place; an `enclosure` cuts places off, a `goal_disc` may
//! be reached in part. On a `grid` of nodes `fast_marching` measures distances.

mod enclosure;
mod fast_marching;
mod goal_disc;
mod grid;
mod points;
mod shape;
mod world;

pub(crate) use fast_marching::Field;
pub(crate) use goal_disc::GoalDisc;
pub(crate) use grid::{BORDER, Grid};
pub(crate) use points::{Point, along, apart, sweep};
pub(crate) use shape::GrownShape;
pub(crate) use world::{Corner, GrownWorld, Joint, bounds};

#[cfg(test)]
pub(crate) mod tests;
