//! The worlds by name: what stands still in them, and the rules by which the rest is drawn.

use super::file::WorldFile;
use super::shapes::Shape;
use crate::config::WorldConfig;
use crate::error::{Error, Result};
use std::f64::consts::FRAC_PI_2;

/// Thickness of the walls of `td3`, m.
const WALL_THICKNESS: f64 = 0.15;
/// Smallest distance (m) from start to goal where a world does not say otherwise.
const GOAL_DISTANCE: f64 = 1.0;
/// Walls, cross, closed block, triangle and L of `td3`: centre x, y, length (m), yaw (rad).
const TD3_WALLS: [[f64; 4]; 15] = [
    [0.0, 5.425, 11.0, 0.0],
    [5.425, 0.0, 11.0, -FRAC_PI_2],
    [0.0, -5.425, 11.0, std::f64::consts::PI],
    [-5.425, 0.0, 11.0, FRAC_PI_2],
    [-2.152, 1.857, 2.5, 0.0],
    [-2.155, 1.764, 2.75, -FRAC_PI_2],
    [2.724, 3.029, 1.268, 0.0],
    [3.292, 2.622, 0.965, -1.550],
    [2.750, 2.214, 1.25, std::f64::consts::PI],
    [2.183, 2.622, 0.965, 1.614],
    [-2.896, -2.491, 1.977, 1.0946],
    [-1.971, -2.491, 2.064, -1.0133],
    [-2.390, -3.285, 2.0, std::f64::consts::PI],
    [2.388, -2.480, 1.75, 0.0],
    [3.206, -1.288, 2.5, FRAC_PI_2],
];

/// A world before it is prepared for a robot.
#[derive(Debug, Clone)]
pub(crate) struct Room {
    /// What does not move.
    pub shapes: Vec<Shape>,
    /// Closed walls within which the robot stays; `None` where it may drive beyond everything.
    pub bounds: Option<[f64; 4]>,
    /// Start and goal are drawn from [x0, y0, x1, y1], m.
    pub area: [f64; 4],
    /// Smallest distance of start and goal from what does not move, m.
    pub clearance: f64,
    /// Smallest distance from start to goal, m.
    pub goal_distance: f64,
    /// What is drawn in every episode.
    pub boxes: BoxRule,
    /// How many walls of `WALL_LENGTHS` are drawn in every episode.
    pub walls: usize,
}

/// How random boxes are drawn.
#[derive(Debug, Clone)]
pub(crate) struct BoxRule {
    pub count: usize,
    /// Their centres are uniform in [x0, y0, x1, y1], m.
    pub area: [f64; 4],
    /// Uniform full lengths, m.
    pub lengths: [f64; 2],
    /// Uniform full widths, m.
    pub widths: [f64; 2],
    /// Uniform yaw, or 0.
    pub turned: bool,
    /// Smallest distance of their centres from start and goal, m.
    pub center_distance: f64,
    /// Smallest distance of the boxes from start and goal, m.
    pub clearance: f64,
    /// Whether boxes touch neither each other nor what does not move.
    pub apart: bool,
    /// Whether their centres lie in the part of the world where robots drive.
    pub among_robots: bool,
}

/// Shortest and longest inner wall of `open8` and `walls`, m.
pub(crate) const WALL_LENGTHS: [f64; 2] = [1.0, 3.0];
/// Inner walls begin within this square and are cut at the next one.
pub(crate) const WALL_STARTS: [f64; 4] = square(4.0);
/// Inner walls end within this square.
pub(crate) const WALL_ENDS: [f64; 4] = square(4.9);

const fn square(half: f64) -> [f64; 4] {
    [-half, -half, half, half]
}

impl Room {
    /// The world that the configuration names.
    ///
    /// # Errors
    /// An unknown name, or what `WorldFile::read` refuses.
    pub fn new(config: &WorldConfig) -> Result<Self> {
        match config.name.as_str() {
            "td3" => Ok(td3(config.random_yaw)),
            "boxes" => Ok(boxes(config.boxes)),
            "open8" => Ok(open8()),
            "walls" => Ok(walls()),
            path if path.ends_with(".json") => Ok(from_file(WorldFile::read(path)?)),
            other => Err(Error::Setting {
                key: "world.name",
                value: format!("'{other}'"),
                expected: "td3, boxes, open8, walls, mixed or the path of a world file (.json)".into(),
            }),
        }
    }
}

/// The published world: a free square of 10.7 m with furniture, and four boxes.
fn td3(random_yaw: bool) -> Room {
    let solid_box = |x, y, yaw, length, width| Shape::Box { center: [x, y], yaw, length, width };
    let mut shapes: Vec<Shape> =
        TD3_WALLS.iter().map(|[x, y, length, yaw]| solid_box(*x, *y, *yaw, *length, WALL_THICKNESS)).collect();
    shapes.push(Shape::Circle { center: [-4.572, 4.551], radius: 0.2 });
    shapes.push(solid_box(4.784, -3.93, 0.0, 0.92, 0.40));
    shapes.push(solid_box(-4.342, -0.533, 0.0, 1.5, 0.8));
    let boxes = BoxRule {
        count: 4,
        area: square(4.5),
        lengths: [0.5; 2],
        widths: [0.4; 2],
        turned: random_yaw,
        center_distance: 1.5,
        clearance: 0.0,
        apart: true,
        among_robots: false,
    };
    let bounds = Some(square(5.425 - 0.5 * WALL_THICKNESS));
    Room { shapes, bounds, area: square(4.5), clearance: 0.5, goal_distance: GOAL_DISTANCE, boxes, walls: 0 }
}

/// A free square of 10 m with random boxes, which stand apart from each other and the walls.
fn boxes(count: usize) -> Room {
    let boxes = BoxRule {
        count,
        area: square(5.0),
        lengths: [0.3, 1.2],
        widths: [0.3, 1.2],
        turned: true,
        center_distance: 0.0,
        clearance: 0.45,
        apart: true,
        among_robots: false,
    };
    Room { clearance: 0.45, goal_distance: 2.0, boxes, ..square_room() }
}

/// A free square of 10 m with eight boxes and four inner walls, which may overlap.
fn open8() -> Room {
    let boxes = BoxRule {
        count: 8,
        area: square(4.0),
        lengths: [0.4, 1.2],
        widths: [0.4, 1.2],
        turned: true,
        center_distance: 0.0,
        clearance: 0.4,
        apart: false,
        among_robots: false,
    };
    Room { clearance: 0.4, boxes, walls: 4, ..square_room() }
}

/// `open8` with less to see past and more to drive around: three boxes and eight inner walls, whose corners are narrow
/// gaps and dead ends.
fn walls() -> Room {
    let open8 = open8();
    Room { boxes: BoxRule { count: 3, ..open8.boxes.clone() }, walls: 8, ..open8 }
}

/// Four walls without thickness around a free square of 10 m.
fn square_room() -> Room {
    let half = 5.0;
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let shapes = (0..4).map(|i| Shape::Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect();
    let (area, bounds) = (square(half), Some(square(half)));
    Room { shapes, bounds, area, clearance: 0.0, goal_distance: GOAL_DISTANCE, boxes: no_boxes(area), walls: 0 }
}

fn no_boxes(area: [f64; 4]) -> BoxRule {
    let sides = [0.5; 2];
    BoxRule {
        count: 0,
        area,
        lengths: sides,
        widths: sides,
        turned: true,
        center_distance: 0.0,
        clearance: 0.0,
        apart: true,
        among_robots: false,
    }
}

fn from_file(file: WorldFile) -> Room {
    let mut boxes = no_boxes(file.area);
    boxes.among_robots = true;
    if let Some(random) = file.random_boxes {
        (boxes.count, boxes.clearance) = (random.count, random.clearance);
        (boxes.lengths, boxes.widths) = (random.sides, random.sides);
    }
    Room {
        shapes: file.shapes,
        bounds: None,
        area: file.area,
        clearance: 0.0,
        goal_distance: GOAL_DISTANCE,
        boxes,
        walls: 0,
    }
}
