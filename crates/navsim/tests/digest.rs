//! The promise of the same bits, whatever the number of threads and robots, the instruction set, debug or release; and
//! of the same paths.
//!
//! NAVRL_FULL=1 tries every number of threads up to 16.
#![allow(clippy::unwrap_used)]

mod drive;

use drive::actions;
use navsim::config::FootprintKind;
use navsim::cpu::Isa;
use navsim::planner::{Plan, Planner, PlannerConfig, plan};
use navsim::{BatchSim, Results, Scenario, SimConfig};
use std::process::Command;

/// Robots whose results are digested; a larger batch has others beside them.
const ROBOTS: usize = 8;

const STEPS: u32 = 10_000;

/// World, and the digest of `STEPS` steps in it.
const STORED: [(&str, u64); 3] =
    [("td3", 0x8c39_4d6e_5197_3004), ("open8", 0xc64b_b61a_85ef_5f3b), ("every_shape", 0x288f_09c3_9ab4_0fa7)];

/// Digest of every planner's paths.
const STORED_PATHS: [(Planner, u64); 6] = [
    (Planner::AStar, 0x6bac_effb_729d_a0bd),
    (Planner::Dijkstra, 0x07f9_1e8a_93c6_d403),
    (Planner::Rrt, 0x3d11_375f_19af_94db),
    (Planner::RrtStar, 0xeb27_0855_142d_b7f8),
    (Planner::AntColony, 0xd063_789b_7eb5_7fb6),
    (Planner::FastMarching, 0x0e87_02ac_f6d5_b1ab),
];

/// The defaults in a world; the one of every shape has another robot and a lidar with every fault.
fn config(world: &str) -> SimConfig {
    let mut config = drive::config(world);
    if world == "open8" {
        config.lidar.noise = 0.0;
    }
    if world == "every_shape" {
        config.world.name = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/every_shape.json").into();
        (config.robot.footprint, config.robot.acceleration_max) = (FootprintKind::Rectangle, 1.0);
        let lidar = &mut config.lidar;
        (lidar.beams, lidar.fov, lidar.bins, lidar.mount) = (271, 4.7, 19, [0.1, -0.05, 0.3]);
        (lidar.range_min, lidar.range_max, lidar.noise_per_meter) = (0.12, 6.0, 0.01);
        (lidar.resolution, lidar.drop_probability) = (0.005, 0.02);
    }
    config
}

/// FNV-1a, 32 bits at a time.
struct Digest(u64);

impl Digest {
    fn add(&mut self, word: u32) {
        self.0 = (self.0 ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3);
    }

    fn add_single(&mut self, values: &[f32]) {
        // Which bits a NaN has is left open by the processor's manual; a lost beam has these.
        values.iter().for_each(|v| self.add(if v.is_nan() { f32::NAN.to_bits() } else { v.to_bits() }));
    }

    fn add_double(&mut self, values: &[f64]) {
        for bits in values.iter().map(|v| v.to_bits()) {
            self.add(bits as u32);
            self.add((bits >> 32) as u32);
        }
    }

    /// Everything that `robot` sees and gets.
    fn add_robot(&mut self, results: &Results, ranges: &[f32], robot: usize, num_envs: usize) {
        let row = |length: usize| robot * (length / num_envs)..(robot + 1) * (length / num_envs);
        for values in [&results.observations[..], &results.final_observations, ranges, &results.rewards] {
            self.add_single(&values[row(values.len())]);
        }
        for values in [
            &results.poses,
            &results.goals,
            &results.velocities,
            &results.episode_returns,
            &results.episode_path,
            &results.episode_clearance,
        ] {
            self.add_double(&values[row(values.len())]);
        }
        self.add(u32::from(results.outcome[robot]));
        self.add(results.episode_steps[robot]);
        self.add(results.episodes[robot] as u32);
    }

    /// Everything of a plan but its time.
    fn add_plan(&mut self, plan: &Plan) {
        self.add(plan.status as u32);
        self.add(plan.expansions as u32);
        self.add_double(&[plan.length, plan.clearance]);
        self.add_double(plan.path.as_flattened());
    }
}

/// One digest of a run: that of each robot over all steps, joined in the order of the robots.
fn digest(config: &SimConfig, num_envs: usize, threads: usize) -> u64 {
    let mut sim = BatchSim::new(config.clone(), num_envs, 3, threads, true, None).unwrap();
    sim.keep_ranges().unwrap();
    let mut robots: Vec<Digest> = (0..ROBOTS).map(|_| Digest(0xcbf2_9ce4_8422_2325)).collect();
    for t in 0..=STEPS {
        for (k, robot) in robots.iter_mut().enumerate() {
            robot.add_robot(sim.results(), sim.ranges(), k, num_envs);
        }
        sim.step(&actions(num_envs, t)).unwrap();
    }
    let mut joined = Digest(0xcbf2_9ce4_8422_2325);
    for Digest(robot) in robots {
        joined.add(robot as u32);
        joined.add((robot >> 32) as u32);
    }
    joined.0
}

/// All of `STORED`, for each pair of number of robots and number of threads.
fn check(runs: &[(usize, usize)]) {
    let mut wrong = Vec::new();
    for (world, stored) in STORED {
        for (num_envs, threads) in runs {
            let got = digest(&config(world), *num_envs, *threads);
            if got != stored {
                wrong.push(format!("{world}, {num_envs} robots, {threads} threads: {got:#018x}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn one_thread_gives_the_stored_digest() {
    check(&[(ROBOTS, 1)]);
}

#[test]
fn neither_threads_nor_other_robots_change_the_digest() {
    let full = std::env::var("NAVRL_FULL").is_ok_and(|v| v == "1");
    let runs = [(8, 2), (9, 16), (33, 3)].into_iter().chain((1..=16).map(|threads| (7 + threads, threads)));
    check(&runs.take(if full { 19 } else { 3 }).collect::<Vec<_>>());
}

/// Runs the test above in a process of its own on each instruction set of this machine.
#[test]
fn every_instruction_set_gives_the_stored_digest() {
    for isa in Isa::available().map(Isa::name) {
        let mut test = Command::new(std::env::current_exe().unwrap());
        let output =
            test.args(["--exact", "one_thread_gives_the_stored_digest"]).env("NAVRL_ISA", isa).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && text.contains("1 passed"), "{isa}: {text}");
    }
}

/// A room with every kind of shape, and ways through it, the last of which is shut.
fn ways() -> Vec<Scenario> {
    let scenario = |[start, goal]: [[f64; 2]; 2]| {
        let text = format!(
            r#"{{"start": [{}, {}, 0.0], "goal": [{}, {}], "goal_radius": 0.3, "time_limit": 50.0,
            "segments": [[-3, -3, 3, -3], [3, -3, 3, 3], [3, 3, -3, 3], [-3, 3, -3, -3], [1.2, 0.4, 1.9, 1.7]],
            "boxes": [[0.0, 0.1, 0.4, 1.5, 1.0], [-1.6, 1.9, -1.1, 0.7, 0.4]],
            "circles": [[1.4, -1.3, 0.45], [-1.3, -1.5, 0.3]], "polygons": [[[-2.1, 0.2], [-1.3, -0.1], [-1.7, 0.8]]]}}"#,
            start[0], start[1], goal[0], goal[1]
        );
        Scenario::from_json(&text).unwrap()
    };
    let ways =
        [[[-2.5, 0.1], [2.4, 0.0]], [[2.3, -2.4], [-2.2, 2.5]], [[-0.4, 2.3], [0.2, -2.2]], [[0.3, 1.9], [0.0, 4.0]]];
    ways.map(scenario).to_vec()
}

#[test]
fn every_planner_gives_the_stored_digest() {
    let mut config = PlannerConfig::from_json(include_str!("planner.json")).unwrap();
    let mut got = STORED_PATHS;
    for (planner, digest) in &mut got {
        let mut paths = Digest(0xcbf2_9ce4_8422_2325);
        for shortcut in [true, false] {
            config.shortcut = shortcut;
            for (index, way) in ways().iter().enumerate() {
                paths.add_plan(&plan(way, *planner, 0.25, &config, 3, index as u32).unwrap());
            }
        }
        *digest = paths.0;
    }
    assert_eq!(got, STORED_PATHS, "{got:#018x?}");
}
