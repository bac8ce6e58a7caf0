//! Scenarios and world files as text: round trips and refusals.

#![allow(clippy::unwrap_used)]

use navsim::error::Error;
use navsim::pose::Pose;
use navsim::robot::Footprint;
use navsim::world::{Scenario, ScenarioList, Shape, WorldFile};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const DISC: Footprint = Footprint::Disc { radius: 0.25 };
const OPEN: &str = r#"{"start": [0, 0, 0], "goal": [3, 0], "goal_radius": 0.3, "time_limit": 50"#;

fn open_with(more: &str) -> String {
    format!("{OPEN}{more}}}")
}

fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![-1000.0..1000.0, -1e-9..1e-9, Just(0.0), Just(-0.0), Just(0.1)]
}

fn point() -> impl Strategy<Value = [f64; 2]> {
    [coordinate(), coordinate()]
}

fn shapes() -> impl Strategy<Value = Vec<Shape>> {
    let size = || 1e-4..1000.0;
    let circle = (point(), size()).prop_map(|(center, radius)| Shape::Circle { center, radius });
    let solid_box = (point(), coordinate(), size(), size()).prop_map(|(center, yaw, length, width)| Shape::Box {
        center,
        yaw,
        length,
        width,
    });
    let segment = (point(), 1.0..2.0).prop_map(|(a, l)| Shape::Segment { a, b: [a[0] * 0.99 + l, a[1] * 0.99] });
    let segment = segment.prop_filter("in range", |s| s.validate().is_ok());
    let polygon = (point(), 3usize..10, 0.1..3.0).prop_filter_map("convex", |(center, n, radius)| {
        let corner = |i| {
            let angle = std::f64::consts::TAU * i as f64 / n as f64;
            [center[0] + radius * angle.cos(), center[1] + radius * angle.sin()]
        };
        Shape::polygon((0..n).map(corner).collect()).ok()
    });
    let list = |s: BoxedStrategy<Shape>| proptest::collection::vec(s, 0..4);
    (list(circle.boxed()), list(solid_box.boxed()), list(segment.boxed()), list(polygon.boxed()))
        .prop_map(|(a, b, c, d)| [a, b, c, d].concat())
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(3), failure_persistence: None, ..Default::default() })]

    #[test]
    fn a_scenario_reads_back_bit_by_bit(
        shapes in shapes(),
        start in (coordinate(), coordinate(), coordinate()),
        goal in point(),
        goal_radius in 1e-12..100.0,
        time_limit in 1e-3..1e6,
        shortest in proptest::option::of(0.0..1e4),
    ) {
        let start = Pose::new(start.0, start.1, start.2);
        let scenario = Scenario { start, goal, goal_radius, time_limit, shapes, shortest };
        let text = scenario.to_json();
        let back = Scenario::from_json(&text).unwrap();
        // Debug tells -0 from 0, which == does not.
        prop_assert_eq!(format!("{back:?}"), format!("{scenario:?}"));
        prop_assert_eq!(back.to_json(), text);
    }

    #[test]
    fn no_text_makes_the_reader_panic(text in ".{0,60}", cut in 0usize..200) {
        let _ = Scenario::from_json(&text);
        let whole = open_with(r#", "boxes": [[1, 2, 0.5, 1, 2]], "polygons": [[[0, 5], [1, 5], [0, 6]]]"#);
        let _ = Scenario::from_json(&whole.chars().take(cut).collect::<String>());
        let _ = WorldFile::from_json(&text);
    }
}

#[test]
fn a_scenario_is_written_as_short_as_it_reads_back() {
    let text = r#"{"start":[0,-0.5,3.25],"goal":[3,1e-7],"goal_radius":0.3,"time_limit":50,"shortest":2.7,"#.to_owned()
        + r#""circles":[[1,2,0.5]],"boxes":[[1,2,7,0.5,2]],"segments":[[0,0,1,1]],"polygons":[[[0,0],[1,0],[0,1]]]}"#;
    assert_eq!(Scenario::from_json(&text).unwrap().to_json(), text);
}

#[test]
fn refusals_name_the_key_the_value_and_what_was_expected() {
    let refused = |text: &str| Scenario::from_json(text).unwrap_err().to_string();
    for (more, expected) in [
        (r#", "circle": []"#, "unknown key 'circle' (nearest: 'circles')"),
        (r#", "goal": [1, 2]"#, "key 'goal' stands twice"),
        (r#", "circles": [[1, 2, 0.5], [1, 2]]"#, "circles[1]: circle = [1,2]: expected [x, y, radius]"),
        (r#", "circles": [[1, 2, 0]]"#, "circles[0]: radius of a circle = 0"),
        (r#", "boxes": [[1, 2, 0, 1, "a"]]"#, r#"boxes[0]: box = [1,2,0,1,"a"]"#),
        (r#", "segments": {}"#, "segments = {}: expected a list"),
        (r#", "segments": [[1, 1, 1, 1]]"#, "segments[0]: length of a segment = 0"),
        (r#", "segments": [[1, 1, 1, 2000]]"#, "segments[0]: segment: 2000 is not a number within +-1000"),
        (r#", "polygons": [[[0, 0], [1, 0]]]"#, "polygons[0]: polygon with 2 corners"),
        (r#", "polygons": [[[0, 0], [2, 0], [0.5, 0.5], [0, 2]]]"#, "polygons[0]: polygon: its corners"),
        (r#", "shortest": -1"#, "shortest = -1: expected a number >= 0"),
        (r#", "shortest": NaN"#, "not a JSON object: expected value"),
        (r#", "shortest": 1e999"#, "not a JSON object: number out of range"),
    ] {
        let message = refused(&open_with(more));
        assert!(message.contains(expected) && !message.contains('\n'), "{message}");
    }
    for (text, expected) in [
        ("[]", "not a JSON object"),
        (r#"{"start": [0, 0, 0], "goal": [3, 0], "goal_radius": 0.3}"#, "key 'time_limit' is missing"),
        (
            r#"{"start": [0, 0], "goal": [3, 0], "goal_radius": 0.3, "time_limit": 50}"#,
            "start = [0,0]: expected [x, y, yaw]",
        ),
        (r#"{"start": [0, 0, 0], "goal": [3, 5000], "goal_radius": 0.3, "time_limit": 50}"#, "goal = 5000: expected"),
        (
            r#"{"start": [0, 0, 0], "goal": [3, 0], "goal_radius": 0, "time_limit": 50}"#,
            "goal_radius = 0: expected a number in (0, 100]",
        ),
        (
            r#"{"start": [0, 0, 0], "goal": [3, 0], "goal_radius": 1, "time_limit": true}"#,
            "time_limit = true: expected",
        ),
    ] {
        let message = refused(text);
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn lists_count_every_line_and_pass_over_blank_ones() {
    let good = open_with("");
    let text = format!("\u{feff}{good}\r\n\r\n{good}\n   \n");
    assert_eq!(ScenarioList::read(&text, &DISC).lines, [1, 3]);
    assert!(ScenarioList::read("\n", &DISC).scenarios.is_empty());
    let text = format!("{good}\n\n{{}}\n{good}\n{}", open_with(r#", "circles": [[0.1, 0, 0.2]]"#));
    let list = ScenarioList::read(&text, &DISC);
    assert!(list.refused[0].to_string().starts_with("line 3: key 'start' is missing"));
    assert_eq!((list.scenarios.len(), list.lines, list.refused.len()), (2, vec![1, 4], 2));
    assert!(matches!(&list.refused[1], Error::Line { line: 5, reason } if reason.contains("in contact")));
}

fn check(more: &str, footprint: &Footprint) -> Result<(), String> {
    Scenario::from_json(&open_with(more)).unwrap().check(footprint).map_err(|e| e.to_string())
}

#[test]
fn contact_at_the_start_is_judged_by_the_footprint() {
    let flat = Footprint::Rectangle { length: 0.6, width: 0.3 };
    // A wall 0.2 m to the left touches the disc, but not the rectangle.
    let wall = r#", "segments": [[-1, 0.2, 1, 0.2]]"#;
    assert!(check(wall, &DISC).unwrap_err().contains("clearance is 0.0000 m"));
    check(wall, &flat).unwrap();
    // A wall 0.28 m ahead: the other way round.
    let wall = r#", "segments": [[0.28, -0.5, 0.28, 0.5]]"#;
    check(wall, &DISC).unwrap();
    assert!(check(wall, &flat).unwrap_err().contains("in contact"));
}

#[test]
fn goals_must_be_reachable_for_this_robot() {
    let small = Footprint::Disc { radius: 0.1 };
    assert!(check(r#", "circles": [[3, 0.4, 0.2]]"#, &DISC).unwrap_err().contains("cannot be stood on"));
    check(r#", "circles": [[3, 0.4, 0.2]]"#, &small).unwrap();
    // A start within the goal, and a goal behind a wall that ends somewhere.
    check(r#", "segments": [[1.5, -20, 1.5, 20]]"#, &DISC).unwrap();
    // A closed room around the goal; then with a door of 0.45 m, of 0.55 m, and of 0.55 m in a slanted wall.
    let room = |door: f64| {
        let wall = format!("[2,-1,2,{}],[2,{},2,1]", -0.5 * door + 0.3, 0.5 * door + 0.3);
        format!(r#", "segments": [[2,1,4,1],[4,1,4,-1],[4,-1,2,-1],{wall}]"#)
    };
    for door in [0.0001, 0.3, 0.45, 0.48] {
        assert!(check(&room(door), &DISC).unwrap_err().contains("unreachable"), "{door}");
    }
    check(&room(0.51), &DISC).unwrap();
    check(&room(0.45), &small).unwrap();
    let slanted = |gap: f64| {
        let (end, begin) = (3.0 - 0.5 * gap / 2f64.sqrt(), 3.0 + 0.5 * gap / 2f64.sqrt());
        format!(
            r#", "segments": [[-9,-9,9,-9],[9,-9,9,9],[9,9,-9,9],[-9,9,-9,-9],[-6,9,{end},{0}],[{begin},{1},9,-6]]"#,
            3.0 - end,
            3.0 - begin
        )
    };
    let far = |more: &str, goal: &str| {
        let text = format!(r#"{{"start": [0, 0, 0], "goal": {goal}, "goal_radius": 0.3, "time_limit": 50{more}}}"#);
        Scenario::from_json(&text).unwrap().check(&DISC).map_err(|e| e.to_string())
    };
    far(&slanted(0.51), "[5, 5]").unwrap();
    assert!(far(&slanted(0.48), "[5, 5]").unwrap_err().contains("unreachable"));
}

#[test]
fn five_thousand_segments_are_checked_quickly_enough_for_a_list() {
    let mut segments: Vec<String> = (0..5000)
        .map(|i| format!("[{0},{1},{2},{1}]", -40 + i % 80, -30 + i / 80, f64::from(-40 + i % 80) + 0.3))
        .collect();
    segments.retain(|s| !s.starts_with("[0,0,") && !s.starts_with("[3,0,"));
    check(&format!(r#", "segments": [{}]"#, segments.join(",")), &DISC).unwrap();
}

#[test]
fn world_files_are_read_and_refused_with_file_and_key() {
    let full = r#"{"area": [-4, -3, 4, 3], "boxes": [[0, 0, 0.5, 1, 2]], "random_boxes": {"count": 3, "sides": [0.2, 0.4], "clearance": 0.5}}"#;
    let file = WorldFile::from_json(full).unwrap();
    assert_eq!((file.area, file.shapes.len()), ([-4.0, -3.0, 4.0, 3.0], 1));
    let random = file.random_boxes.unwrap();
    assert_eq!((random.count, random.sides, random.clearance), (3, [0.2, 0.4], 0.5));
    for (text, expected) in [
        (r#"{}"#, "key 'area' is missing"),
        (r#"{"area": [1, 0, 1, 2]}"#, "area = [1,0,1,2]: expected [x0, y0, x1, y1]"),
        (r#"{"area": [0, 0, 1, 2], "start": [0, 0, 0]}"#, "unknown key 'start'"),
        (r#"{"area": [0, 0, 1, 2], "random_boxes": 3}"#, "random_boxes = 3: expected an object"),
        (
            r#"{"area": [0, 0, 1, 2], "random_boxes": {"count": 2.5, "sides": [1, 2], "clearance": 0}}"#,
            "random_boxes.count = 2.5",
        ),
        (
            r#"{"area": [0, 0, 1, 2], "random_boxes": {"count": 2, "sides": [2, 1], "clearance": 0}}"#,
            "random_boxes.sides = [2,1]",
        ),
        (
            r#"{"area": [0, 0, 1, 2], "random_boxes": {"count": 2, "sides": [1, 2]}}"#,
            "key 'random_boxes.clearance' is missing",
        ),
        (
            r#"{"area": [0, 0, 1, 2], "random_boxes": {"counts": 2}}"#,
            "unknown key 'random_boxes.counts' (nearest: 'count')",
        ),
    ] {
        let message = WorldFile::from_json(text).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let message = WorldFile::read("no/such/file.json").unwrap_err().to_string();
    assert!(message.contains("world.name = 'no/such/file.json'"), "{message}");
}
