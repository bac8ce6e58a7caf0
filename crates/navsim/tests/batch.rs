//! The batch: contract of reset and step, and the same bits for any number of threads and robots.
#![allow(clippy::unwrap_used)]

mod drive;

use drive::{actions, config};
use navsim::config::*;
use navsim::world::Shape;
use navsim::{BatchSim, Error, Scenario};

/// FNV-1a over the bits of everything that the first `robots` robots see and get.
fn digest(sim: &mut BatchSim, robots: usize, mut hash: u64) -> u64 {
    let mut add = |bits: u64| hash = (hash ^ bits).wrapping_mul(0x0000_0100_0000_01b3);
    let beams = sim.config().lidar.beams;
    sim.keep_ranges().unwrap();
    sim.ranges()[..robots * beams].iter().for_each(|v| add(u64::from(v.to_bits())));
    let (results, width) = (sim.results(), sim.observation_size());
    results.observations[..robots * width].iter().for_each(|v| add(u64::from(v.to_bits())));
    results.final_observations[..robots * width].iter().for_each(|v| add(u64::from(v.to_bits())));
    results.rewards[..robots].iter().for_each(|v| add(u64::from(v.to_bits())));
    results.outcome[..robots].iter().for_each(|v| add(u64::from(*v)));
    results.poses[..3 * robots].iter().for_each(|v| add(v.to_bits()));
    results.episode_returns[..robots].iter().for_each(|v| add(v.to_bits()));
    hash
}

fn run(world: &str, robots: usize, threads: usize, steps: u32) -> u64 {
    let mut sim = BatchSim::new(config(world), robots, 3, threads, true, None).unwrap();
    let start = digest(&mut sim, 3, 0);
    (0..steps).fold(start, |hash, t| {
        sim.step(&actions(robots, t)).unwrap();
        digest(&mut sim, 3, hash)
    })
}

#[test]
fn the_same_bits_for_any_number_of_threads_and_robots() {
    for world in ["td3", "boxes", "open8"] {
        let alone = run(world, 3, 1, 700);
        for (robots, threads) in [(3, 2), (3, 16), (64, 1), (64, 3), (65, 2)] {
            assert_eq!(alone, run(world, robots, threads, 700), "{world}, {robots} robots, {threads} threads");
        }
    }
}

fn corridor(goal_x: f64, time_limit: f64) -> Scenario {
    let line = format!(
        r#"{{"start":[0,0,0],"goal":[{goal_x},0],"goal_radius":0.3,"time_limit":{time_limit},"segments":[[-1,-1,9,-1],[9,-1,9,1],[9,1,-1,1],[-1,1,-1,-1]]}}"#
    );
    Scenario::from_json(&line).unwrap()
}

fn quiet() -> SimConfig {
    let mut config = config("td3");
    config.lidar.noise = 0.0;
    config
}

const FORWARD: [f32; 2] = [1.0, 0.0];

#[test]
fn a_drive_to_the_goal_step_by_step() {
    // 1.02 m to the goal at 0.05 m a step: under 0.3 m for the first time after step 15 (0.27 m left).
    let mut sim = BatchSim::new(quiet(), 1, 0, 1, false, Some(vec![corridor(1.02, 50.0)])).unwrap();
    for step in 1..=15 {
        sim.step(&FORWARD).unwrap();
        let r = sim.results();
        assert_eq!(r.terminated[0], step == 15, "step {step}");
        // Progress 35 x 0.05 on top of 0.5 - 0, or of the goal's 100; walls at 1 m give no repulsion.
        let expected = if step == 15 { 101.75 } else { 2.25 };
        assert!((r.rewards[0] - expected).abs() < 1e-4, "step {step}: {}", r.rewards[0]);
    }
    let r = sim.results().clone();
    assert_eq!((r.outcome[0], r.truncated[0], r.episode_steps[0]), (1, false, 15));
    assert!((r.episode_returns[0] - (14.0 * 0.5 + 100.0)).abs() < 1e-9);
    assert!((r.episode_path[0] - 0.75).abs() < 1e-9 && (r.episode_clearance[0] - 0.75).abs() < 1e-6);
    assert!((r.observations[20] - 0.27).abs() < 1e-6);
    assert_eq!(r.observations[21..], [0.0_f32, 1.0, 0.0]);
    // Frozen: reward 0, all else unchanged, until a reset with its mask set.
    sim.step(&FORWARD).unwrap();
    assert_eq!(sim.results().rewards[0], 0.0);
    let frozen = navsim::Results { rewards: r.rewards.clone(), ..sim.results().clone() };
    assert_eq!(frozen, r);
    sim.reset(Some(&[false])).unwrap();
    assert_eq!(sim.results().outcome[0], 1);
    sim.reset(Some(&[true])).unwrap();
    let r = sim.results();
    assert_eq!((r.outcome[0], r.terminated[0], r.episodes[0], r.episode_steps[0]), (0, false, 1, 0));
    assert_eq!(r.observations[20..], [1.02_f32, 0.0, 0.0, 0.0]);
    assert_eq!(r.observations, r.final_observations);
}

#[test]
fn the_goal_counts_on_the_last_step_and_the_time_limit_after_it() {
    for (time_limit, outcome) in [(1.5, 1), (1.4, 3)] {
        let mut sim = BatchSim::new(quiet(), 1, 0, 1, false, Some(vec![corridor(1.02, time_limit)])).unwrap();
        while sim.results().outcome[0] == 0 {
            sim.step(&FORWARD).unwrap();
        }
        let r = sim.results();
        assert_eq!((r.outcome[0], r.terminated[0], r.truncated[0]), (outcome, outcome == 1, outcome == 3));
    }
}

#[test]
fn a_collision_ends_the_step_at_contact() {
    let mut scenario = corridor(8.0, 50.0);
    scenario.shapes.push(Shape::Segment { a: [0.57, -1.0], b: [0.57, 1.0] });
    let mut sim = BatchSim::new(quiet(), 1, 0, 1, false, Some(vec![scenario])).unwrap();
    for _ in 0..7 {
        sim.step(&FORWARD).unwrap();
    }
    let r = sim.results();
    // Contact at x = 0.32, 0.02 m into the seventh step.
    assert_eq!((r.outcome[0], r.terminated[0]), (2, true));
    assert!((r.poses[0] - 0.32).abs() < 1e-4 && (r.episode_path[0] - 0.32).abs() < 1e-4);
    assert!((r.rewards[0] - (-445.0 + 35.0 * 0.02)).abs() < 1e-2);
    assert!(r.episode_clearance[0] < 1e-4);
    assert!((r.observations[9] - 0.25).abs() < 1e-3 && (r.observations[10] - 0.25).abs() < 1e-3);
}

#[test]
fn a_sensor_rule_ends_an_episode_without_contact() {
    let mut scenario = corridor(8.0, 50.0);
    scenario.shapes.push(Shape::Segment { a: [0.57, -1.0], b: [0.57, 1.0] });
    let mut config = quiet();
    config.task.collision = CollisionRule::Sensor;
    let mut sim = BatchSim::new(config, 1, 0, 1, false, Some(vec![scenario])).unwrap();
    for _ in 0..5 {
        sim.step(&FORWARD).unwrap();
    }
    // 0.57 - 0.25 = 0.32 m ahead: under 0.35 m for the first time.
    assert_eq!((sim.results().outcome[0], sim.results().episode_steps[0]), (2, 5));
}

#[test]
fn autoreset_gives_the_first_observation_and_keeps_the_last() {
    let mut sim = BatchSim::new(quiet(), 1, 0, 1, true, Some(vec![corridor(1.02, 50.0)])).unwrap();
    for _ in 0..15 {
        sim.step(&FORWARD).unwrap();
    }
    let r = sim.results();
    assert_eq!((r.outcome[0], r.terminated[0], r.episode_steps[0], r.episodes[0]), (1, true, 15, 0));
    assert!((r.final_observations[20] - 0.27).abs() < 1e-6);
    assert_eq!(r.final_observations[21..], [0.0_f32, 1.0, 0.0]);
    assert_eq!(r.observations[20..], [1.02_f32, 0.0, 0.0, 0.0]);
    assert_eq!(r.poses, [0.0, 0.0, 0.0]);
    sim.step(&FORWARD).unwrap();
    let r = sim.results();
    assert_eq!((r.outcome[0], r.terminated[0], r.episode_steps[0], r.episodes[0]), (0, false, 1, 1));
    assert_eq!(r.observations, r.final_observations);
}

#[test]
fn acceleration_limits_show_in_the_observation() {
    let mut config = quiet();
    (config.robot.acceleration_max, config.robot.angular_acceleration_max) = (1.0, 2.5);
    let mut sim = BatchSim::new(config, 1, 0, 1, true, Some(vec![corridor(4.0, 50.0)])).unwrap();
    sim.step(&[1.0, 1.0]).unwrap();
    assert_eq!(sim.results().velocities, [0.1, 0.25]);
    assert_eq!(sim.results().observations[22..], [0.2_f32, 0.25]);
}

#[test]
fn a_restored_simulator_goes_on_bit_for_bit() {
    let mut sim = BatchSim::new(config("td3"), 8, 1, 1, true, None).unwrap();
    for t in 0..300 {
        sim.step(&actions(8, t)).unwrap();
    }
    let state = sim.state().unwrap();
    let mut other = BatchSim::new(config("td3"), 8, 1, 2, true, None).unwrap();
    other.restore(&state).unwrap();
    assert_eq!(sim.results(), other.results());
    for t in 300..600 {
        sim.step(&actions(8, t)).unwrap();
        other.step(&actions(8, t)).unwrap();
        assert_eq!(sim.results(), other.results(), "step {t}");
    }
    assert!(sim.restore(b"{}").is_err());
    let mut smaller = BatchSim::new(config("td3"), 7, 1, 1, true, None).unwrap();
    assert!(matches!(smaller.restore(&state), Err(Error::Length { expected: 7, got: 8, .. })));
}

/// Robots of a part, drawn or given, meet the worlds, noise and odometry that are theirs in the whole.
#[test]
fn a_part_of_a_batch_is_the_same_robots() {
    let mut config = config("mixed");
    config.robot.odometry_noise = 0.05;
    config.lidar.noise = 0.01;
    let drawn = BatchSim::new(config.clone(), 11, 2, 1, true, None).unwrap();
    let given: Vec<_> = (0..11).map(|robot| drawn.scenario(robot).unwrap()).collect();
    for scenarios in [None, Some(given)] {
        let mut whole = BatchSim::new(config.clone(), 11, 2, 1, true, scenarios.clone()).unwrap();
        let own = scenarios.map(|all| all[5..9].to_vec());
        let mut part = BatchSim::part(config.clone(), 4, 2, 1, true, own, 5).unwrap();
        for t in 0..300 {
            let actions = actions(11, t);
            whole.step(&actions).unwrap();
            part.step(&actions[2 * 5..2 * 9]).unwrap();
            let size = whole.observation_size();
            assert_eq!(whole.results().observations[5 * size..9 * size], part.results().observations, "step {t}");
            assert_eq!(whole.results().rewards[5..9], part.results().rewards);
        }
        assert!((5..9).all(|robot| whole.scenario(robot) == part.scenario(robot - 5)));
    }
    assert!(BatchSim::part(config, 1, 2, 1, true, None, 1 << 20).is_err());
}

#[test]
fn bad_actions_leave_the_simulator_untouched() {
    let mut sim = BatchSim::new(config("td3"), 2, 1, 1, true, None).unwrap();
    let before = sim.state().unwrap();
    assert!(matches!(sim.step(&[0.0; 3]), Err(Error::Length { expected: 4, got: 3, .. })));
    assert!(matches!(sim.step(&[0.0, 0.0, f32::NAN, 0.0]), Err(Error::NotFinite { robot: 1, .. })));
    assert!(sim.reset(Some(&[true])).is_err());
    assert_eq!(before, sim.state().unwrap());
    assert!(BatchSim::new(config("td3"), 0, 1, 1, true, None).is_err());
    assert!(BatchSim::new(config("td3"), 1, 1, 0, true, None).is_err());
    assert!(BatchSim::new(config("nowhere"), 1, 1, 1, true, None).is_err());
}

#[test]
fn a_state_keeps_lost_beams() {
    let mut config = config("td3");
    config.lidar.drop_probability = 0.3;
    let simulator = || BatchSim::new(config.clone(), 4, 0, 1, true, None).unwrap();
    let (mut whole, mut resumed) = (simulator(), simulator());
    (0..20).for_each(|t| whole.step(&actions(4, t)).unwrap());
    whole.keep_ranges().unwrap();
    assert!(whole.ranges().iter().any(|range| range.is_nan()));
    resumed.restore(&whole.state().unwrap()).unwrap();
    assert_eq!(digest(&mut resumed, 4, 0), digest(&mut whole, 4, 0));
    (20..60).for_each(|t| {
        whole.step(&actions(4, t)).unwrap();
        resumed.step(&actions(4, t)).unwrap();
    });
    assert_eq!(digest(&mut resumed, 4, 0), digest(&mut whole, 4, 0));
}

#[test]
fn a_command_acts_as_many_periods_late_as_configured() {
    let mut config = quiet();
    config.robot.delay_steps = 2;
    let mut sim = BatchSim::new(config.clone(), 1, 0, 1, false, Some(vec![corridor(1.02, 50.0)])).unwrap();
    // Half speed is asked for first, then full speed: it stands for two periods, then 0.025 m, then 0.05 m each.
    let mut x = 0.0;
    for (step, v) in [0.0, 0.0, 0.25, 0.5, 0.5].into_iter().enumerate() {
        sim.step(if step == 0 { &[0.0, 0.0] } else { &FORWARD }).unwrap();
        x += 0.1 * v;
        let r = sim.results();
        assert!((r.poses[0] - x).abs() < 1e-12, "step {step}");
        assert_eq!(r.velocities[0], v);
        // What the robot knows of itself is what it does, not what it asked for.
        assert_eq!(r.observations[22], (v / 0.5) as f32);
    }
    // An episode inherits nothing from the one before.
    sim.reset(None).unwrap();
    sim.step(&FORWARD).unwrap();
    assert_eq!(sim.results().poses[0], 0.0);
    // The late command is then subject to the acceleration limits.
    config.robot.acceleration_max = 1.0;
    let mut sim = BatchSim::new(config, 1, 0, 1, false, Some(vec![corridor(1.02, 50.0)])).unwrap();
    let speeds = [0.0, 0.0, 0.1, 0.2, 0.3].map(|v: f64| {
        sim.step(&FORWARD).unwrap();
        (sim.results().velocities[0] - v).abs()
    });
    assert!(speeds.iter().all(|error| *error < 1e-12), "{speeds:?}");
}

#[test]
fn the_goal_is_seen_by_odometry_and_reached_in_truth() {
    let mut config = quiet();
    config.robot.odometry_noise = 0.1;
    let scenarios = vec![corridor(1.02, 50.0); 20];
    let mut sim = BatchSim::new(config.clone(), 20, 0, 1, false, Some(scenarios.clone())).unwrap();
    let mut scales = Vec::new();
    for episode in 0..2 {
        for step in 1..=15 {
            sim.step(&FORWARD.repeat(20)).unwrap();
            let believed: Vec<_> = sim.odometry().collect();
            for (robot, [x, y, yaw]) in believed.into_iter().enumerate() {
                let r = sim.results();
                // 0.05 m a step in truth, and 35 a metre for it: the reward is not for what the robot believes.
                assert!((r.poses[3 * robot] - 0.05 * f64::from(step)).abs() < 1e-9);
                assert_eq!(r.outcome[robot], u8::from(step == 15));
                assert!((r.rewards[robot] - if step == 15 { 101.75 } else { 2.25 }).abs() < 1e-4);
                assert!((f64::from(r.observations[24 * robot + 20]) - (1.02 - x).abs()).abs() < 1e-6);
                assert_eq!((y, yaw), (0.0, 0.0));
                let scale = x / r.poses[3 * robot];
                match step {
                    1 => scales.push(scale),
                    _ => assert!((scale - scales[20 * episode + robot]).abs() < 1e-9, "drawn once an episode"),
                }
            }
        }
        sim.reset(None).unwrap();
        assert_eq!(sim.odometry().next(), Some([0.0; 3]));
    }
    let (first, second) = scales.split_at(20);
    assert!(first.iter().zip(second).all(|(a, b)| a != b && (0.5..1.5).contains(a) && *a != 1.0));
    // Robot k has the same odometry whatever the batch.
    let mut alone = BatchSim::new(config, 3, 0, 1, false, Some(scenarios)).unwrap();
    alone.step(&FORWARD.repeat(3)).unwrap();
    let again = alone.odometry().map(|[x, ..]| x / 0.05);
    assert!(again.zip(first).all(|(a, b)| (a - b).abs() < 1e-9));
}

#[test]
fn a_robot_without_odometry_noise_knows_its_pose() {
    let mut sim = BatchSim::new(config("td3"), 3, 0, 1, true, None).unwrap();
    (0..30).for_each(|t| sim.step(&actions(3, t)).unwrap());
    let believed: Vec<f64> = sim.odometry().flatten().collect();
    assert_eq!(believed, sim.results().poses);
    let least = sim.results().episode_clearance.clone();
    assert!(sim.clearances().zip(least).all(|(now, least)| f64::from(now) >= least));
}

#[test]
fn a_state_keeps_late_commands_and_odometry() {
    let mut config = config("td3");
    (config.robot.delay_steps, config.robot.odometry_noise) = (3, 0.05);
    let simulator = || BatchSim::new(config.clone(), 4, 0, 1, true, None).unwrap();
    let (mut whole, mut resumed) = (simulator(), simulator());
    (0..20).for_each(|t| whole.step(&actions(4, t)).unwrap());
    resumed.restore(&whole.state().unwrap()).unwrap();
    for t in 20..120 {
        whole.step(&actions(4, t)).unwrap();
        resumed.step(&actions(4, t)).unwrap();
        assert_eq!(whole.results(), resumed.results(), "step {t}");
        assert!(whole.odometry().eq(resumed.odometry()));
    }
}

#[test]
fn ranges_are_the_same_whenever_they_are_asked_for() {
    let mut config = config("td3");
    config.lidar.noise = 0.05;
    for autoreset in [true, false] {
        let simulator = |threads| BatchSim::new(config.clone(), 7, 0, threads, autoreset, None).unwrap();
        let ranges_of = |sim: &mut BatchSim| {
            sim.keep_ranges().unwrap();
            sim.ranges().to_vec()
        };
        let mut kept = simulator(1);
        let first = ranges_of(&mut kept);
        assert!(simulator(1).ranges().is_empty());
        for steps in [0, 1, 150] {
            let mut late = simulator(2);
            for t in 0..steps {
                late.step(&actions(7, t)).unwrap();
                kept.step(&actions(7, t)).unwrap();
            }
            assert!(steps == 0 || kept.ranges() != first);
            assert_eq!(ranges_of(&mut late), kept.ranges());
            late.restore(&simulator(1).state().unwrap()).unwrap();
            assert_eq!(late.ranges(), first);
            kept.restore(&simulator(1).state().unwrap()).unwrap();
        }
    }
}
