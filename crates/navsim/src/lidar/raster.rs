//! The scan kernel: a rasteriser with a one-dimensional depth buffer.
//!
//! Every edge that the lidar can see covers an interval of beams. For those beams the inverse range is linear in the
//! beam's direction, 1/t = (c e_y - s e_x) / (a x e) for an edge from a along e, so the nearest edge of a beam is the
//! largest of a few multiplications: no division and no branch in the inner loop. Circles follow in ranges.
//!
//! One source serves every instruction set (see `isa`): plain loops over blocks of 16, no fused multiply-add, and only
//! operations that are rounded exactly, so that all of them give the same bits.

use super::circles;
use super::draw::{Draws, View};
use super::edges::Facing;
use super::fan::Fan;
use crate::world::{BLOCK, Lanes, Outline};

/// Working memory of a scan, one for each thread.
#[derive(Debug, Clone)]
pub(crate) struct Scratch {
    depth: Vec<Lanes>,
    draws: Draws,
    facing: Facing,
}

impl Scratch {
    /// Memory for scans of `fan`.
    pub fn new(fan: &Fan) -> Self {
        let blocks = fan.cos.len();
        Self { depth: vec![Lanes::all(0.0); blocks], draws: Draws::new(blocks), facing: Facing::default() }
    }
}

/// Computes the ranges (m) of all beams of `fan` in the lidar's frame against `outlines`; `ranges` has the padded
/// length of the fan. A beam that meets nothing within `range_max` gets exactly `range_max`. The lidar must not be
/// inside a solid.
#[inline(always)]
pub(super) fn scan(
    outlines: [&Outline; 2],
    view: View,
    fan: &Fan,
    range_max: f32,
    scratch: &mut Scratch,
    ranges: &mut [f32],
) {
    let Scratch { depth, draws, facing } = scratch;
    let farthest = 1.0 / range_max;
    depth.fill(Lanes::all(farthest));
    for block in outlines.iter().flat_map(|outline| outline.edges()) {
        facing.add(block, view, fan, draws, depth);
    }
    facing.finish(fan, draws, depth);
    let circles = outlines.iter().any(|outline| !outline.circles().is_empty());
    for (row, block) in ranges.chunks_exact_mut(BLOCK).zip(&*depth) {
        row.copy_from_slice(&block.0);
    }
    for range in ranges.iter_mut() {
        let hit = 1.0 / *range;
        *range = if (*range > farthest) & (hit < range_max) { hit } else { range_max };
    }
    if circles {
        for (row, block) in ranges.chunks_exact(BLOCK).zip(depth.iter_mut()) {
            block.0.copy_from_slice(row);
        }
        for block in outlines.iter().flat_map(|outline| outline.circles()) {
            circles::draw(block, view, fan, draws, depth);
        }
        for (row, block) in ranges.chunks_exact_mut(BLOCK).zip(&*depth) {
            row.copy_from_slice(&block.0);
        }
    }
}
