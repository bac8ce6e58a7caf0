//! The outline of a set of shapes in arrays of single precision, as the scan kernels read it.

use super::shapes::{Shape, box_corners};
use crate::lidar::prefetch;

/// Edges, circles and beams are handled in blocks of this many: one AVX-512 register, two of AVX2, four of the baseline.
pub(crate) const BLOCK: usize = 16;

/// One number for each member of a block, where a register of the widest kind loads it at once.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(crate) struct Lanes(pub [f32; BLOCK]);

impl Lanes {
    /// The same number everywhere.
    pub const fn all(value: f32) -> Self {
        Self([value; BLOCK])
    }
}

/// Sixteen edges. Neighbours share bit-equal ends, so that no beam passes between them. An unused place is an edge
/// without length, which no lidar sees.
#[derive(Debug, Clone)]
pub(crate) struct EdgeBlock {
    /// One end, m.
    pub from: [Lanes; 2],
    /// The other end, m.
    pub to: [Lanes; 2],
    /// Difference of the ends, rounded once from double precision, m.
    pub along: [Lanes; 2],
    /// The edge is seen when from x along, as the lidar has it, is negative or greater than this: infinity for the edge
    /// of a solid, whose corners run counter-clockwise, zero for a wall.
    pub back: Lanes,
}

/// Sixteen circles. An unused place has radius 0.
#[derive(Debug, Clone)]
pub(crate) struct CircleBlock {
    /// Centre, m.
    pub center: [Lanes; 2],
    /// Radius, m.
    pub radius: Lanes,
}

/// Edges and circles of a set of shapes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outline {
    edges: Vec<EdgeBlock>,
    edge_count: usize,
    circles: Vec<CircleBlock>,
    circle_count: usize,
}

impl Outline {
    /// Removes everything and keeps the memory.
    pub fn clear(&mut self) {
        self.edges.clear();
        self.circles.clear();
        (self.edge_count, self.circle_count) = (0, 0);
    }

    /// Asks for all of it to be brought near.
    pub fn prefetch(&self) {
        prefetch(&self.edges);
        prefetch(&self.circles);
    }

    /// All edges; only the last block has unused places.
    pub fn edges(&self) -> &[EdgeBlock] {
        &self.edges
    }

    /// All circles; only the last block has unused places.
    pub fn circles(&self) -> &[CircleBlock] {
        &self.circles
    }

    /// Adds a shape.
    pub fn push(&mut self, shape: &Shape) {
        match shape {
            Shape::Circle { center, radius } => self.push_circle(*center, *radius),
            Shape::Box { center, yaw, length, width } => self.push_closed(&box_corners(*center, *yaw, *length, *width)),
            Shape::Segment { a, b } => self.push_edge(*a, *b, 0.0),
            Shape::Polygon { points } => self.push_closed(points),
        }
    }

    fn push_closed(&mut self, corners: &[[f64; 2]]) {
        for (i, corner) in corners.iter().enumerate() {
            let next = if i + 1 < corners.len() { i + 1 } else { 0 };
            self.push_edge(*corner, corners[next], f32::INFINITY);
        }
    }

    fn push_edge(&mut self, from: [f64; 2], to: [f64; 2], back: f32) {
        const NONE: [Lanes; 2] = [Lanes::all(0.0); 2];
        let lane = self.edge_count % BLOCK;
        if lane == 0 {
            self.edges.push(EdgeBlock { from: NONE, to: NONE, along: NONE, back: Lanes::all(0.0) });
        }
        self.edge_count += 1;
        if let Some(block) = self.edges.last_mut() {
            for axis in 0..2 {
                block.from[axis].0[lane] = from[axis] as f32;
                block.to[axis].0[lane] = to[axis] as f32;
                block.along[axis].0[lane] = (to[axis] - from[axis]) as f32;
            }
            block.back.0[lane] = back;
        }
    }

    fn push_circle(&mut self, center: [f64; 2], radius: f64) {
        let lane = self.circle_count % BLOCK;
        if lane == 0 {
            self.circles.push(CircleBlock { center: [Lanes::all(0.0); 2], radius: Lanes::all(0.0) });
        }
        self.circle_count += 1;
        if let Some(block) = self.circles.last_mut() {
            (block.center[0].0[lane], block.center[1].0[lane]) = (center[0] as f32, center[1] as f32);
            block.radius.0[lane] = radius as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_share_their_ends_and_a_wall_has_one_edge() {
        let mut outline = Outline::default();
        outline.push(&Shape::Box { center: [1.0, 2.0], yaw: 0.3, length: 2.0, width: 1.0 });
        outline.push(&Shape::Segment { a: [0.0, 0.0], b: [1.0, 0.0] });
        outline.push(&Shape::Circle { center: [0.0, 0.0], radius: 1.0 });
        let edges = &outline.edges()[0];
        assert_eq!(edges.back.0[..6], [f32::INFINITY, f32::INFINITY, f32::INFINITY, f32::INFINITY, 0.0, 0.0]);
        for axis in 0..2 {
            let (from, to) = (edges.from[axis].0, edges.to[axis].0);
            assert_eq!([to[0], to[1], to[2], to[3]], [from[1], from[2], from[3], from[0]]);
            assert!(edges.along[axis].0[5..].iter().all(|e| *e == 0.0));
        }
        assert_eq!((outline.circles()[0].radius.0[0], outline.circles()[0].radius.0[1]), (1.0, 0.0));
        outline.clear();
        assert!(outline.edges().is_empty() && outline.circles().is_empty());
    }
}
