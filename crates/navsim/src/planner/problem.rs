//! What a planner is asked: from a start into a goal circle, at a clearance from every shape, and whether that can be.

use super::plan::Status;
use crate::error::Result;
use crate::grown::{GoalDisc, GrownShape, GrownWorld, Point, along, apart, bounds};
use crate::world::Scenario;

/// Clearance (m) on top of what is asked: more than the rounding that the exact tests forgive, so that a path keeps
/// what is stated.
const GUARD: f64 = 2e-9;
/// Share of the goal's radius by which a path ends within the circle: who reaches its end has reached the goal.
const DEPTH: f64 = 1e-3;

/// A known world for one way.
#[derive(Debug)]
pub(crate) struct Problem {
    /// The obstacles grown by the clearance.
    pub world: GrownWorld,
    /// Every place that a path may need: [x0, y0, x1, y1], m.
    pub bounds: [f64; 4],
    pub start: Point,
    pub goal: Point,
    /// Distance (m) from the goal at which a path ends.
    pub goal_radius: f64,
    /// Distance (m) that the centre of the robot keeps from every shape.
    pub clearance: f64,
}

impl Problem {
    /// The way of `scenario` at a `clearance` (m, > 0) of the robot's centre from every shape: its radius, for
    /// a rectangle that of the circle around it, and what it shall keep beyond. `room` (m, >= 0) is left free around
    /// all shapes beside what the robot needs to drive around them.
    ///
    /// # Errors
    /// What `Scenario::validate` refuses.
    pub fn new(scenario: &Scenario, clearance: f64, room: f64) -> Result<Self> {
        scenario.validate()?;
        let grow = |shape| GrownShape::new(shape, clearance + GUARD);
        let shapes: Vec<GrownShape> = scenario.shapes.iter().map(grow).collect();
        let (start, goal, reach) = ([scenario.start.x, scenario.start.y], scenario.goal, scenario.goal_radius);
        let bounds = bounds(&shapes, start, goal, reach);
        let grown = |room: f64| [bounds[0] - room, bounds[1] - room, bounds[2] + room, bounds[3] + room];
        let room = clearance + room;
        // The grids over the bounds reach a little beyond them.
        let world = GrownWorld::new(shapes, grown(2.0 * room));
        Ok(Self { world, bounds: grown(room), start, goal, goal_radius: (1.0 - DEPTH) * reach, clearance })
    }

    /// Why there is no path, if there is none: exact, whatever the planner.
    pub fn obstruction(&self) -> Option<Status> {
        if !self.world.is_free(self.start) {
            return Some(Status::StartInCollision);
        }
        if apart(self.start, self.goal) <= self.goal_radius {
            return None;
        }
        if GoalDisc::free(&self.world, self.goal, self.goal_radius).is_blocked() {
            return Some(Status::GoalInCollision);
        }
        let disc = GoalDisc::new(&self.world, &self.world.joints(), self.start, self.goal, self.goal_radius);
        disc.is_none().then_some(Status::NoPath)
    }

    /// Whether the straight way from `a` (free) to `b`, both within the bounds, keeps the clearance.
    pub fn is_clear(&self, a: Point, b: Point) -> bool {
        self.world.is_free(b) && self.world.segment_is_free(a, b)
    }

    /// Where the straight way from `point` (free) at the goal enters the circle, if it is clear; `point` itself within.
    pub fn entry(&self, point: Point) -> Option<Point> {
        let rest = self.to_circle(point);
        if rest <= 0.0 {
            return Some(point);
        }
        let end = along(point, self.goal, rest);
        self.is_clear(point, end).then_some(end)
    }

    /// Straight distance (m) from `point` to where a path may end, negative within.
    pub fn to_circle(&self, point: Point) -> f64 {
        apart(point, self.goal) - self.goal_radius
    }
}
