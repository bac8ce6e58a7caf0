//! Gap following in the manner of the vector field histogram (Ulrich and Borenstein, "VFH+: reliable obstacle avoidance
//! for fast mobile robots", 1998): free directions for a robot of this size, the best of their openings, and a turn
//! towards it. The robot has no memory: what VFH+ charges for leaving the last direction, heading is charged for here.

use super::scene::wrap;
use super::settings::GapConfig;
use super::{Limits, Sight};
use std::f32::consts::PI;

/// Directions around the robot, 2 degrees each.
const SECTORS: usize = 180;
const SECTOR: f32 = 2.0 * PI / SECTORS as f32;

/// The controller, with the memory that it works in.
#[derive(Debug, Clone)]
pub(super) struct Gap {
    config: GapConfig,
    /// How far (m) the robot's disc can drive in each direction, from -pi on.
    free: Vec<f32>,
}

impl Gap {
    pub fn new(config: &GapConfig) -> Self {
        Self { config: config.clone(), free: vec![f32::INFINITY; SECTORS] }
    }

    /// Turns to the best free direction; slower the less of the way is ahead and free.
    pub fn command(&mut self, limits: &Limits, sight: &Sight) -> [f32; 2] {
        self.look(limits.radius + self.config.margin as f32, sight);
        let Some(direction) = self.direction(sight) else {
            // Nothing is free: turn on the spot to where the goal lies.
            return [0.0, if sight.goal_angle < 0.0 { -limits.omega_max } else { limits.omega_max }];
        };
        let slow = (self.config.slow_distance as f32).min(sight.goal_distance);
        let way = (self.free[sector(0.0)] / slow).min(1.0);
        let v = limits.v_max * libm::cosf(direction).max(0.0) * way;
        [v, self.config.turn_gain as f32 * direction]
    }

    /// Fills `free`: a point at distance d stops a disc of `radius` in all directions within asin(radius / d) of it.
    fn look(&mut self, radius: f32, sight: &Sight) {
        self.free.fill(f32::INFINITY);
        for [x, y] in sight.scene.points() {
            let distance = libm::sqrtf(x * x + y * y);
            let way = (distance - radius).max(0.0);
            let half = if distance > radius { libm::asinf(radius / distance) } else { 0.5 * PI };
            let bearing = libm::atan2f(y, x);
            let (first, last) =
                (libm::floorf((bearing - half + PI) / SECTOR), libm::floorf((bearing + half + PI) / SECTOR));
            for index in first as i32..=last as i32 {
                let place = &mut self.free[index.rem_euclid(SECTORS as i32) as usize];
                *place = place.min(way);
            }
        }
    }

    /// The cheapest of the candidates: of a gap that holds the goal's direction that direction, of another its borders,
    /// `border` inside, or its middle if it is narrow. A goal that no beam could look at is turned to first.
    fn direction(&self, sight: &Sight) -> Option<f32> {
        if wrap(sight.goal_angle - sight.middle).abs() > sight.half_fov {
            return Some(sight.goal_angle);
        }
        let reach = (self.config.reach as f32).min(sight.goal_distance);
        let seen = |i: usize| wrap(angle(i) - sight.middle).abs() <= sight.half_fov;
        let is_free = |i: usize| seen(i) && self.free[i] >= reach;
        // Gaps are read from a direction that is not free, so that none is cut in two.
        let Some(start) = (0..SECTORS).find(|&i| !is_free(i)) else { return Some(sight.goal_angle) };
        let (mut best, mut cheapest) = (None, f32::INFINITY);
        let mut i = 0;
        while i < SECTORS {
            let length = (i..SECTORS).take_while(|&k| is_free((start + k) % SECTORS)).count();
            if length > 0 {
                let first = angle((start + i) % SECTORS);
                for candidate in self.candidates(first, (length - 1) as f32 * SECTOR, sight.goal_angle) {
                    let cost = self.cost(candidate, sight.goal_angle);
                    if cost < cheapest {
                        (best, cheapest) = (Some(candidate), cost);
                    }
                }
            }
            i += length + 1;
        }
        best
    }

    /// Directions to consider in the gap of `width` (rad) to the left of `first`.
    fn candidates(&self, first: f32, width: f32, goal: f32) -> [f32; 3] {
        let border = (self.config.border as f32).min(0.5 * width);
        let (right, left) = (wrap(first + border), wrap(first + width - border));
        let into = wrap(goal - first).rem_euclid(2.0 * PI);
        [right, left, if into <= width { goal } else { right }]
    }

    fn cost(&self, direction: f32, goal: f32) -> f32 {
        self.config.goal as f32 * wrap(direction - goal).abs() + self.config.heading as f32 * wrap(direction).abs()
    }
}

/// Middle (rad) of a sector.
fn angle(sector: usize) -> f32 {
    (sector as f32 + 0.5) * SECTOR - PI
}

/// Sector of a direction (rad, in [-pi, pi]).
fn sector(angle: f32) -> usize {
    (((angle + PI) / SECTOR) as usize).min(SECTORS - 1)
}
