//! The outline of a set of shapes in arrays of single precision, as the scan kernels read it.

use super::blocks::{BLOCK, Blocks};
use super::shapes::Shape;
use crate::cpu::prefetch;

/// From this many blocks on, a tree beats one block after the other.
pub(super) const TREE_FROM: usize = 8;
/// Boxes to a block: of each one the lidar sees at most two faces, which fill a block of edges.
pub(crate) const BOXES: usize = BLOCK / 2;

/// Boxes, edges and circles of a set of shapes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outline {
    /// Boxes: centre x, y, and from there to the middle of the front x, y and of the left side x, y, m. An unused place
    /// is all zero.
    pub boxes: Blocks<6, BOXES>,
    /// Edges of polygons and walls: from x, y, to x, y (m), their difference along x, y (rounded once from double
    /// precision), and `back`.
    ///
    /// Neighbours share bit-equal ends, so that no beam passes between them. An edge is seen when the cross product
    /// from x along, as the lidar has it, is negative or greater than `back`: infinity for the edge of a solid, whose
    /// corners run counter-clockwise, 0 for a wall. An unused place is an edge without length, which is never seen.
    pub edges: Blocks<7>,
    /// Circles: centre x, y and radius, m. An unused place has radius 0.
    pub circles: Blocks<3>,
}

impl Outline {
    /// Removes everything and keeps the memory.
    pub fn clear(&mut self) {
        self.boxes.clear();
        self.edges.clear();
        self.circles.clear();
    }

    /// Asks for all of it to be brought near.
    pub fn prefetch(&self) {
        prefetch(self.boxes.blocks());
        prefetch(self.edges.blocks());
        prefetch(self.circles.blocks());
    }

    /// Adds a shape.
    pub fn push(&mut self, shape: &Shape) {
        match shape {
            Shape::Circle { center, radius } => {
                self.circles.push([center[0] as f32, center[1] as f32, *radius as f32]);
            }
            Shape::Box { center, yaw, length, width } => self.push_box(*center, *yaw, 0.5 * length, 0.5 * width),
            Shape::Segment { a, b } => self.push_edge(*a, *b, 0.0),
            Shape::Polygon { points } => self.push_closed(points),
        }
    }

    /// Builds trees where there is enough for them.
    pub fn build_trees(&mut self) {
        if self.boxes.blocks().len() >= TREE_FROM {
            self.boxes.build_tree(|[x, y, along_x, along_y, across_x, across_y]| {
                let (width, height) = (along_x.abs() + across_x.abs(), along_y.abs() + across_y.abs());
                [x - width, y - height, x + width, y + height]
            });
        }
        if self.edges.blocks().len() >= TREE_FROM {
            self.edges.build_tree(|[ax, ay, bx, by, ..]| [ax.min(*bx), ay.min(*by), ax.max(*bx), ay.max(*by)]);
        }
        if self.circles.blocks().len() >= TREE_FROM {
            self.circles.build_tree(|[x, y, radius]| [x - radius, y - radius, x + radius, y + radius]);
        }
    }

    fn push_box(&mut self, center: [f64; 2], yaw: f64, half_length: f64, half_width: f64) {
        let (sin, cos) = libm::sincos(yaw);
        let [x, y] = center.map(|c| c as f32);
        let (along_x, along_y) = ((half_length * cos) as f32, (half_length * sin) as f32);
        let (across_x, across_y) = ((-half_width * sin) as f32, (half_width * cos) as f32);
        self.boxes.push([x, y, along_x, along_y, across_x, across_y]);
    }

    fn push_closed(&mut self, corners: &[[f64; 2]]) {
        for (i, corner) in corners.iter().enumerate() {
            let next = if i + 1 < corners.len() { i + 1 } else { 0 };
            self.push_edge(*corner, corners[next], f32::INFINITY);
        }
    }

    fn push_edge(&mut self, from: [f64; 2], to: [f64; 2], back: f32) {
        let along = [(to[0] - from[0]) as f32, (to[1] - from[1]) as f32];
        self.edges.push([from[0] as f32, from[1] as f32, to[0] as f32, to[1] as f32, along[0], along[1], back]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Block;

    #[test]
    fn neighbours_share_their_ends_and_a_wall_has_one_edge() {
        let mut outline = Outline::default();
        outline.push(&Shape::Polygon { points: vec![[0.1, 0.2], [2.3, 0.4], [0.5, 1.7]] });
        outline.push(&Shape::Segment { a: [0.0, 0.0], b: [1.0, 0.0] });
        outline.push(&Shape::Circle { center: [0.0, 0.0], radius: 1.0 });
        let Block([from_x, from_y, to_x, to_y, along_x, along_y, back]) = &outline.edges.blocks()[0];
        for (from, to) in [(from_x, to_x), (from_y, to_y)] {
            assert_eq!([to[0], to[1], to[2]], [from[1], from[2], from[0]]);
        }
        assert_eq!(back[..5], [f32::INFINITY, f32::INFINITY, f32::INFINITY, 0.0, 0.0]);
        assert_eq!((along_x[3], along_y[3]), (1.0, 0.0));
        assert!(along_x[4..].iter().chain(&along_y[4..]).all(|e| *e == 0.0));
        assert_eq!(outline.circles.blocks()[0].0[2][..2], [1.0, 0.0]);
        outline.clear();
        assert!(outline.edges.blocks().is_empty() && outline.circles.blocks().is_empty());
    }

    #[test]
    fn a_box_is_its_centre_and_two_half_sides() {
        let mut outline = Outline::default();
        outline.push(&Shape::Box { center: [1.0, 2.0], yaw: std::f64::consts::FRAC_PI_2, length: 3.0, width: 1.0 });
        let member = |i: usize| outline.boxes.blocks()[0].0.map(|row| row[i]);
        let near = |a: [f32; 6], b: [f32; 6]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-7);
        assert!(near(member(0), [1.0, 2.0, 0.0, 1.5, -0.5, 0.0]));
        assert_eq!(member(1), [0.0; 6]);
    }
}
