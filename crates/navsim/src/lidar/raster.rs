//! The scan kernel: a rasteriser with a one-dimensional depth buffer.
//!
//! Every edge that the lidar can see covers an interval of beams. For those beams the inverse range is linear in the
//! beam's direction, 1/t = (c e_y - s e_x) / (a x e) for an edge from a along e, so the nearest edge of a beam is the
//! largest of a few multiplications: no division and no branch in the inner loop. Circles follow in ranges.
//!
//! One source serves every instruction set (see `cpu`): plain loops over blocks of 16, no fused multiply-add, and only
//! operations that are rounded exactly, so that all of them give the same bits.

use super::circles;
use super::draw::Draws;
use super::edges::{EdgeBlock, Facing, draw_all};
use super::fan::Fan;
use super::view::View;
use super::walk::{Depth, Walk};
use crate::cpu::Kernel;
use crate::world::{BLOCK, Block, Blocks, Lanes, Outline};

/// Working memory of a scan, one for each thread.
#[derive(Debug, Clone)]
pub(crate) struct Scratch {
    depth: Vec<Lanes>,
    draws: Draws,
    facing: Facing,
    walk: Walk,
}

impl Scratch {
    /// Memory for scans of `fan`.
    pub fn new(fan: &Fan) -> Self {
        let blocks = fan.directions.len();
        Self {
            depth: vec![Lanes::all(0.0); blocks],
            draws: Draws::new(blocks),
            facing: Facing::default(),
            walk: Walk::new(blocks),
        }
    }
}

/// Computes the range of every beam. A beam that meets nothing within `range_max` of the fan gets exactly that.
pub(super) struct Scan<'a> {
    /// What there is to be seen; the lidar is not inside a solid.
    pub outlines: [&'a Outline; 2],
    /// Allows what is faster and gives the same bits: trees, and the array method for few beams.
    pub shortcuts: bool,
    pub view: View,
    pub fan: &'a Fan,
    pub scratch: &'a mut Scratch,
    /// Result, m, with the padded length of the fan.
    pub ranges: &'a mut [f32],
}

impl Kernel for Scan<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { outlines, shortcuts, view, fan, scratch, ranges } = self;
        let range_max = fan.range_max;
        let farthest = 1.0 / range_max;
        scratch.depth.fill(Lanes::all(farthest));
        draw_edges(outlines, shortcuts, view, fan, scratch);
        copy(&scratch.depth, ranges);
        for range in ranges.iter_mut() {
            let hit = 1.0 / *range;
            *range = if (*range > farthest) & (hit < range_max) { hit } else { range_max };
        }
        if outlines.iter().any(|outline| !outline.circles.blocks().is_empty()) {
            for (block, row) in scratch.depth.iter_mut().zip(ranges.chunks_exact(BLOCK)) {
                block.0.copy_from_slice(row);
            }
            draw_circles(outlines, shortcuts, view, fan, scratch);
            copy(&scratch.depth, ranges);
        }
    }
}

/// Draws all edges into the depth buffer of inverse ranges.
#[inline(always)]
fn draw_edges(outlines: [&Outline; 2], shortcuts: bool, view: View, fan: &Fan, scratch: &mut Scratch) {
    for outline in outlines {
        draw_blocks(&outline.boxes, shortcuts, view, fan, scratch);
        draw_blocks(&outline.edges, shortcuts, view, fan, scratch);
    }
    let Scratch { depth, draws, facing, .. } = scratch;
    facing.finish(fan, draws, depth);
}

/// Draws the edges of `all` into the depth buffer, but for those that wait for more.
#[inline(always)]
fn draw_blocks<const ROWS: usize, const WIDTH: usize>(
    all: &Blocks<ROWS, WIDTH>,
    shortcuts: bool,
    view: View,
    fan: &Fan,
    scratch: &mut Scratch,
) where
    Block<ROWS, WIDTH>: EdgeBlock,
{
    let Scratch { depth, draws, facing, walk } = scratch;
    let blocks = all.blocks();
    match all.tree().filter(|_| shortcuts) {
        Some(tree) => {
            walk.start(tree, view, fan);
            while let Some(leaf) = walk.next(tree, view, fan, depth, Depth::Inverse) {
                facing.add(&blocks[leaf], view, fan, draws, depth);
            }
        }
        None => match depth.len() {
            1 if shortcuts => draw_all::<1>(blocks, view, fan, facing, draws, depth),
            2 if shortcuts => draw_all::<2>(blocks, view, fan, facing, draws, depth),
            3 if shortcuts => draw_all::<3>(blocks, view, fan, facing, draws, depth),
            4 if shortcuts => draw_all::<4>(blocks, view, fan, facing, draws, depth),
            _ => {
                for block in blocks {
                    facing.add(block, view, fan, draws, depth);
                }
            }
        },
    }
}

/// Draws all circles into the depth buffer of ranges.
#[inline(always)]
fn draw_circles(outlines: [&Outline; 2], shortcuts: bool, view: View, fan: &Fan, scratch: &mut Scratch) {
    let Scratch { depth, draws, walk, .. } = scratch;
    for outline in outlines {
        let blocks = outline.circles.blocks();
        match outline.circles.tree().filter(|_| shortcuts) {
            None => {
                for block in blocks {
                    circles::draw(block, view, fan, draws, depth);
                }
            }
            Some(tree) => {
                walk.start(tree, view, fan);
                while let Some(leaf) = walk.next(tree, view, fan, depth, Depth::Range) {
                    circles::draw(&blocks[leaf], view, fan, draws, depth);
                }
            }
        }
    }
}

#[inline(always)]
fn copy(depth: &[Lanes], ranges: &mut [f32]) {
    for (row, block) in ranges.chunks_exact_mut(BLOCK).zip(depth) {
        row.copy_from_slice(&block.0);
    }
}
