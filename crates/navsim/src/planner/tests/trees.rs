//! Random trees: neighbours against a look at every point, and the length that never rises.

use super::super::neighbours::Neighbours;
use super::super::{Planner, Status, plan};
use super::maps::scenario;
use super::plans::{check, config};
use crate::grown::tests::stream;
use crate::shortest::tests::random::World;

#[test]
fn the_nearest_points_are_those_of_a_look_at_all() {
    for seed in 0..30 {
        let mut random = stream(seed);
        let bounds = [[-3.0, 1.0, 5.0, 2.0], [0.0, 0.0, 1.0, 40.0], [-1.0, -1.0, 1.0, 1.0]][seed as usize % 3];
        let [x0, y0, x1, y1] = bounds;
        let mut place = || {
            // Some on one line, some twice.
            let [x, y] = [random.uniform(x0, x1), random.uniform(y0, y1)];
            if random.unit() < 0.2 { [x0, y] } else { [(8.0 * x).round() / 8.0, y] }
        };
        let mut neighbours = Neighbours::new(bounds);
        let mut found = Vec::new();
        for size in 0..400 {
            let here = place();
            for count in [1, 7, 60] {
                neighbours.closest(here, count, &mut found);
                let apart = |[x, y]: [f64; 2]| ((x - here[0]).powi(2) + (y - here[1]).powi(2)).sqrt();
                let mut all: Vec<(f64, usize)> =
                    neighbours.points().iter().enumerate().map(|(number, point)| (apart(*point), number)).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                all.truncate(count);
                assert_eq!(found, all, "seed {seed}, {size} points");
            }
            neighbours.push(if size % 5 == 0 { here } else { place() });
        }
    }
}

#[test]
fn the_length_never_rises_with_more_samples() {
    let (mut falls, mut same) = (0, 0);
    for seed in 0..24 {
        let world = World::new(seed, 14);
        let task = scenario(&world);
        let mut settings = config();
        (settings.shortcut, settings.spacing) = (false, 0.0);
        let mut length = f64::INFINITY;
        for samples in [25, 50, 100, 200, 400, 800, 801, 802, 1600, 3200] {
            settings.samples = samples;
            let plan = plan(&task, Planner::RrtStar, world.radius, &settings, 1, seed as u32).unwrap();
            assert!(plan.length <= length, "seed {seed}, {samples} samples: {} after {length}", plan.length);
            if plan.length < length {
                falls += 1
            } else {
                same += 1
            }
            length = plan.length;
            if plan.status == Status::Found {
                check(&world, &plan, &format!("seed {seed}, {samples} samples"));
            }
        }
    }
    assert!(falls > 60, "{falls} {same}");
}

#[test]
fn lengths_approach_the_shortest() {
    let mut ratios: Vec<f64> = Vec::new();
    for seed in 0..40 {
        let world = World::new(seed, 14);
        let mut settings = config();
        (settings.shortcut, settings.samples) = (false, 4000);
        let plan = plan(&scenario(&world), Planner::RrtStar, world.radius, &settings, 0, 0).unwrap();
        if let (Status::Found, Some(shortest)) = (plan.status, world.length()) {
            ratios.push(plan.length / shortest.max(0.1));
        }
    }
    ratios.sort_by(f64::total_cmp);
    let (median, worst) = (ratios[ratios.len() / 2], ratios[ratios.len() - 1]);
    println!("{} paths: median {median:.4}, worst {worst:.4}", ratios.len());
    assert!(ratios.len() > 30 && median < 1.005 && worst < 1.1);
}
