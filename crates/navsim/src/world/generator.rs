//! Draws episodes: start, goal and moved obstacles, by true clearance and with a way from start to goal.

use super::distance::{Solid, Solids};
use super::free_space::{FreeSpace, Search, roomy_bounds};
use super::obstacles::Obstacles;
use super::rooms::{Room, WALL_ENDS, WALL_LENGTHS, WALL_STARTS};
use super::scenario::Scenario;
use super::shapes::Shape;
use crate::config::{TaskConfig, WorldConfig};
use crate::error::{Error, Result};
use crate::pose::Pose;
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::robot::Footprint;
use std::f64::consts::PI;
use std::sync::Arc;

/// Room (m) that the robot has on each side of the way that must exist, and at start and goal.
const MARGIN: f64 = 0.05;
/// Gap (m) between boxes that stand apart: enough that single precision sees it too.
const GAP: f64 = 1e-3;
/// Draws of start, goal and obstacles together before the world counts as too full.
const TRIES: u32 = 1000;
/// Candidates for each point or obstacle within a draw.
const CANDIDATES: u32 = 1000;
/// Places (about) that are looked at to say how much clearance a world has.
const PLACES_MEASURED: usize = 20_000;

/// One draw. Reused, it keeps its memory; one per thread is enough, for the simulator copies what it needs.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    /// Pose of the robot at the beginning (m, rad); the yaw lies in [-pi, pi).
    pub start: Pose,
    /// Centre of the goal, m.
    pub goal: [f64; 2],
    /// Boxes and segments of this draw, beside the static shapes.
    pub moved: Vec<Shape>,
    solids: Vec<Solid>,
    search: Search,
}

/// A world prepared for one robot. It is immutable: all randomness comes from the stream of each draw.
///
/// Start and goal are drawn first, uniformly among the places of sufficient clearance in one connected part of the
/// static world, then the obstacles, each again until it leaves start and goal clear. The draw is kept if a disc of the
/// circumscribed radius + 0.05 m gets from start to goal: straight on, or else by a conservative grid.
#[derive(Debug, Clone)]
pub struct Generator {
    name: String,
    room: Room,
    /// Uniform(-u, u) per axis: u at episode 0, its growth per episode and its bound, m.
    goal_range: [f64; 3],
    /// Radius of the disc for which start and goal are connected, m.
    radius: f64,
    static_obstacles: Arc<Obstacles>,
    solids: Solids,
    free_space: FreeSpace,
}

/// What a draw failed on.
#[derive(Debug, Clone, Copy)]
enum Miss {
    Start,
    Goal { range: f64 },
    Obstacle { number: usize },
    Way,
}

impl Generator {
    /// Prepares the world `config.name` for a robot of this `footprint`.
    ///
    /// # Errors
    /// An unknown world or a bad file, a goal range that cannot reach the smallest goal distance, or a robot that is
    /// wider than the free space (with the clearances).
    pub fn new(config: &WorldConfig, footprint: &Footprint) -> Result<Self> {
        let mut room = Room::new(config)?;
        if config.goal_range_start * std::f64::consts::SQRT_2 <= room.goal_distance {
            return Err(Error::Setting {
                key: "world.goal_range_start",
                value: config.goal_range_start.to_string(),
                expected: format!("more than {:.4}: goals lie {} m away or more", room.goal_distance / 2f64.sqrt(), {
                    room.goal_distance
                }),
            });
        }
        let radius = footprint.circumscribed_radius() + MARGIN;
        let solids = Solids::new(&room.shapes);
        let [x0, y0, x1, y1] = room.area;
        let bounds = match room.bounds {
            // No centre comes nearer to the walls than the radius.
            Some([x0, y0, x1, y1]) => [x0 + radius, y0 + radius, x1 - radius, y1 - radius],
            None => {
                let all = roomy_bounds(&solids, &[[x0, y0], [x1, y1]], radius);
                // A shape far from the area must not make the grid's cells coarse: ways lead round by one side at most.
                let side = (x1 - x0).max(y1 - y0);
                [all[0].max(x0 - side), all[1].max(y0 - side), all[2].min(x1 + side), all[3].min(y1 + side)]
            }
        };
        let free_space = FreeSpace::new(bounds, room.area, &solids, radius);
        room.clearance = room.clearance.max(free_space.clearance_needed());
        room.boxes.clearance = room.boxes.clearance.max(free_space.clearance_needed());
        let generator = Self {
            name: config.name.clone(),
            goal_range: [config.goal_range_start, config.goal_range_growth, config.goal_range_max],
            radius,
            static_obstacles: Arc::new(Obstacles::new(&room.shapes)),
            room,
            solids,
            free_space,
        };
        generator.check_room()?;
        Ok(generator)
    }

    /// What does not move, shared by all robots of this world.
    pub fn static_obstacles(&self) -> &Arc<Obstacles> {
        &self.static_obstacles
    }

    /// Share of the free area in which no start or goal is drawn, because no way leads there from the largest connected
    /// part; in [0, 1].
    pub fn cut_off(&self) -> f64 {
        self.free_space.cut_off(self.room.area)
    }

    /// What does not move, as shapes.
    pub fn static_shapes(&self) -> &[Shape] {
        &self.room.shapes
    }

    /// Memory for draws in this world.
    pub fn layout(&self) -> Layout {
        Layout { search: self.free_space.search(), ..Layout::default() }
    }

    /// Draws the robot's episode number `episode` from `stream`, which decides everything. Allocates nothing once
    /// `layout` has been used.
    ///
    /// # Errors
    /// `Error::WorldTooFull` after 1,000 draws; `layout` then holds the last, unusable one.
    pub fn draw(&self, stream: &mut Stream, episode: u64, layout: &mut Layout) -> Result<()> {
        let [start, growth, max] = self.goal_range;
        self.draw_within(stream, max.min(start + growth * episode as f64), layout)
    }

    /// Draws scenario `index` of an evaluation list, with goals over the full range.
    ///
    /// # Errors
    /// `Error::WorldTooFull` after 1,000 draws.
    pub fn draw_listed(&self, split: Split, seed: u64, index: u32, task: &TaskConfig) -> Result<Scenario> {
        let mut stream = Stream::new(StreamName::new(seed, Purpose::World, split, index, 0));
        let mut layout = Layout::default();
        self.draw_within(&mut stream, self.goal_range[2], &mut layout)?;
        Ok(self.scenario(layout.start, layout.goal, &layout.moved, task))
    }

    fn draw_within(&self, stream: &mut Stream, range: f64, layout: &mut Layout) -> Result<()> {
        let mut last = Miss::Start;
        for _ in 0..TRIES {
            match self.attempt(stream, range, layout) {
                Ok(()) => return Ok(()),
                Err(miss) => last = miss,
            }
        }
        Err(self.too_full(last))
    }

    /// A draw as a value that can be stored and replayed: static and moved shapes, in the order of the file format.
    pub fn scenario(&self, start: Pose, goal: [f64; 2], moved: &[Shape], task: &TaskConfig) -> Scenario {
        let mut shapes: Vec<Shape> = self.room.shapes.iter().chain(moved).cloned().collect();
        shapes.sort_by_key(Shape::kind);
        let TaskConfig { goal_radius, time_limit, .. } = *task;
        Scenario { start, goal, goal_radius, time_limit, shapes, shortest: None }
    }

    fn attempt(&self, stream: &mut Stream, range: f64, layout: &mut Layout) -> std::result::Result<(), Miss> {
        let [x0, y0, x1, y1] = self.room.area;
        let start = self.place(stream, self.room.area, |_| true).ok_or(Miss::Start)?;
        layout.start = Pose::new(start[0], start[1], stream.uniform(-PI, PI));
        let near =
            [x0.max(start[0] - range), y0.max(start[1] - range), x1.min(start[0] + range), y1.min(start[1] + range)];
        let far_enough = |goal| squared_distance(start, goal) >= self.room.goal_distance * self.room.goal_distance;
        layout.goal = self.place(stream, near, far_enough).ok_or(Miss::Goal { range })?;
        layout.moved.clear();
        layout.solids.clear();
        for number in 1..=self.room.boxes.count {
            self.add_box(stream, layout).ok_or(Miss::Obstacle { number })?;
        }
        for number in 1..=self.room.walls {
            self.add_wall(stream, layout).ok_or(Miss::Obstacle { number: self.room.boxes.count + number })?;
        }
        if self.has_way(layout) { Ok(()) } else { Err(Miss::Way) }
    }

    /// A point of `area` with static clearance in the connected part, for which `condition` holds.
    fn place(&self, stream: &mut Stream, area: [f64; 4], condition: impl Fn([f64; 2]) -> bool) -> Option<[f64; 2]> {
        (0..CANDIDATES).map(|_| uniform_point(stream, area)).find(|point| {
            condition(*point) && self.free_space.contains(*point) && !self.solids.is_nearer(*point, self.room.clearance)
        })
    }

    /// Adds a box: its size and yaw are drawn once, its place until it fits.
    fn add_box(&self, stream: &mut Stream, layout: &mut Layout) -> Option<()> {
        let rule = &self.room.boxes;
        let length = stream.uniform(rule.lengths[0], rule.lengths[1]);
        let width = stream.uniform(rule.widths[0], rule.widths[1]);
        let yaw = if rule.turned { stream.uniform(-PI, PI) } else { 0.0 };
        let (sin, cos) = libm::sincos(yaw);
        let mut solid = Solid::turned_box([0.0; 2], [cos, sin], 0.5 * length, 0.5 * width);
        for _ in 0..CANDIDATES {
            solid.center = uniform_point(stream, rule.area);
            if rule.among_robots && !self.free_space.contains(solid.center) {
                continue;
            }
            let crowds = |point| {
                squared_distance(point, solid.center) < rule.center_distance * rule.center_distance
                    || solid.is_nearer(point, rule.clearance)
            };
            if crowds([layout.start.x, layout.start.y]) || crowds(layout.goal) {
                continue;
            }
            if rule.apart
                && (layout.solids.iter().any(|other| !other.is_apart(&solid, GAP)) || self.solids.touches(&solid, GAP))
            {
                continue;
            }
            layout.moved.push(Shape::Box { center: solid.center, yaw, length, width });
            layout.solids.push(solid);
            return Some(());
        }
        None
    }

    /// Adds an inner wall: its direction and length are drawn once, its beginning until it fits.
    fn add_wall(&self, stream: &mut Stream, layout: &mut Layout) -> Option<()> {
        let (sin, cos) = libm::sincos(stream.uniform(-PI, PI));
        let length = stream.uniform(WALL_LENGTHS[0], WALL_LENGTHS[1]);
        let [x0, y0, x1, y1] = WALL_ENDS;
        for _ in 0..CANDIDATES {
            let a = uniform_point(stream, WALL_STARTS);
            let b = [(a[0] + length * cos).clamp(x0, x1), (a[1] + length * sin).clamp(y0, y1)];
            let solid = Solid::capsule(a, b, 0.0);
            let crowds = |point| solid.is_nearer(point, self.room.boxes.clearance);
            if !crowds([layout.start.x, layout.start.y]) && !crowds(layout.goal) {
                layout.moved.push(Shape::Segment { a, b });
                layout.solids.push(solid);
                return Some(());
            }
        }
        None
    }

    /// Whether the disc gets from start to goal. Without moved shapes it does, for both lie in one connected part.
    fn has_way(&self, layout: &mut Layout) -> bool {
        let (start, goal) = ([layout.start.x, layout.start.y], layout.goal);
        let straight = Solid::capsule(start, goal, self.radius);
        layout.solids.is_empty()
            || (layout.solids.iter().all(|solid| solid.is_apart(&straight, 0.0))
                && !self.solids.touches(&straight, 0.0))
            || self.free_space.joins(start, goal, &layout.solids, &mut layout.search)
    }

    /// Refuses a world in which no place of the connected part has the clearance that start and goal need.
    fn check_room(&self) -> Result<()> {
        let (room, needed) = (&self.room, self.room.clearance);
        let is_place = |point| self.free_space.contains(point) && !self.solids.is_nearer(point, needed);
        if self.free_space.centers(room.area).any(is_place) {
            return Ok(());
        }
        let step = 1 + self.free_space.centers(room.area).count() / PLACES_MEASURED;
        let places = self.free_space.centers(room.area).step_by(step);
        let widest = places.fold(0.0, |widest: f64, point| widest.max(self.solids.distance(point)));
        Err(Error::Scenario(format!(
            "world '{}': the robot is wider than the free space: start and goal need {needed:.3} m of clearance (radius \
             {:.3} m + {MARGIN} m and a little for the grid), the widest place in the area has about {widest:.3} m",
            self.name,
            self.radius - MARGIN
        )))
    }

    fn too_full(&self, miss: Miss) -> Error {
        let (room, radius) = (&self.room, self.radius);
        let reason = match miss {
            Miss::Start => format!("no start with {:.3} m of clearance", room.clearance),
            Miss::Goal { range } => format!(
                "no goal with {:.3} m of clearance at least {} m and per axis at most {range} m from the start",
                room.clearance, room.goal_distance
            ),
            Miss::Obstacle { number } => format!(
                "no place for obstacle {number} of {} with {:.3} m of clearance from start and goal",
                room.boxes.count + room.walls,
                room.boxes.clearance
            ),
            Miss::Way => format!("no way from start to goal for a disc of {radius:.3} m"),
        };
        Error::WorldTooFull { world: self.name.clone(), tries: TRIES, reason }
    }
}

fn squared_distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    dx * dx + dy * dy
}

fn uniform_point(stream: &mut Stream, [x0, y0, x1, y1]: [f64; 4]) -> [f64; 2] {
    [stream.uniform(x0, x1), stream.uniform(y0, y1)]
}
