//! The lidar: from obstacles and pose to ranges, noise and bins.

mod bins;
mod circles;
mod draw;
mod edges;
mod fan;
mod faults;
mod noise;
mod raster;
mod view;
mod walk;

pub use bins::Bins;
pub use fan::beam_angle;
pub(crate) use noise::{draw_normals, sin_turn};

use crate::config::{Caster, LidarConfig};
use crate::cpu::{Dispatch, Isa};
use crate::error::Result;
use crate::pose::Pose;
use crate::rng::StreamName;
use crate::world::{BLOCK, Obstacles};
use fan::Fan;
use noise::Noise;
use raster::Scan;
use view::View;

/// A planar lidar on a robot. Ranges are metres from the lidar's own origin.
#[derive(Debug, Clone)]
pub struct Lidar {
    fan: Fan,
    bins: Bins,
    mount: Pose,
    /// Distance of the lidar from the robot's centre, m.
    offset: f32,
    noise: Noise,
    caster: Caster,
    dispatch: Dispatch,
}

/// Working memory of a scan; one for each thread.
#[derive(Debug, Clone)]
pub struct ScanBuffer {
    raster: raster::Scratch,
    ranges: Vec<f32>,
}

/// What the lidar has around it at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// Static and moved obstacles.
    pub obstacles: [&'a Obstacles; 2],
    /// Pose of the robot in the world.
    pub world_from_robot: Pose,
    /// Distance (m) from the robot's centre to the nearest obstacle, or less: tells at no cost that the lidar is not
    /// inside a solid.
    pub center_distance: f32,
}

/// Which random numbers the noise of a scan takes.
#[derive(Debug, Clone, Copy)]
pub struct NoiseName {
    /// Stream of the episode.
    pub stream: StreamName,
    /// Scans made before in this episode.
    pub scan: u32,
}

impl Lidar {
    /// The lidar of a configuration that has passed `SimConfig::validate`, on the instruction set of `Isa::current`.
    ///
    /// # Errors
    /// That of `Isa::current`.
    pub fn new(config: &LidarConfig) -> Result<Self> {
        Ok(Self::with_isa(config, Isa::current()?))
    }

    /// As `new`, on the instruction set `isa` (or the machine's best, if that is lower).
    pub fn with_isa(config: &LidarConfig, isa: Isa) -> Self {
        let [x, y, yaw] = config.mount;
        Self {
            fan: Fan::new(config),
            bins: Bins::new(config.beams, config.bins),
            mount: Pose { x, y, yaw },
            offset: libm::hypot(x, y) as f32,
            noise: Noise::new(config),
            caster: config.caster,
            dispatch: Dispatch::new(isa),
        }
    }

    /// Memory for scans of this lidar.
    pub fn buffer(&self) -> ScanBuffer {
        ScanBuffer { raster: raster::Scratch::new(&self.fan), ranges: vec![0.0; self.fan.padded()] }
    }

    /// Number of beams.
    pub fn beams(&self) -> usize {
        self.fan.beams
    }

    /// The groups into which beams are pooled.
    pub fn bins(&self) -> &Bins {
        &self.bins
    }

    /// Computes one scan: exact ranges, then noise on hits, rounded and clipped to [range_min, range_max]. A beam that
    /// meets nothing reports exactly range_max; a lidar inside a solid sees 0 everywhere, before noise and clipping; a
    /// lost beam is NaN.
    ///
    /// An exact range lies within 1e-4 m of what double precision gives for an origin within 4e-6 m and an angle within
    /// 1e-6 rad; no beam is left out. Within that rule:
    /// - a beam through a corner, or through the end of a wall, meets it; none passes between two edges that share it;
    /// - a beam along an edge does not meet that edge, but what stands at its ends;
    /// - a lidar on a wall does not see that wall, one on the border of a solid is inside it;
    /// - a beam that touches a circle meets it;
    /// - a beam on the border between two bins belongs to the left one (see `Bins`).
    ///
    /// With `Caster::Auto` and `Caster::Raster` the bits are the same on every instruction set.
    ///
    /// The result (m, one per beam) stays in the buffer and is returned.
    pub fn scan<'b>(&self, around: &Surroundings, name: &NoiseName, buffer: &'b mut ScanBuffer) -> &'b [f32] {
        self.cast(around, buffer);
        self.dispatch.run(noise::Disturb { noise: &self.noise, name, ranges: &mut buffer.ranges });
        &buffer.ranges[..self.fan.beams]
    }

    /// Writes the smallest range (m) of each bin of the last scan to `pooled`; a bin that lost all its beams gets
    /// infinity.
    pub fn pool(&self, buffer: &ScanBuffer, pooled: &mut [f32]) {
        self.dispatch.run(bins::Pool { bins: &self.bins, ranges: &buffer.ranges, pooled });
    }

    /// Exact ranges without noise or lower bound.
    fn cast(&self, around: &Surroundings, buffer: &mut ScanBuffer) {
        let world_from_lidar = self.world_from_lidar(&around.world_from_robot);
        let (sin, cos) = libm::sincos(world_from_lidar.yaw);
        let view =
            View { x: world_from_lidar.x as f32, y: world_from_lidar.y as f32, cos: cos as f32, sin: sin as f32 };
        let origin = [world_from_lidar.x, world_from_lidar.y];
        let ranges = &mut buffer.ranges[..];
        let inside = around.center_distance <= self.offset && around.obstacles.iter().any(|o| o.contains(origin));
        if inside {
            ranges.fill(0.0);
        } else if self.caster == Caster::Parry {
            self.cast_by_parry(around, &view, ranges);
        } else {
            let outlines = around.obstacles.map(Obstacles::outline);
            let shortcuts = self.caster == Caster::Auto;
            self.dispatch.run(Scan { outlines, shortcuts, view, fan: &self.fan, scratch: &mut buffer.raster, ranges });
        }
    }

    fn world_from_lidar(&self, world_from_robot: &Pose) -> Pose {
        if self.mount == Pose::default() { *world_from_robot } else { world_from_robot.compose(&self.mount) }
    }

    fn cast_by_parry(&self, around: &Surroundings, view: &View, ranges: &mut [f32]) {
        for (i, range) in ranges.iter_mut().enumerate() {
            let [cos, sin] = &self.fan.directions[i / BLOCK];
            let (cos, sin) = (cos.0[i % BLOCK], sin.0[i % BLOCK]);
            let direction = [view.cos * cos - view.sin * sin, view.sin * cos + view.cos * sin];
            *range = around.obstacles.iter().fold(self.fan.range_max, |nearest, obstacles| {
                obstacles.cast_ray([view.x, view.y], direction, nearest)
            });
        }
    }
}
