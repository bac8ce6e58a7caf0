//! What holds for every controller: commands within the limits, whatever the scan; the same command for a robot in any
//! batch; refusals that decide nothing.

#![allow(clippy::unwrap_used)]

use navsim::controller::{Controller, ControllersConfig, Inputs, Kind};
use navsim::rng::{Purpose, Split, Stream, StreamName};
use navsim::{Error, SimConfig};

fn sim() -> SimConfig {
    SimConfig::from_json(include_str!("defaults.json")).unwrap()
}

/// Python's defaults, with fewer samples for MPPI.
fn settings() -> ControllersConfig {
    let mut settings = ControllersConfig::from_json(include_str!("controllers.json")).unwrap();
    (settings.mppi.samples, settings.mppi.steps) = (70, 15);
    settings
}

/// What `count` robots have: any scans with lost beams and beams without hit, goals all around, any speed.
struct Drawn {
    ranges: Vec<f32>,
    goals: Vec<f64>,
    velocities: Vec<f64>,
}

impl Drawn {
    fn new(count: usize, beams: usize, v_max: f64) -> Self {
        let mut random = Stream::new(StreamName::new(9, Purpose::World, Split::Test, 0, 0));
        let mut drawn = Self { ranges: Vec::new(), goals: Vec::new(), velocities: Vec::new() };
        for _ in 0..count {
            // From rooms so tight that everything touches to open ones.
            let far = random.uniform(0.1, 6.0);
            for _ in 0..beams {
                let kind = random.unit();
                drawn.ranges.push(match kind {
                    k if k < 0.05 => f32::NAN,
                    k if k < 0.10 => 10.0,
                    k if k < 0.11 => f32::INFINITY,
                    k if k < 0.12 => f32::NEG_INFINITY,
                    k if k < 0.13 => 0.0,
                    _ => random.uniform(0.05, far) as f32,
                });
            }
            drawn.goals.extend([random.uniform(0.0, 8.0) * f64::from(random.unit() > 0.1), random.uniform(-4.0, 4.0)]);
            drawn.velocities.extend([random.uniform(-0.1, 1.1 * v_max), random.uniform(-1.2, 1.2)]);
        }
        drawn
    }

    fn inputs(&self) -> Inputs<'_> {
        Inputs { robots: None, ranges: &self.ranges, goals: &self.goals, velocities: &self.velocities }
    }
}

#[test]
fn every_command_is_within_the_limits() {
    for [acceleration, angular] in [[0.0, 0.0], [1.0, 2.5], [0.01, 0.01]] {
        let mut sim = sim();
        (sim.robot.acceleration_max, sim.robot.angular_acceleration_max) = (acceleration, angular);
        let drawn = Drawn::new(300, sim.lidar.beams, sim.robot.v_max);
        for kind in Kind::ALL {
            let mut controller = Controller::new(kind, &settings(), &sim, 0).unwrap();
            let mut commands = vec![f64::NAN; 600];
            controller.command(&drawn.inputs(), &mut commands).unwrap();
            for (row, (command, now)) in commands.chunks(2).zip(drawn.velocities.chunks(2)).enumerate() {
                let [v, omega] = [command[0], command[1]];
                let context = format!("{} row {row}: {command:?} from {now:?}", kind.name());
                assert!((0.0..=0.5).contains(&v) && (-1.0..=1.0).contains(&omega), "{context}");
                // From a speed within the limits, the change is one that the acceleration allows.
                if acceleration > 0.0 && (0.0..=0.5).contains(&now[0]) && now[1].abs() <= 1.0 {
                    assert!((v - now[0]).abs() <= 0.1 * acceleration + 1e-12, "{context}");
                    assert!((omega - now[1]).abs() <= 0.1 * angular + 1e-12, "{context}");
                }
            }
        }
    }
}

/// Another footprint, a lidar of few beams all around that is mounted off the centre, and other limits.
#[test]
fn other_robots_get_commands_too() {
    let mut sim = sim();
    sim.robot.footprint = navsim::config::FootprintKind::Rectangle;
    (sim.robot.v_max, sim.robot.omega_max, sim.task.period) = (2.0, 0.4, 0.25);
    (sim.lidar.beams, sim.lidar.bins, sim.lidar.fov) = (7, 7, 2.0 * std::f64::consts::PI);
    sim.lidar.mount = [0.2, -0.1, 3.0];
    let drawn = Drawn::new(100, 7, 2.0);
    for kind in Kind::ALL {
        let mut commands = vec![f64::NAN; 200];
        Controller::new(kind, &settings(), &sim, 0).unwrap().command(&drawn.inputs(), &mut commands).unwrap();
        let within = |c: &[f64]| (0.0..=2.0).contains(&c[0]) && (-0.4..=0.4).contains(&c[1]);
        assert!(commands.chunks(2).all(within), "{}", kind.name());
    }
}

/// Three decisions of six robots together, and of each alone, named by its number.
#[test]
fn a_robot_gets_the_same_command_in_any_batch() {
    let sim = sim();
    let (beams, robots) = (sim.lidar.beams, 6);
    let drawn = Drawn::new(robots, beams, 0.5);
    for kind in Kind::ALL {
        let mut together = Controller::new(kind, &settings(), &sim, 3).unwrap();
        let mut alone = together.clone();
        for decision in 0..3 {
            let mut commands = vec![0.0; 2 * robots];
            together.command(&drawn.inputs(), &mut commands).unwrap();
            for robot in (0..robots).rev() {
                let inputs = Inputs {
                    robots: Some(&[robot as u32]),
                    ranges: &drawn.ranges[robot * beams..(robot + 1) * beams],
                    goals: &drawn.goals[2 * robot..2 * robot + 2],
                    velocities: &drawn.velocities[2 * robot..2 * robot + 2],
                };
                let mut command = [0.0; 2];
                alone.command(&inputs, &mut command).unwrap();
                assert_eq!(command, commands[2 * robot..2 * robot + 2], "{} {decision} {robot}", kind.name());
            }
        }
    }
}

#[test]
fn seeds_and_decisions_differ_and_a_reset_begins_anew() {
    let sim = sim();
    let drawn = Drawn::new(4, sim.lidar.beams, 0.5);
    for kind in [Kind::Mppi, Kind::Random] {
        let mut controller = Controller::new(kind, &settings(), &sim, 0).unwrap();
        let mut decide = || {
            let mut commands = vec![0.0; 8];
            controller.command(&drawn.inputs(), &mut commands).unwrap();
            commands
        };
        let (first, second) = (decide(), decide());
        assert_ne!(first, second);
        controller.reset();
        let mut again = vec![0.0; 8];
        controller.command(&drawn.inputs(), &mut again).unwrap();
        assert_eq!(first, again);
        let mut other = vec![0.0; 8];
        Controller::new(kind, &settings(), &sim, 1).unwrap().command(&drawn.inputs(), &mut other).unwrap();
        assert_ne!(first, other);
    }
}

#[test]
fn what_cannot_be_used_is_refused_before_any_decision() {
    let sim = sim();
    let drawn = Drawn::new(2, sim.lidar.beams, 0.5);
    let mut controller = Controller::new(Kind::Random, &settings(), &sim, 0).unwrap();
    let mut untouched = controller.clone();
    let mut commands = [7.0; 4];
    for goals in [[1.0, f64::NAN, 1.0, 0.0], [1.0, 0.0, f64::INFINITY, 0.0], [1.0, 0.0, -0.1, 0.0]] {
        let refused = controller.command(&Inputs { goals: &goals, ..drawn.inputs() }, &mut commands);
        assert!(matches!(refused, Err(Error::Number { name: "goal", .. })), "{refused:?}");
    }
    let refused =
        controller.command(&Inputs { velocities: &[0.0, f64::NAN, 0.0, 0.0], ..drawn.inputs() }, &mut commands);
    assert!(matches!(refused, Err(Error::Number { name: "velocity", row: 0, .. })), "{refused:?}");
    let refused = controller.command(&Inputs { ranges: &drawn.ranges[1..], ..drawn.inputs() }, &mut commands);
    assert!(matches!(refused, Err(Error::Length { name: "ranges", .. })), "{refused:?}");
    let refused = controller.command(&Inputs { robots: Some(&[0, u32::MAX]), ..drawn.inputs() }, &mut commands);
    assert!(matches!(refused, Err(Error::Setting { key: "robots", .. })), "{refused:?}");
    assert_eq!(commands, [7.0; 4]);
    let mut expected = [0.0; 4];
    untouched.command(&drawn.inputs(), &mut expected).unwrap();
    controller.command(&drawn.inputs(), &mut commands).unwrap();
    assert_eq!(commands, expected);
}

#[test]
fn settings_out_of_range_are_refused_by_key() {
    for (edit, key) in [
        (
            Box::new(|s: &mut ControllersConfig| s.dwa.horizon = 0.0) as Box<dyn Fn(&mut ControllersConfig)>,
            "dwa.horizon",
        ),
        (Box::new(|s| s.dwa.v_samples = 1), "dwa.v_samples"),
        (Box::new(|s| s.mppi.temperature = f64::NAN), "mppi.temperature"),
        (Box::new(|s| s.gap.reach = -1.0), "gap.reach"),
        (Box::new(|s| s.pursuit.lookahead = f64::INFINITY), "pursuit.lookahead"),
        (Box::new(|s| s.apf.repulsion = -1.0), "apf.repulsion"),
    ] {
        let mut settings = settings();
        edit(&mut settings);
        let refused = Controller::new(Kind::Dwa, &settings, &sim(), 0);
        assert!(matches!(&refused, Err(Error::Setting { key: named, .. }) if *named == key), "{key}");
    }
}

#[test]
fn names_are_read_back() {
    assert!(Kind::ALL.into_iter().all(|kind| Kind::named(kind.name()) == Some(kind)));
    assert_eq!(Kind::named("dwb"), None);
}
