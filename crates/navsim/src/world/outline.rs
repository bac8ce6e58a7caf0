//! The outline of a set of shapes in arrays of single precision, as the scan kernels read it.

use super::shapes::{Shape, box_corners};

/// What the edge from one corner slot to the next is; as wide as the coordinates, so that loops over both vectorise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum Edge {
    /// No edge: the next slot belongs to another shape.
    None = 0,
    /// An edge of a solid shape, seen only from its right side (corners run counter-clockwise).
    Solid = 1,
    /// A wall, seen from both sides.
    Wall = 2,
}

/// Corners and circles of a set of shapes.
///
/// Corners of one shape follow each other; a closed shape repeats its first corner at the end, so that the edge of slot
/// i always runs from slot i to slot i + 1 and neighbours share bit-equal ends: no beam passes between them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outline {
    pub corner_x: Vec<f32>,
    pub corner_y: Vec<f32>,
    /// Difference to the next corner, rounded once from double precision.
    pub edge_x: Vec<f32>,
    pub edge_y: Vec<f32>,
    pub edge: Vec<Edge>,
    pub circle_x: Vec<f32>,
    pub circle_y: Vec<f32>,
    pub circle_radius: Vec<f32>,
}

impl Outline {
    /// Removes everything and keeps the memory.
    pub fn clear(&mut self) {
        for values in [
            &mut self.corner_x,
            &mut self.corner_y,
            &mut self.edge_x,
            &mut self.edge_y,
            &mut self.circle_x,
            &mut self.circle_y,
            &mut self.circle_radius,
        ] {
            values.clear();
        }
        self.edge.clear();
    }

    /// Adds a shape.
    pub fn push(&mut self, shape: &Shape) {
        match shape {
            Shape::Circle { center, radius } => {
                self.circle_x.push(center[0] as f32);
                self.circle_y.push(center[1] as f32);
                self.circle_radius.push(*radius as f32);
            }
            Shape::Box { center, yaw, length, width } => self.push_closed(&box_corners(*center, *yaw, *length, *width)),
            Shape::Segment { a, b } => {
                self.push_corner(*a, *b, Edge::Wall);
                self.push_corner(*b, *b, Edge::None);
            }
            Shape::Polygon { points } => self.push_closed(points),
        }
    }

    fn push_closed(&mut self, corners: &[[f64; 2]]) {
        for (i, corner) in corners.iter().enumerate() {
            self.push_corner(*corner, corners[(i + 1) % corners.len()], Edge::Solid);
        }
        self.push_corner(corners[0], corners[0], Edge::None);
    }

    fn push_corner(&mut self, corner: [f64; 2], next: [f64; 2], edge: Edge) {
        self.corner_x.push(corner[0] as f32);
        self.corner_y.push(corner[1] as f32);
        self.edge_x.push((next[0] - corner[0]) as f32);
        self.edge_y.push((next[1] - corner[1]) as f32);
        self.edge.push(edge);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_shape_repeats_its_first_corner_and_a_wall_has_one_edge() {
        let mut outline = Outline::default();
        outline.push(&Shape::Box { center: [1.0, 2.0], yaw: 0.3, length: 2.0, width: 1.0 });
        outline.push(&Shape::Segment { a: [0.0, 0.0], b: [1.0, 0.0] });
        outline.push(&Shape::Circle { center: [0.0, 0.0], radius: 1.0 });
        use Edge::{None, Solid, Wall};
        assert_eq!(outline.edge, [Solid, Solid, Solid, Solid, None, Wall, None]);
        assert_eq!(outline.corner_x[0].to_bits(), outline.corner_x[4].to_bits());
        assert_eq!(outline.circle_radius, [1.0]);
        outline.clear();
        assert!(outline.corner_x.is_empty() && outline.circle_x.is_empty());
    }
}
