//! Distances to the nearest point on a small grid around the robot, for controllers that ask at very many places.

use super::scene::Scene;
use crate::cpu::whole;

/// Cells of a side, at most.
const CELLS_MAX: usize = 256;

/// A square of cell corners about the robot's centre; between corners the distance is interpolated.
#[derive(Debug, Clone)]
pub(super) struct ClearanceMap {
    half: f32,
    /// Cells in a metre.
    per_metre: f32,
    side: usize,
    /// Coordinate (m) of each column, and of each row.
    places: Vec<f32>,
    /// Farther than this (m) from every point is far enough.
    reach: f32,
    distance: Vec<f32>,
}

impl ClearanceMap {
    /// A map of at least `half` metres to every side in cells of about `cell` metres, which knows distances to `reach`.
    pub fn new(half: f32, cell: f32, reach: f32) -> Self {
        let cells = (libm::ceilf(2.0 * half / cell) as usize).clamp(2, CELLS_MAX - 1);
        let side = cells + 1;
        let cell = 2.0 * half / cells as f32;
        let places = (0..side).map(|i| i as f32 * cell - half).collect();
        Self { half, per_metre: 1.0 / cell, side, places, reach, distance: vec![reach; side * side] }
    }

    /// Enters the points: every corner gets the distance (m) to the nearest, at most `reach`.
    #[inline(always)]
    pub fn fill(&mut self, scene: &Scene) {
        let Self { half, per_metre, side, reach, .. } = *self;
        self.distance.fill(reach * reach);
        let place = |offset: f32| whole(((offset + half) * per_metre).clamp(0.0, (side - 1) as f32)) as usize;
        for [x, y] in scene.points() {
            if x.abs() > half + reach || y.abs() > half + reach {
                continue;
            }
            let columns = place(x - reach)..place(x + reach) + 1;
            for row in place(y - reach)..place(y + reach) + 1 {
                let dy = self.places[row] - y;
                let corners = &mut self.distance[row * side..(row + 1) * side][columns.clone()];
                for (square, column) in corners.iter_mut().zip(&self.places[columns.clone()]) {
                    let dx = column - x;
                    let new = dx * dx + dy * dy;
                    *square = if new < *square { new } else { *square };
                }
            }
        }
        for square in &mut self.distance {
            *square = square.sqrt();
        }
    }

    /// Distances (m) from each (x, y) to the nearest point, interpolated; outside of the map those of its border.
    #[inline(always)]
    pub fn at<const N: usize>(&self, x: &[f32; N], y: &[f32; N]) -> [f32; N] {
        let most = (self.side - 1) as f32 - 1e-3;
        let (mut u, mut v, mut corner) = ([0.0; N], [0.0; N], [0; N]);
        for i in 0..N {
            let place = |offset: f32| {
                let place = (offset + self.half) * self.per_metre;
                let place = if place > 0.0 { place } else { 0.0 };
                if place < most { place } else { most }
            };
            let (column, row) = (place(x[i]), place(y[i]));
            let (left, below) = (whole(column), whole(row));
            (u[i], v[i]) = (column - left as f32, row - below as f32);
            corner[i] = below * self.side as i32 + left;
        }
        let (mut below, mut above) = ([[0.0; N]; 2], [[0.0; N]; 2]);
        for i in 0..N {
            let corners = &self.distance[corner[i] as usize..][..self.side + 2];
            (below[0][i], below[1][i]) = (corners[0], corners[1]);
            (above[0][i], above[1][i]) = (corners[self.side], corners[self.side + 1]);
        }
        let mut distance = [0.0; N];
        for i in 0..N {
            let below = below[0][i] + u[i] * (below[1][i] - below[0][i]);
            let above = above[0][i] + u[i] * (above[1][i] - above[0][i]);
            distance[i] = below + v[i] * (above - below);
        }
        distance
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
            let error = map.at(&[x], &[y])[0] - exact;
            // Over a cell of side h, a cone r from its tip is interpolated too high by h^2 / (4 r) at most, and near
            // the tip by half a diagonal; the edge between two cones is cut off by half a diagonal at most.
            let high = if exact < 0.2 { 0.036 } else { 0.05 * 0.05 / (4.0 * (exact - 0.036)) };
            assert!(error <= high + 1e-5 && error >= -0.036, "{exact}: {error}");
        }
    }
}
