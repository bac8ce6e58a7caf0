//! One scan: caster, shapes, beams, instruction set and noise.
#![allow(missing_docs, clippy::unwrap_used)]

use benches::config;
use criterion::{Criterion, criterion_group, criterion_main};
use navsim::config::{Caster, LidarConfig};
use navsim::cpu::Isa;
use navsim::lidar::{Lidar, NoiseName, Surroundings};
use navsim::pose::Pose;
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::world::{Generator, Obstacles, Shape};
use std::f64::consts::PI;
use std::hint::black_box;

/// Prepared shapes, each with a pose outside of them.
type Worlds = Vec<(Obstacles, Pose)>;

/// 64 drawn worlds of `open8`: 8 boxes, 4 walls, 4 inner walls.
fn open8() -> Worlds {
    let config = config("open8", 180, 0.0);
    let footprint = navsim::robot::Footprint::new(&config.robot);
    let generator = Generator::new(&config.world, &footprint).unwrap();
    let draw = |index| generator.draw_listed(Split::Tuning, 0, index, &config.task).unwrap();
    (0..64).map(draw).map(|scenario| (Obstacles::new(&scenario.shapes), scenario.start)).collect()
}

/// The same shapes at 64 drawn poses within `half` of the middle.
fn at_poses(shapes: &[Shape], half: f64, random: &mut Stream) -> Worlds {
    let obstacles = Obstacles::new(shapes);
    let mut pose = || loop {
        let [x, y] = [random.uniform(-half, half), random.uniform(-half, half)];
        if obstacles.distance([x, y], 1.0) > 0.25 {
            return Pose::new(x, y, random.uniform(-PI, PI));
        }
    };
    (0..64).map(|_| (obstacles.clone(), pose())).collect()
}

/// A cluttered course: 1,000 circles in a square of 30 m with walls.
fn circles() -> Worlds {
    let mut random = Stream::new(StreamName::new(1, Purpose::World, Split::Given, 0, 0));
    let corners = [[-15.0, -15.0], [15.0, -15.0], [15.0, 15.0], [-15.0, 15.0]];
    let mut shapes: Vec<_> = (0..4).map(|i| Shape::Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect();
    let mut at = || random.uniform(-15.0, 15.0);
    let centers: Vec<_> = (0..1_000).map(|_| [at(), at()]).collect();
    shapes.extend(centers.iter().map(|&center| Shape::Circle { center, radius: random.uniform(0.1, 0.3) }));
    at_poses(&shapes, 15.0, &mut random)
}

/// A traced office: 11 by 11 lines of walls 6 m apart with doors, in about 5,000 pieces that are 2 cm rough.
fn office() -> Worlds {
    let mut random = Stream::new(StreamName::new(2, Purpose::World, Split::Given, 0, 0));
    let (rooms, pieces, side) = (10, 25, 6.0);
    let mut shapes = Vec::new();
    for (line, room) in (0..2 * (rooms + 1)).flat_map(|line| (0..rooms).map(move |room| (line, room))) {
        let mut last = None;
        for piece in 0..=pieces {
            let along = side * (f64::from(room) + f64::from(piece) / f64::from(pieces) - 0.5 * f64::from(rooms));
            let across = side * (f64::from(line / 2) - 0.5 * f64::from(rooms)) + random.uniform(-0.02, 0.02);
            let point = if line % 2 == 0 { [along, across] } else { [across, along] };
            let in_door = (11..14).contains(&piece) && (2..2 * rooms).contains(&line);
            if let (Some(a), false) = (last, in_door) {
                shapes.push(Shape::Segment { a, b: point });
            }
            last = Some(point);
        }
    }
    at_poses(&shapes, 30.0, &mut random)
}

fn bench(criterion: &mut Criterion, name: &str, worlds: &Worlds, lidar: &LidarConfig, isa: Isa) {
    let lidar = Lidar::with_isa(lidar, isa);
    let none = Obstacles::default();
    let stream = StreamName::new(0, Purpose::Noise, Split::Given, 0, 0);
    let (mut buffer, mut count) = (lidar.buffer(), 0);
    criterion.bench_function(name, |bencher| {
        bencher.iter(|| {
            count = (count + 1) % worlds.len();
            let (obstacles, pose) = &worlds[count];
            let around = Surroundings { obstacles: [obstacles, &none], world_from_robot: *pose, center_distance: 0.1 };
            black_box(lidar.scan(&around, &NoiseName { stream, scan: count as u32 }, &mut buffer)[0])
        });
    });
}

fn scan(criterion: &mut Criterion) {
    let base = LidarConfig { range_max: 30.0, ..config("open8", 180, 0.0).lidar };
    let fans = [(20, 2.0 * PI), (180, PI), (720, 1.5 * PI), (1080, 1.5 * PI)];
    let casters = [(Caster::Auto, "auto"), (Caster::Raster, "raster"), (Caster::Parry, "parry")];
    for (shapes, worlds) in [("open8", open8()), ("1,000 circles", circles()), ("5,000 segments", office())] {
        for (beams, fov) in fans {
            for (caster, word) in casters {
                let lidar = LidarConfig { beams, fov, caster, ..base.clone() };
                bench(criterion, &format!("scan/{shapes}/{beams} beams/{word}"), &worlds, &lidar, Isa::detect());
            }
        }
    }
    let worlds = open8();
    for isa in Isa::available() {
        bench(criterion, &format!("scan/open8/180 beams/auto, {}", isa.name()), &worlds, &base, isa);
    }
    let noisy = LidarConfig { noise: 0.008, ..base };
    bench(criterion, "scan/open8/180 beams/auto, noise", &worlds, &noisy, Isa::detect());
}

criterion_group!(benches, scan);
criterion_main!(benches);
