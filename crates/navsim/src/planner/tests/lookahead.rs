//! Intermediate goals along paths, by hand and by their properties.

use super::super::Lookahead;
use crate::error::Error;
use crate::grown::tests::stream;
use crate::grown::{Point, apart};

fn follow(path: &[Point], goal: Point, distance: f64) -> impl FnMut(Point) -> (Point, f64) {
    let mut guide = Lookahead::new(&[path.to_vec()], &[goal], distance).unwrap();
    move |position| {
        let mut target = [[0.0; 2]];
        guide.update(&[position], &mut target).unwrap();
        (target[0], guide.progress()[0])
    }
}

fn near(a: Point, b: Point) -> bool {
    apart(a, b) < 1e-12
}

#[test]
fn targets_known_by_hand() {
    let mut at = follow(&[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]], [4.0, 3.2], 1.5);
    let (target, progress) = at([0.0, 0.0]);
    assert!(near(target, [1.5, 0.0]) && progress == 0.0);
    // Beside the path.
    let (target, progress) = at([1.0, 0.7]);
    assert!(near(target, [2.5, 0.0]) && (progress - 1.0).abs() < 1e-12);
    // Back again: progress stays.
    let (target, progress) = at([0.2, 0.0]);
    assert!(near(target, [2.5, 0.0]) && (progress - 1.0).abs() < 1e-12);
    // Around the corner.
    at([2.4, 0.1]);
    let (target, progress) = at([3.5, -0.2]);
    assert!(near(target, [4.0, 1.0]) && (progress - 3.5).abs() < 1e-12);
    // Close to the end the goal itself.
    let (target, _) = at([4.1, 1.0]);
    assert!(near(target, [4.0, 2.5]));
    let (target, progress) = at([4.0, 1.6]);
    assert!(near(target, [4.0, 3.2]) && (progress - 5.6).abs() < 1e-12);
    at([4.0, 2.9]);
    let (target, progress) = at([4.0, 5.0]);
    assert!(near(target, [4.0, 3.2]) && (progress - 7.0).abs() < 1e-12);
    let (target, progress) = at([0.0, 0.0]);
    assert!(near(target, [4.0, 3.2]) && (progress - 7.0).abs() < 1e-12);
}

#[test]
fn without_a_path_the_target_is_the_goal() {
    for path in [vec![], vec![[1.0, 1.0]], vec![[1.0, 1.0], [1.0, 1.0]]] {
        let mut at = follow(&path, [2.0, 3.0], 1.0);
        assert_eq!(at([-5.0, 0.0]), ([2.0, 3.0], 0.0));
        assert_eq!(at([2.0, 3.0]), ([2.0, 3.0], 0.0));
    }
}

#[test]
fn a_path_that_crosses_itself_is_followed_all_the_way() {
    // A loop that comes back over its beginning.
    let path = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [1.0, 3.0], [1.0, -3.0]];
    let mut at = follow(&path, [1.0, -3.0], 0.8);
    let (mut last, mut place) = (0.0, path[0]);
    for _ in 0..400 {
        let (target, progress) = at(place);
        assert!(progress >= last && progress <= last + 0.8 + 1e-12);
        last = progress;
        let away = apart(place, target);
        if away > 0.0 {
            let step = (0.05 / away).min(1.0);
            place = [place[0] + step * (target[0] - place[0]), place[1] + step * (target[1] - place[1])];
        }
    }
    assert!(apart(place, [1.0, -3.0]) < 0.05 && last > 14.5, "{place:?} {last}");
}

#[test]
fn many_robots_are_led_as_each_alone() {
    let mut random = stream(3);
    let mut point = || [random.uniform(-5.0, 5.0), random.uniform(-5.0, 5.0)];
    let paths: Vec<Vec<Point>> = (0..40).map(|i| (0..i % 9).map(|_| point()).collect()).collect();
    let goals: Vec<Point> = (0..40).map(|_| point()).collect();
    let mut together = Lookahead::new(&paths, &goals, 0.7).unwrap();
    let mut alone: Vec<_> = (0..40).map(|i| follow(&paths[i], goals[i], 0.7)).collect();
    let mut targets = vec![[0.0; 2]; 40];
    for _ in 0..50 {
        let positions: Vec<Point> = (0..40).map(|_| point()).collect();
        let before = together.progress().to_vec();
        together.update(&positions, &mut targets).unwrap();
        for i in 0..40 {
            assert_eq!(alone[i](positions[i]), (targets[i], together.progress()[i]));
            assert!(together.progress()[i] >= before[i]);
        }
    }
    assert!(together.progress().iter().any(|progress| *progress > 5.0));
}

#[test]
fn bad_numbers_change_nothing() {
    let path = vec![vec![[0.0, 0.0], [4.0, 0.0]]];
    for distance in [0.0, -1.0, f64::NAN, 2000.0] {
        assert!(matches!(Lookahead::new(&path, &[[4.0, 0.0]], distance), Err(Error::Setting { key: "distance", .. })));
    }
    assert!(matches!(Lookahead::new(&path, &[], 1.0), Err(Error::Length { name: "goals", .. })));
    assert!(matches!(
        Lookahead::new(&[vec![[f64::NAN, 0.0]]], &[[0.0, 0.0]], 1.0),
        Err(Error::NotFinite { name: "paths", .. })
    ));
    let mut guide = Lookahead::new(&[path[0].clone(), path[0].clone()], &[[4.0, 0.0]; 2], 1.0).unwrap();
    let mut targets = [[7.0; 2]; 2];
    assert!(guide.update(&[[1.0, 0.0], [f64::INFINITY, 0.0]], &mut targets).is_err());
    assert!(guide.update(&[[1.0, 0.0]], &mut targets).is_err());
    assert_eq!((targets, guide.progress()), ([[7.0; 2]; 2], [0.0; 2].as_slice()));
    assert!(guide.len() == 2 && !guide.is_empty());
}
