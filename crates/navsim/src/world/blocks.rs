//! Rows of numbers in blocks of members, as the scan kernels read them.

use super::tree::{Tree, arrange};

/// Edges, circles and beams are handled in blocks of this many: one AVX-512 register, two of AVX2, four of the
/// baseline.
pub(crate) const BLOCK: usize = 16;

/// One number for each member of a block, where the widest register loads it at once.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(crate) struct Lanes(pub [f32; BLOCK]);

impl Lanes {
    /// The same number everywhere.
    pub const fn all(value: f32) -> Self {
        Self([value; BLOCK])
    }
}

/// The larger of two numbers that are not negative: their bits are in the same order, and with integers the compiler
/// writes whole blocks. With a comparison it writes parts of them, for which the next read of the block has to wait.
#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    f32::from_bits((a.to_bits() as i32).max(b.to_bits() as i32) as u32)
}

/// The smaller of two numbers that are not negative, as `larger`.
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    f32::from_bits((a.to_bits() as i32).min(b.to_bits() as i32) as u32)
}

/// `ROWS` numbers of each of `WIDTH` members, row by row, from the start of a cache line on.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(crate) struct Block<const ROWS: usize, const WIDTH: usize>(pub [[f32; WIDTH]; ROWS]);

/// Members of `ROWS` numbers each, `WIDTH` to a block; unused places of the last block are zero.
#[derive(Debug, Clone)]
pub(crate) struct Blocks<const ROWS: usize, const WIDTH: usize = BLOCK> {
    blocks: Vec<Block<ROWS, WIDTH>>,
    len: usize,
    tree: Option<Box<Tree>>,
}

impl<const ROWS: usize, const WIDTH: usize> Default for Blocks<ROWS, WIDTH> {
    fn default() -> Self {
        Self { blocks: Vec::new(), len: 0, tree: None }
    }
}

impl<const ROWS: usize, const WIDTH: usize> Blocks<ROWS, WIDTH> {
    /// Removes everything and keeps the memory.
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.len = 0;
        self.tree = None;
    }

    /// Makes place for `members`, and for no more: what many robots have should lie close together.
    pub fn reserve(&mut self, members: usize) {
        self.blocks.reserve_exact((self.len + members).div_ceil(WIDTH) - self.blocks.len());
    }

    /// Adds a member.
    pub fn push(&mut self, member: [f32; ROWS]) {
        let lane = self.len % WIDTH;
        if lane == 0 {
            self.blocks.push(Block([[0.0; WIDTH]; ROWS]));
        }
        if let Some(block) = self.blocks.last_mut() {
            for (row, value) in block.0.iter_mut().zip(member) {
                row[lane] = value;
            }
        }
        self.len += 1;
        self.tree = None;
    }

    /// Number of members.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The blocks.
    #[inline(always)]
    pub fn blocks(&self) -> &[Block<ROWS, WIDTH>] {
        &self.blocks
    }

    /// The tree whose leaves are the blocks, after `build_tree`.
    #[inline(always)]
    pub fn tree(&self) -> Option<&Tree> {
        self.tree.as_deref()
    }

    /// Reorders the members by place and builds a tree over them; `bounds` gives a member's [x0, y0, x1, y1], m. The
    /// next `push` removes the tree.
    pub fn build_tree(&mut self, bounds: fn(&[f32; ROWS]) -> [f32; 4]) {
        let member = |i: usize| self.blocks[i / WIDTH].0.map(|row| row[i % WIDTH]);
        let mut members: Vec<[f32; ROWS]> = (0..self.len).map(member).collect();
        arrange(&mut members, WIDTH, bounds);
        self.clear();
        for member in &members {
            self.push(*member);
        }
        self.tree = Some(Box::new(Tree::new(members.iter().map(bounds), WIDTH)));
    }
}
