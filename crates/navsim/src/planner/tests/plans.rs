//! Whole plans: every path by an independent check of its clearance, what there is no path for, and settings.

use super::super::smooth::{divide, length};
use super::super::{Plan, Planner, PlannerConfig, Status, plan};
use super::maps::scenario;
use crate::error::Error;
use crate::grown::Point;
use crate::grown::tests::room;
use crate::shortest::tests::random::{Plain, World};
use crate::world::Shape;

pub(super) fn config() -> PlannerConfig {
    PlannerConfig {
        margin: 0.0,
        resolution: 0.05,
        ant_resolution: 0.1,
        step: 0.5,
        samples: 2000,
        goal_bias: 0.05,
        ants: 8,
        rounds: 6,
        evaporation: 0.2,
        goal_weight: 2.0,
        time_limit: 0.0,
        shortcut: true,
        spacing: 0.1,
    }
}

/// What makes a path one: it joins the start to the inside of the goal circle at the clearance that the plan states.
pub(super) fn check(world: &World, plan: &Plan, what: &str) {
    let path = &plan.path;
    let plain = Plain::new(&world.shapes, plan.clearance);
    assert_eq!(path[0], world.start, "{what}");
    let end = path[path.len() - 1];
    assert!((end[0] - world.goal[0]).hypot(end[1] - world.goal[1]) < world.goal_radius, "{what}");
    assert!(path.iter().all(|point| plain.is_free(*point)), "{what}");
    assert!(path.windows(2).all(|pair| plain.sees(pair[0], pair[1])), "{what}");
    assert_eq!(plan.length, length(path), "{what}");
}

/// A room with a box at its middle, start on the left and goal on the right.
fn room_with_box() -> World {
    let middle = Shape::Box { center: [0.0, 0.0], yaw: 0.4, length: 1.5, width: 1.0 };
    let shapes = [room(3.0), vec![middle]].concat();
    World { shapes, radius: 0.25, start: [-2.5, 0.1], goal: [2.5, 0.0], goal_radius: 0.3 }
}

#[test]
fn every_path_is_clear_in_random_worlds() {
    let mut counts = [[0; 3]; 6];
    for seed in 0..240 {
        let world = World::new(seed, [3, 8, 14, 24][seed as usize % 4]);
        let task = scenario(&world);
        let mut settings = config();
        settings.margin = [0.0, 0.08][seed as usize % 2];
        settings.shortcut = seed % 3 > 0;
        settings.spacing = [0.0, 0.07][seed as usize / 2 % 2];
        for (counts, (name, planner)) in counts.iter_mut().zip(Planner::ALL) {
            let what = format!("{name}, seed {seed}");
            let plan = plan(&task, planner, world.radius, &settings, 5, seed as u32).unwrap();
            match (plan.status, world.length()) {
                (Status::Found, Some(shortest)) => {
                    check(&world, &plan, &what);
                    assert!(plan.length > shortest - 1e-9, "{what}: {} {shortest}", plan.length);
                    counts[0] += 1;
                }
                (Status::NoPath, None) => counts[1] += 1,
                (Status::TooCoarse | Status::BudgetSpent, Some(_)) => counts[2] += 1,
                (status, shortest) => panic!("{what}: {status:?} where the shortest is {shortest:?}"),
            }
            assert!(plan.clearance >= world.radius && plan.clearance <= world.radius + settings.margin);
        }
    }
    println!("found, none, not found: {counts:?}");
    for [found, none, missed] in counts {
        assert!(found > 200 && none >= 4 && missed < 6, "{counts:?}");
    }
}

#[test]
fn what_there_is_no_path_for() {
    let mut settings = config();
    for (name, planner) in Planner::ALL {
        let run = |world: &World| plan(&scenario(world), planner, world.radius, &settings, 0, 0).unwrap();
        let none = |world: &World, status: Status| {
            let plan = run(world);
            assert_eq!((plan.status, plan.path.len(), plan.length), (status, 0, f64::INFINITY), "{name}");
        };
        let mut world = room_with_box();
        assert_eq!(run(&world).status, Status::Found);
        world.start = [-0.9, 0.0];
        none(&world, Status::StartInCollision);
        world.start = [-2.5, 0.1];
        (world.goal, world.goal_radius) = ([0.0, 0.0], 0.3);
        none(&world, Status::GoalInCollision);
        (world.goal, world.goal_radius) = ([0.0, 4.0], 0.3);
        none(&world, Status::NoPath);
        // A goal that is partly blocked can be reached.
        (world.goal, world.goal_radius) = ([0.3, 0.2], 1.0);
        check(&world, &run(&world), name);
        // Started in the goal.
        (world.goal, world.goal_radius) = ([-2.4, 0.1], 0.3);
        assert_eq!((run(&world).path, run(&world).length), (vec![world.start], 0.0), "{name}");
    }
    // A wall across the room with a gap of 0.52 m: there is a way, which no grid of 0.3 m shows.
    let mut world = room_with_box();
    world.shapes = room(3.0);
    for [low, high] in [[-3.0, 0.11], [0.63, 3.0]] {
        world.shapes.push(Shape::Segment { a: [0.0, low], b: [0.0, high] });
    }
    (settings.resolution, settings.ant_resolution, settings.samples) = (0.3, 0.3, 20);
    for (name, planner) in Planner::ALL {
        let plan = plan(&scenario(&world), planner, world.radius, &settings, 0, 0).unwrap();
        let tree = matches!(planner, Planner::Rrt | Planner::RrtStar);
        assert_eq!(plan.status, if tree { Status::BudgetSpent } else { Status::TooCoarse }, "{name}");
    }
}

#[test]
fn a_margin_shrinks_to_what_there_is_room_for() {
    let mut settings = config();
    settings.margin = 0.1;
    let mut world = room_with_box();
    for (gap, margin) in [(2.0, 0.1), (0.62, 0.05), (0.52, 0.0)] {
        world.shapes.truncate(4);
        for (low, high) in [(-3.0, -0.5 * gap), (0.5 * gap, 3.0)] {
            world.shapes.push(Shape::Segment { a: [0.0, low], b: [0.0, high] });
        }
        settings.resolution = 0.01;
        let plan = plan(&scenario(&world), Planner::AStar, world.radius, &settings, 0, 0).unwrap();
        assert!((plan.clearance - 0.25 - margin).abs() < 1e-12, "{gap}: {}", plan.clearance);
        check(&world, &plan, "margin");
    }
}

#[test]
fn tight_paths_are_nearly_the_shortest() {
    let world = room_with_box();
    let shortest = world.length().unwrap();
    for (name, planner) in Planner::ALL {
        let mut settings = config();
        let tight = plan(&scenario(&world), planner, world.radius, &settings, 0, 0).unwrap();
        settings.shortcut = false;
        let raw = plan(&scenario(&world), planner, world.radius, &settings, 0, 0).unwrap();
        println!("{name}: {:.4}, tight {:.4}", raw.length / shortest, tight.length / shortest);
        // A first random path may pass the box on its longer side.
        let allowed = if planner == Planner::Rrt { 1.03 } else { 1.005 };
        assert!(tight.length < allowed * shortest && tight.length <= raw.length + 1e-9, "{name}");
    }
}

#[test]
fn points_are_no_farther_apart_than_asked_and_corners_stay() {
    let path: [Point; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.25], [3.0, 0.25]];
    let fine = divide(&path, 0.3);
    assert!(fine.windows(2).all(|pair| length(pair) <= 0.3 + 1e-12));
    assert!(path.iter().all(|corner| fine.contains(corner)));
    assert_eq!(fine.len(), 1 + 4 + 1 + 7);
    assert!((length(&fine) - 3.25).abs() < 1e-12);
    assert_eq!(divide(&path, 5.0), path);
    assert_eq!(divide(&path[..1], 0.1), path[..1]);
}

#[test]
fn a_seed_and_index_name_a_path() {
    let world = room_with_box();
    let task = scenario(&world);
    for planner in [Planner::Rrt, Planner::RrtStar, Planner::AntColony] {
        // A path that is pulled tight may be the shortest one, whatever it was found by.
        let settings = PlannerConfig { shortcut: false, ..config() };
        let path = |seed: u64, index: u32| plan(&task, planner, world.radius, &settings, seed, index).unwrap().path;
        let (first, again) = (path(3, 4), path(3, 4));
        assert!(!first.is_empty() && first == again);
        assert!(first != path(4, 4) && first != path(3, 5), "{planner:?}");
    }
}

#[test]
fn time_ends_a_search() {
    // A corridor of 1 m with a tenth of a millimetre of play: out of reach for samples.
    let mut world = room_with_box();
    world.shapes.truncate(4);
    for y in [1.75005, -1.75005] {
        world.shapes.push(Shape::Box { center: [0.0, y + 0.3], yaw: 0.0, length: 1.0, width: 3.0 });
    }
    let settings = PlannerConfig { samples: 10_000_000, time_limit: 0.05, ..config() };
    for planner in [Planner::Rrt, Planner::RrtStar] {
        let plan = plan(&scenario(&world), planner, world.radius, &settings, 0, 0).unwrap();
        assert_eq!(plan.status, Status::BudgetSpent);
        assert!(plan.expansions < settings.samples && plan.time >= settings.time_limit, "{plan:?}");
    }
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let task = scenario(&room_with_box());
    // Just outside of each range.
    type Set = fn(&mut PlannerConfig, f64);
    let cases: [(&str, Set, &[f64]); 12] = [
        ("planner.margin", |c, x| c.margin = x, &[-1e-300, 100f64.next_up()]),
        ("planner.resolution", |c, x| c.resolution = x, &[1e-3f64.next_down(), 100f64.next_up()]),
        ("planner.ant_resolution", |c, x| c.ant_resolution = x, &[1e-3f64.next_down(), 100f64.next_up()]),
        ("planner.step", |c, x| c.step = x, &[1e-3f64.next_down(), 1000f64.next_up()]),
        ("planner.samples", |c, x| c.samples = x as u64, &[0.0, 10_000_001.0]),
        ("planner.goal_bias", |c, x| c.goal_bias = x, &[-1e-300, 1.0]),
        ("planner.ants", |c, x| c.ants = x as u32, &[0.0, 10_001.0]),
        ("planner.rounds", |c, x| c.rounds = x as u32, &[0.0, 10_001.0]),
        ("planner.evaporation", |c, x| c.evaporation = x, &[0.0, 1f64.next_up()]),
        ("planner.goal_weight", |c, x| c.goal_weight = x, &[-1e-300, 20f64.next_up()]),
        ("planner.time_limit", |c, x| c.time_limit = x, &[-1e-300, 1e6f64.next_up()]),
        ("planner.spacing", |c, x| c.spacing = x, &[-1e-300, 1e-300, 1e-3f64.next_down(), 1000f64.next_up()]),
    ];
    for (name, set, values) in cases {
        let whole = ["planner.samples", "planner.ants", "planner.rounds"].contains(&name);
        for value in values.iter().chain(if whole { [].iter() } else { [f64::NAN, f64::INFINITY].iter() }) {
            let mut settings = config();
            set(&mut settings, *value);
            let refused = plan(&task, Planner::AStar, 0.25, &settings, 0, 0).unwrap_err();
            assert!(matches!(&refused, Error::Setting { key, .. } if *key == name), "{name}: {refused}");
            let Error::Setting { expected, .. } = &refused else { unreachable!() };
            assert!(expected.len() < 30, "{refused}");
        }
    }
    let fine = PlannerConfig { resolution: 1e-3, ..config() };
    let refused = plan(&task, Planner::AStar, 0.25, &fine, 0, 0).unwrap_err();
    assert!(matches!(&refused, Error::Setting { key: "planner.resolution", .. }), "{refused}");
    for radius in [0.0, -1.0, f64::NAN, f64::INFINITY, 1000f64.next_up()] {
        let refused = plan(&task, Planner::Rrt, radius, &config(), 0, 0).unwrap_err();
        assert!(matches!(&refused, Error::Setting { key: "radius", .. }), "{refused}");
    }
    assert!(PlannerConfig::from_json("{\"margin\": 0}").is_err());
}
