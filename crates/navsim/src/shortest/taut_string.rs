//! The shortest taut string around grown obstacles, by A*.
//!
//! A shortest path is made of straight legs that touch the arcs about the corners of the obstacles, and of pieces of
//! those arcs (Liu and Arimoto, "Path planning using a tangent graph for mobile robots among polygonal and curved
//! obstacles", IJRR 11, 1992). Legs are made when an arc is reached, and checked against the obstacles when their turn
//! comes.

use super::lower_bound::LowerBound;
use crate::grown::{Corner, GrownWorld, Point, along, apart, sweep};
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::TAU;

/// Angle (rad) that rounding may add to an arc.
const ANGLE_ROUNDING: f64 = 1e-6;
/// Length (m) that rounding may add to a path.
const LENGTH_ROUNDING: f64 = 1e-12;

/// What a leg leads to.
#[derive(Debug, Clone, Copy)]
enum Arrival {
    Goal,
    /// The arc about a corner, at `angle` (rad), followed counter-clockwise if `turn` is 1, clockwise if it is -1.
    Bend {
        corner: usize,
        turn: f64,
        angle: f64,
    },
}

/// A straight leg that may still turn out to be blocked.
#[derive(Debug)]
struct Leg {
    /// Length of the path up to the leg's end, m.
    length: f64,
    /// Lower bound of the length of a whole path with this leg, m.
    whole: f64,
    from: Point,
    to: Point,
    arrival: Arrival,
}

impl Ord for Leg {
    /// The shortest is the greatest: `BinaryHeap` hands out the greatest first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.whole.total_cmp(&self.whole)
    }
}

impl PartialOrd for Leg {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Leg {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Leg {}

/// A piece of an arc that was followed: from `angle` as far as `sweep` (rad), at `length` (m) from the start.
#[derive(Debug, Clone, Copy)]
struct Passage {
    angle: f64,
    sweep: f64,
    length: f64,
}

/// Where a path leaves an arc: anywhere within `sweep` (rad) from `angle`, `length` (m) from the start.
#[derive(Debug, Clone, Copy)]
struct Departure {
    corner: Corner,
    turn: f64,
    passage: Passage,
}

/// A* over the taut legs, among paths no longer than a bound.
#[derive(Debug)]
pub(super) struct Search<'a> {
    world: &'a GrownWorld,
    lower: &'a LowerBound<'a>,
    /// Points where a path may end that does not run straight at the goal's centre.
    ends: Vec<Point>,
    /// Lower bounds of the distance (m) to the goal from the arc about each corner.
    remaining: Vec<f64>,
    legs: BinaryHeap<Leg>,
    /// Passages of each corner, clockwise and counter-clockwise.
    passages: Vec<[Vec<Passage>; 2]>,
    /// Longest path that is followed, m.
    bound: f64,
    /// Whether a leg was left out because of the bound.
    cut: bool,
}

impl<'a> Search<'a> {
    pub fn new(world: &'a GrownWorld, lower: &'a LowerBound<'a>) -> Self {
        let remaining = world.corners().iter().map(|corner| lower.remaining_from(corner)).collect();
        let passages = vec![[Vec::new(), Vec::new()]; world.corners().len()];
        let (ends, legs) = (lower.goal.ends(), BinaryHeap::new());
        Self { world, lower, ends, remaining, legs, passages, bound: 0.0, cut: false }
    }

    /// Length (m) of the shortest path from `start`, which must be free and outside the goal disc.
    ///
    /// Tries growing bounds: a search within a tight one looks at few legs.
    pub fn run(mut self, start: Point) -> Option<f64> {
        for growth in [1.06, 1.15, 1.4, 2.0, f64::INFINITY] {
            self.bound = growth * self.lower.remaining(start) + 4.0 * self.lower.cell();
            self.cut = false;
            self.legs.clear();
            self.passages.iter_mut().flatten().for_each(Vec::clear);
            let length = self.within_bound(start);
            if length.is_some() || !self.cut {
                return length;
            }
        }
        None
    }

    fn within_bound(&mut self, start: Point) -> Option<f64> {
        let passage = Passage { angle: 0.0, sweep: TAU, length: 0.0 };
        self.depart(&Departure { corner: Corner { center: start, reach: 0.0 }, turn: 1.0, passage });
        while let Some(leg) = self.legs.pop() {
            match leg.arrival {
                Arrival::Goal => {
                    if self.world.segment_is_free(leg.from, leg.to) {
                        return Some(leg.length);
                    }
                }
                Arrival::Bend { corner, turn, angle } => {
                    if !self.is_known(corner, turn, angle, leg.length) && self.world.segment_is_free(leg.from, leg.to) {
                        self.bend(corner, turn, angle, leg.length);
                    }
                }
            }
        }
        None
    }

    fn passages_of(&mut self, corner: usize, turn: f64) -> &mut Vec<Passage> {
        &mut self.passages[corner][usize::from(turn > 0.0)]
    }

    /// Whether an earlier path passes here on the same arc and is no longer.
    fn is_known(&mut self, corner: usize, turn: f64, angle: f64, length: f64) -> bool {
        let reach = self.world.corners()[corner].reach;
        self.passages_of(corner, turn).iter().any(|passage| {
            let swept = snapped(sweep(passage.angle, angle, turn));
            swept <= passage.sweep && passage.length + reach * swept <= length + LENGTH_ROUNDING
        })
    }

    /// Follows an arc and leaves it wherever that leads on, up to where an earlier path does.
    fn bend(&mut self, index: usize, turn: f64, angle: f64, length: f64) {
        let corner = self.world.corners()[index];
        let free = self.world.free_sweep(&corner, angle, turn);
        let mut until = free;
        for passage in self.passages_of(index, turn).iter() {
            let swept = sweep(angle, passage.angle, turn);
            if swept < until && passage.length <= length + corner.reach * swept + LENGTH_ROUNDING {
                until = swept;
            }
        }
        self.passages_of(index, turn).push(Passage { angle, sweep: free, length });
        self.depart(&Departure { corner, turn, passage: Passage { angle, sweep: until, length } });
    }

    /// Queues the legs from an arc, or from the start, to all arcs and to the goal.
    fn depart(&mut self, departure: &Departure) {
        let world = self.world;
        let Departure { corner: Corner { center, reach }, passage, .. } = *departure;
        for (index, corner) in world.corners().iter().enumerate() {
            let straight = apart(center, corner.center) - reach - corner.reach;
            if passage.length + straight + self.remaining[index] > self.bound {
                self.cut = true;
                continue;
            }
            for turn in [-1.0, 1.0] {
                if let Some(leg) = Tangent::new(departure, corner, turn) {
                    let rest = self.lower.remaining(leg.to);
                    if passage.length + leg.length + rest > self.bound {
                        self.cut = true;
                    } else if let Some(swept) = leg.swept(departure) {
                        let angle = libm::atan2(leg.to[1] - corner.center[1], leg.to[0] - corner.center[0]);
                        let length = passage.length + reach * swept + leg.length;
                        self.queue(&leg, length, rest, Arrival::Bend { corner: index, turn, angle });
                    }
                }
            }
        }
        for index in 0..=self.ends.len() {
            let goal = self.lower.goal;
            let (end, short) = if index == 0 { (goal.center, goal.radius) } else { (self.ends[index - 1], 0.0) };
            let Some(mut leg) = Tangent::new(departure, &Corner { center: end, reach: 0.0 }, 1.0) else { continue };
            let Some(swept) = leg.swept(departure) else { continue };
            let straight = (leg.length - short).max(0.0);
            leg.to = if straight > 0.0 { along(leg.from, leg.to, straight) } else { leg.from };
            self.queue(&leg, passage.length + reach * swept + straight, 0.0, Arrival::Goal);
        }
    }

    /// Queues a leg that ends at `length` (m) with at least `rest` (m) to go, if that stays within the bound.
    fn queue(&mut self, leg: &Tangent, length: f64, rest: f64, arrival: Arrival) {
        let whole = length + rest;
        if whole > self.bound {
            self.cut = true;
        } else {
            self.legs.push(Leg { length, whole, from: leg.from, to: leg.to, arrival });
        }
    }
}

/// An angle (rad, 0 to 2 pi) without the turn that rounding may have made of nothing.
fn snapped(angle: f64) -> f64 {
    if angle > TAU - ANGLE_ROUNDING { 0.0 } else { angle }
}

/// The straight line that leaves one arc and touches another.
#[derive(Debug)]
struct Tangent {
    from: Point,
    to: Point,
    /// m.
    length: f64,
}

impl Tangent {
    /// The tangent from the arc of `departure` that goes on about `to` with `turn`. `None` if one disc holds the other
    /// or they overlap between two opposite turns.
    fn new(departure: &Departure, to: &Corner, turn: f64) -> Option<Self> {
        let Corner { center, reach } = departure.corner;
        let offset = [to.center[0] - center[0], to.center[1] - center[1]];
        let apart = (offset[0] * offset[0] + offset[1] * offset[1]).sqrt();
        // With l the unit normal to the left of the leg, it touches at center - turn reach l, so that
        // (to.center - center) . l = turn_2 reach_2 - turn_1 reach_1.
        let (first, second) = (departure.turn * reach, turn * to.reach);
        let sine = (second - first) / apart;
        if apart == 0.0 || sine.abs() > 1.0 + ANGLE_ROUNDING {
            return None;
        }
        let sine = sine.clamp(-1.0, 1.0);
        let cosine = (1.0 - sine * sine).sqrt();
        let [x, y] = [offset[0] / apart, offset[1] / apart];
        let left = [sine * x - cosine * y, sine * y + cosine * x];
        let touch = |center: Point, reach: f64| [center[0] - reach * left[0], center[1] - reach * left[1]];
        Some(Self { from: touch(center, first), to: touch(to.center, second), length: cosine * apart })
    }

    /// The angle (rad) on the arc before it is left; `None` if that is more than the departure allows.
    fn swept(&self, departure: &Departure) -> Option<f64> {
        let Departure { corner: Corner { center, reach }, turn, passage } = *departure;
        if reach == 0.0 {
            return Some(0.0);
        }
        let leaves = libm::atan2(self.from[1] - center[1], self.from[0] - center[0]);
        let swept = snapped(sweep(passage.angle, leaves, turn));
        (swept <= passage.sweep + ANGLE_ROUNDING).then_some(swept)
    }
}
