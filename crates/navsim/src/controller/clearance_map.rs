//! Distances to the nearest point on a small grid around the robot, for controllers that ask at very many places.

use super::scene::Scene;

/// Cells of a side, at most.
const CELLS_MAX: usize = 256;

/// A square of cell corners about the robot's centre; between corners the distance is interpolated.
#[derive(Debug, Clone)]
pub(super) struct ClearanceMap {
    half: f32,
    cell: f32,
    side: usize,
    /// Farther than this (m) from every point is far enough.
    reach: f32,
    distance: Vec<f32>,
}

impl ClearanceMap {
    /// A map of at least `half` metres to every side in cells of about `cell` metres, which knows distances to `reach`.
    pub fn new(half: f32, cell: f32, reach: f32) -> Self {
        let cells = (libm::ceilf(2.0 * half / cell) as usize).clamp(2, CELLS_MAX - 1);
        let side = cells + 1;
        Self { half, cell: 2.0 * half / cells as f32, side, reach, distance: vec![reach; side * side] }
    }

    /// Enters the points: every corner gets the distance (m) to the nearest, at most `reach`.
    pub fn fill(&mut self, scene: &Scene) {
        let Self { half, cell, side, reach, .. } = *self;
        self.distance.fill(reach * reach);
        let place = |offset: f32| ((offset + half) / cell).clamp(0.0, (side - 1) as f32);
        for [x, y] in scene.points() {
            if x.abs() > half + reach || y.abs() > half + reach {
                continue;
            }
            let columns = place(x - reach) as usize..place(x + reach) as usize + 1;
            for row in place(y - reach) as usize..place(y + reach) as usize + 1 {
                let dy = row as f32 * cell - half - y;
                let corners = &mut self.distance[row * side..(row + 1) * side][columns.clone()];
                for (i, square) in corners.iter_mut().enumerate() {
                    let dx = (columns.start + i) as f32 * cell - half - x;
                    let new = dx * dx + dy * dy;
                    *square = if new < *square { new } else { *square };
                }
            }
        }
        self.distance.iter_mut().for_each(|square| *square = square.sqrt());
    }

    /// Distance (m) from (x, y) to the nearest point, interpolated; outside of the map that of its border.
    #[inline(always)]
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let place = |offset: f32| ((offset + self.half) / self.cell).clamp(0.0, (self.side - 1) as f32 - 1e-3);
        let (u, v) = (place(x), place(y));
        let (column, row) = (u as usize, v as usize);
        let (u, v) = (u - column as f32, v - row as f32);
        let corners = &self.distance[row * self.side + column..];
        let below = corners[0] + u * (corners[1] - corners[0]);
        let above = corners[self.side] + u * (corners[self.side + 1] - corners[self.side]);
        below + v * (above - below)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_to_the_nearest_point() {
        use crate::rng::{Purpose, Split, Stream, StreamName};
        let mut random = Stream::new(StreamName::new(1, Purpose::World, Split::Test, 0, 0));
        let mut draw = |n: usize| (0..n).map(|_| random.uniform(-2.5, 2.5) as f32).collect::<Vec<_>>();
        let scene = Scene { x: draw(40), y: draw(40) };
        let mut map = ClearanceMap::new(1.5, 0.05, 0.8);
        map.fill(&Scene { x: vec![0.0], y: vec![0.0] });
        map.fill(&scene);
        for (x, y) in draw(500).into_iter().zip(draw(500)) {
            let (x, y) = (0.6 * x, 0.6 * y);
            let exact = scene.points().fold(0.8, |least: f32, [px, py]| least.min(libm::hypotf(x - px, y - py)));
            let error = map.at(x, y) - exact;
            // Over a cell of side h, a cone r from its tip is interpolated too high by h^2 / (4 r) at most, and near
            // the tip by half a diagonal; the edge between two cones is cut off by half a diagonal at most.
            let high = if exact < 0.2 { 0.036 } else { 0.05 * 0.05 / (4.0 * (exact - 0.036)) };
            assert!(error <= high + 1e-5 && error >= -0.036, "{exact}: {error}");
        }
    }
}
