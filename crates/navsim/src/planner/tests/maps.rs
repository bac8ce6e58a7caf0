//! Maps against the clearance of every node, and what a free node promises.

use super::super::occupancy::Map;
use super::super::problem::Problem;
use crate::error::Error;
use crate::pose::Pose;
use crate::shortest::tests::random::{Plain, World};
use crate::world::Scenario;

pub(super) fn scenario(world: &World) -> Scenario {
    let World { start, goal, goal_radius, .. } = *world;
    let start = Pose::new(start[0], start[1], 0.0);
    Scenario { start, goal, goal_radius, time_limit: 50.0, shapes: world.shapes.clone(), shortest: None }
}

#[test]
fn nodes_are_free_by_their_clearance() {
    for seed in 0..60 {
        let world = World::new(seed, [0, 1, 12, 60][seed as usize % 4]);
        let cell = [0.03, 0.11, 0.4][seed as usize % 3];
        let problem = Problem::new(&scenario(&world), world.radius, 2.0 * cell).unwrap();
        let map = Map::new(&problem, "resolution", cell, 1_000_000).unwrap();
        let lifted = (world.radius * world.radius + 0.5 * cell * cell).sqrt();
        let [surely, hardly] = [1e-7, -1e-7].map(|more| Plain::new(&world.shapes, lifted + more));
        let mut free = 0;
        for (node, blocked) in map.blocked.iter().enumerate() {
            let (column, row) = (node % map.grid.columns, node / map.grid.columns);
            let border = column.min(map.grid.columns - 1 - column).min(row).min(map.grid.rows - 1 - row) < 2;
            let point = map.grid.position(node);
            assert!(!blocked || border || !surely.is_free(point), "seed {seed}: {point:?} is free");
            assert!(*blocked || (!border && hardly.is_free(point)), "seed {seed}: {point:?} is blocked");
            free += usize::from(!blocked);
        }
        assert!(free > 100, "seed {seed}");
    }
}

#[test]
fn a_disc_rolls_between_free_neighbours() {
    let mut rolled = 0;
    for seed in 100..130 {
        let world = World::new(seed, 20);
        // Cells up to several radii: thin walls lie between nodes.
        let cell = world.radius * [0.4, 1.5, 4.0][seed as usize % 3];
        let problem = Problem::new(&scenario(&world), world.radius, 2.0 * cell).unwrap();
        let map = Map::new(&problem, "resolution", cell, 1_000_000).unwrap();
        let plain = Plain::new(&world.shapes, world.radius);
        let columns = map.grid.columns;
        for node in (0..map.grid.len()).filter(|node| !map.blocked[*node]) {
            for next in [node + 1, node + columns, node + columns + 1, node + columns - 1] {
                if !map.blocked[next] {
                    assert!(plain.sees(map.grid.position(node), map.grid.position(next)), "seed {seed}");
                    rolled += 1;
                }
            }
        }
    }
    assert!(rolled > 10_000);
}

#[test]
fn too_many_nodes_are_refused_with_the_cells_that_would_do() {
    let world = World::new(0, 5);
    let problem = Problem::new(&scenario(&world), 0.25, 0.0).unwrap();
    let refused = Map::new(&problem, "resolution", 1e-3, 1_000_000).unwrap_err();
    let Error::Setting { key: "resolution", expected, .. } = &refused else { panic!("{refused}") };
    let least: f64 = expected.split(' ').nth(2).unwrap().parse().unwrap();
    assert!(Map::new(&problem, "resolution", least, 1_000_000).is_ok(), "{refused}");
    assert!(Map::new(&problem, "resolution", least - 0.0015, 1_000_000).is_err(), "{refused}");
}
