//! A tree of boxes around blocks of what is scanned, so that a scan visits what it sees and not what exists.

use super::blocks::{BLOCK, Lanes};

/// Boxes are wider than what they hold by this (m) and by this part of its extent: more than the rounding errors of a
/// range, so that nothing in a box is ever computed nearer than the box is.
const SLACK: f32 = 1e-3;
const RELATIVE_SLACK: f32 = 1e-4;

/// Sixteen boxes. An unused place holds nothing: its low corner is above its high one.
#[derive(Debug, Clone)]
pub(crate) struct BoxBlock {
    /// Corner with the smallest coordinates, m.
    pub low: [Lanes; 2],
    /// Corner with the largest coordinates, m.
    pub high: [Lanes; 2],
}

/// Levels of boxes, sixteen to a box of the next level; the last level is one block.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    levels: Vec<Vec<BoxBlock>>,
}

impl Tree {
    /// The tree over leaves of `width` members each, whose bounds [x0, y0, x1, y1] (m) come in the order of `arrange`.
    pub fn new(members: impl Iterator<Item = [f32; 4]>, width: usize) -> Self {
        let mut boxes: Vec<[f32; 4]> = members.map(loosened).collect();
        let mut levels = Vec::new();
        boxes = boxes.chunks(width).map(union).collect();
        while levels.is_empty() || boxes.len() > 1 {
            levels.push(boxes.chunks(BLOCK).map(BoxBlock::new).collect());
            boxes = boxes.chunks(BLOCK).map(union).collect();
        }
        Self { levels }
    }

    /// Number of levels, at least 1.
    pub fn height(&self) -> usize {
        self.levels.len()
    }

    /// The boxes below box `index` of `level`, from 1 (whose boxes hold leaves) to `height` (the root, index 0).
    #[inline(always)]
    pub fn below(&self, level: usize, index: usize) -> &BoxBlock {
        &self.levels[level - 1][index]
    }
}

impl BoxBlock {
    fn new(boxes: &[[f32; 4]]) -> Self {
        let none = || [Lanes::all(f32::INFINITY); 2];
        let mut block = Self { low: none(), high: [Lanes::all(f32::NEG_INFINITY); 2] };
        for (lane, bounds) in boxes.iter().enumerate() {
            for axis in 0..2 {
                block.low[axis].0[lane] = bounds[axis];
                block.high[axis].0[lane] = bounds[axis + 2];
            }
        }
        block
    }
}

fn loosened([x0, y0, x1, y1]: [f32; 4]) -> [f32; 4] {
    let slack = SLACK + RELATIVE_SLACK * (x1 - x0).max(y1 - y0);
    [x0 - slack, y0 - slack, x1 + slack, y1 + slack]
}

fn union(boxes: &[[f32; 4]]) -> [f32; 4] {
    let start = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
    boxes.iter().fold(start, |[x0, y0, x1, y1], b| [x0.min(b[0]), y0.min(b[1]), x1.max(b[2]), y1.max(b[3])])
}

/// Puts members into an order where neighbours are near each other: halved again and again across the longer side, at
/// places where full boxes of the highest possible level end. Leaves hold `width` of them.
pub(crate) fn arrange<M: Copy>(members: &mut [M], width: usize, bounds: fn(&M) -> [f32; 4]) {
    let len = members.len();
    if len <= width {
        return;
    }
    let mut unit = width;
    while unit * BLOCK < len {
        unit *= BLOCK;
    }
    // Twice the centre does as well as the centre.
    let center = |member: &M, axis: usize| bounds(member)[axis] + bounds(member)[axis + 2];
    let spread = |axis: usize| {
        let (low, high) = members.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), member| {
            (low.min(center(member, axis)), high.max(center(member, axis)))
        });
        high - low
    };
    let axis = usize::from(spread(1) > spread(0));
    let middle = (len / 2).div_ceil(unit) * unit;
    members.select_nth_unstable_by(middle, |a, b| center(a, axis).total_cmp(&center(b, axis)));
    let (first, second) = members.split_at_mut(middle);
    arrange(first, width, bounds);
    arrange(second, width, bounds);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_box_holds_what_is_below_it() {
        for (count, width) in [1_usize, 16, 17, 300, 4097, 5000].into_iter().flat_map(|count| [(count, 16), (count, 8)])
        {
            let point = |i: usize| [(i * 7919 % 1000) as f32, (i * 104_729 % 997) as f32];
            let mut members: Vec<_> = (0..count).map(|i| (point(i), i)).collect();
            arrange(&mut members, width, |([x, y], _)| [*x, *y, *x, *y]);
            let mut seen: Vec<usize> = members.iter().map(|(_, i)| *i).collect();
            seen.sort_unstable();
            assert!(seen.iter().enumerate().all(|(i, j)| i == *j));
            let tree = Tree::new(members.iter().map(|([x, y], _)| [*x, *y, *x, *y]), width);
            let within = |block: &BoxBlock, lane: usize, point: [f32; 2]| {
                (0..2).all(|axis| block.low[axis].0[lane] < point[axis] && point[axis] < block.high[axis].0[lane])
            };
            for (place, (point, _)) in members.iter().enumerate() {
                let mut index = place / width;
                for level in 1..=tree.height() {
                    assert!(within(tree.below(level, index / BLOCK), index % BLOCK, *point));
                    index /= BLOCK;
                }
                assert_eq!(index, 0);
            }
        }
    }
}
