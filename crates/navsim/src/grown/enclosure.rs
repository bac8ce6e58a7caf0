//! Which points are cut off from a start: exact, and much faster than a search that fails.
//!
//! Grown shapes are convex, so two that overlap are joined by a line within both. A start is cut off from an end just
//! if some closed chain of overlapping shapes goes round one of them and not round the other an odd number of times.
//! All such chains are sums of those that a spanning forest of the overlaps closes with one more overlap each.

use super::points::Point;
use super::world::{GrownWorld, Joint};

/// Ends that are looked at together, one bit each beside the start's.
const TOGETHER: usize = 63;

/// For each of `ends`: whether the grown shapes cut it off from `start`. All points must be free.
pub(crate) fn cut_off(world: &GrownWorld, joints: &[Joint], start: Point, ends: &[Point]) -> Vec<bool> {
    ends.chunks(TOGETHER).flat_map(|ends| few_cut_off(world, joints, start, ends)).collect()
}

/// `cut_off` of `TOGETHER` ends at most.
fn few_cut_off(world: &GrownWorld, joints: &[Joint], start: Point, ends: &[Point]) -> Vec<bool> {
    let points: Vec<Point> = std::iter::once(start).chain(ends.iter().copied()).collect();
    let mut forest = Forest { parents: (0..world.shapes().len()).collect(), turns: vec![0; world.shapes().len()] };
    let mut apart = 0u64;
    for joint in joints {
        let [first, second] = joint.shapes.map(|index| world.shapes()[index].center);
        let chain = [first, joint.from, joint.to, second];
        let crossed = chain.windows(2).fold(0, |bits, line| bits ^ rays_crossed(line[0], line[1], &points));
        if let Some(around) = forest.join(joint.shapes, crossed) {
            apart |= if around & 1 == 1 { !around } else { around };
        }
    }
    (1..=ends.len()).map(|bit| apart >> bit & 1 == 1).collect()
}

/// Bit i: whether the line `a`-`b` crosses the ray that goes up from point i. Over a closed chain of lines the sum
/// tells whether it goes round the point; a ray through a corner of the chain counts once.
fn rays_crossed(a: Point, b: Point, points: &[Point]) -> u64 {
    let (left, right) = if a[0] < b[0] { (a, b) } else { (b, a) };
    let mut bits = 0;
    for (bit, point) in points.iter().enumerate() {
        if left[0] <= point[0] && point[0] < right[0] {
            let height = left[1] + (right[1] - left[1]) * ((point[0] - left[0]) / (right[0] - left[0]));
            bits |= u64::from(height > point[1]) << bit;
        }
    }
    bits
}

/// Trees of overlapping shapes, with the rays that are crossed on the way from a shape to its parent.
struct Forest {
    parents: Vec<usize>,
    turns: Vec<u64>,
}

impl Forest {
    /// The root of a shape and the rays crossed on the way to it.
    fn root(&mut self, shape: usize) -> (usize, u64) {
        let (mut root, mut turns) = (shape, 0);
        while self.parents[root] != root {
            turns ^= self.turns[root];
            root = self.parents[root];
        }
        let (mut next, mut rest) = (shape, turns);
        while self.parents[next] != next {
            let (parent, own) = (self.parents[next], self.turns[next]);
            (self.parents[next], self.turns[next]) = (root, rest);
            rest ^= own;
            next = parent;
        }
        (root, turns)
    }

    /// Joins two shapes by a line that crosses the rays `crossed`; what the chain goes round, if that closes one.
    fn join(&mut self, [first, second]: [usize; 2], crossed: u64) -> Option<u64> {
        let ((a, to_a), (b, to_b)) = (self.root(first), self.root(second));
        let around = to_a ^ to_b ^ crossed;
        if a == b {
            return Some(around);
        }
        (self.parents[a], self.turns[a]) = (b, around);
        None
    }
}
