use super::*;
use crate::rng::{Purpose, Split, Stream, StreamName};
use crate::world::Shape;
use std::time::Instant;

fn stream(seed: u64) -> Stream {
    Stream::new(StreamName::new(seed, Purpose::World, Split::Test, 0, 0))
}

fn dist(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt()
}

fn segments_of(shape: &Shape) -> Vec<([f64; 2], [f64; 2])> {
    let c = shape.corners();
    if let Shape::Circle { center, .. } = shape {
        return vec![(*center, *center)];
    }
    (0..c.len()).map(|i| (c[i], c[(i + 1) % c.len()])).collect()
}
fn reach(shape: &Shape, radius: f64) -> f64 {
    if let Shape::Circle { radius: r, .. } = shape { r + radius } else { radius }
}
fn to_seg(p: [f64; 2], (a, b): ([f64; 2], [f64; 2])) -> f64 {
    let l2 = dist(a, b).powi(2);
    let t = if l2 == 0.0 {
        0.0
    } else {
        (((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / l2).clamp(0.0, 1.0)
    };
    dist(p, [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])])
}
fn inside(shape: &Shape, p: [f64; 2]) -> bool {
    let c = shape.corners();
    c.len() > 2 && (0..c.len()).all(|i| crate::world::shapes::turn(c[i], c[(i + 1) % c.len()], p) > 0.0)
}
fn clear(shapes: &[Shape], radius: f64, p: [f64; 2]) -> f64 {
    shapes
        .iter()
        .map(|s| {
            if inside(s, p) {
                return -1.0;
            }
            segments_of(s).into_iter().map(|e| to_seg(p, e)).fold(f64::INFINITY, f64::min) - reach(s, radius)
        })
        .fold(f64::INFINITY, f64::min)
}
fn seg_seg(a: [f64; 2], b: [f64; 2], c: [f64; 2], d: [f64; 2]) -> f64 {
    let t = crate::world::shapes::turn;
    if t(a, b, c) * t(a, b, d) < 0.0 && t(c, d, a) * t(c, d, b) < 0.0 {
        return 0.0;
    }
    to_seg(a, (c, d)).min(to_seg(b, (c, d))).min(to_seg(c, (a, b))).min(to_seg(d, (a, b)))
}
fn seg_free(shapes: &[Shape], radius: f64, a: [f64; 2], b: [f64; 2]) -> bool {
    shapes.iter().all(|s| segments_of(s).into_iter().all(|(c, d)| seg_seg(a, b, c, d) >= reach(s, radius) - 1e-10))
}

/// visibility graph of circumscribed polygons about the corner circles
fn visibility(shapes: &[Shape], radius: f64, start: [f64; 2], goal: [f64; 2], gr: f64, n: usize) -> Option<f64> {
    let mut points = vec![start];
    let k = 1.0 / (std::f64::consts::PI / n as f64).cos();
    for s in shapes {
        let centers = if let Shape::Circle { center, .. } = s { vec![*center] } else { s.corners() };
        for c in centers {
            for i in 0..n {
                let a = std::f64::consts::TAU * i as f64 / n as f64;
                let p = [c[0] + k * reach(s, radius) * a.cos(), c[1] + k * reach(s, radius) * a.sin()];
                if clear(shapes, radius, p) >= 0.0 {
                    points.push(p);
                }
            }
        }
    }
    let first_end = points.len();
    for i in 0..4 * n {
        let a = std::f64::consts::TAU * i as f64 / (4 * n) as f64;
        let p = [goal[0] + gr * a.cos(), goal[1] + gr * a.sin()];
        if clear(shapes, radius, p) >= 0.0 {
            points.push(p);
        }
    }
    let mut g = vec![f64::INFINITY; points.len()];
    let mut done = vec![false; points.len()];
    g[0] = 0.0;
    let mut best = f64::INFINITY;
    loop {
        let Some(i) = (0..points.len()).filter(|i| !done[*i]).min_by(|a, b| g[*a].total_cmp(&g[*b])) else { break };
        if g[i] >= best || g[i].is_infinite() {
            break;
        }
        done[i] = true;
        if i >= first_end {
            best = g[i];
            break;
        }
        let d = dist(points[i], goal);
        if d <= gr {
            best = best.min(g[i]);
            continue;
        }
        let q = [goal[0] + (points[i][0] - goal[0]) / d * gr, goal[1] + (points[i][1] - goal[1]) / d * gr];
        if g[i] + d - gr < best && seg_free(shapes, radius, points[i], q) && clear(shapes, radius, q) >= -1e-10 {
            best = g[i] + d - gr;
        }
        for j in 0..points.len() {
            if !done[j] {
                let c = g[i] + dist(points[i], points[j]);
                if c < g[j] && c < best && seg_free(shapes, radius, points[i], points[j]) {
                    g[j] = c;
                }
            }
        }
    }
    best.is_finite().then_some(best)
}

fn random_shape(r: &mut Stream, half: f64) -> Shape {
    let c = [r.uniform(-half, half), r.uniform(-half, half)];
    match (r.unit() * 4.0) as u32 {
        0 => Shape::Circle { center: c, radius: r.uniform(0.05, 0.6) },
        1 => {
            Shape::Box { center: c, yaw: r.uniform(-3.2, 3.2), length: r.uniform(0.3, 1.2), width: r.uniform(0.3, 1.2) }
        }
        2 => {
            let a = r.uniform(0.0, 6.3);
            let l = r.uniform(0.5, 2.5);
            Shape::Segment { a: c, b: [c[0] + l * a.cos(), c[1] + l * a.sin()] }
        }
        _ => {
            let n = 3 + (r.unit() * 4.0) as usize;
            let s = r.uniform(0.3, 0.9);
            let o = r.uniform(0.0, 6.0);
            Shape::polygon(
                (0..n)
                    .map(|i| {
                        let a = o + 6.283185 * (i as f64 + 0.5 * r.unit()) / n as f64;
                        [c[0] + s * a.cos(), c[1] + s * a.sin()]
                    })
                    .collect(),
            )
            .unwrap()
        }
    }
}

fn free_point(r: &mut Stream, shapes: &[Shape], radius: f64, half: f64) -> [f64; 2] {
    loop {
        let p = [r.uniform(-half, half), r.uniform(-half, half)];
        if clear(shapes, radius, p) >= 0.0 {
            return p;
        }
    }
}

#[test]
fn brute() {
    let mut errs = vec![];
    let (mut t1, mut t2) = (0.0, 0.0);
    for seed in 0..300 {
        let mut r = stream(seed);
        let half = 3.0;
        let mut shapes: Vec<Shape> = (0..8).map(|_| random_shape(&mut r, half)).collect();
        if seed % 2 == 0 {
            for (a, b) in
                [([-3., -3.], [3., -3.]), ([3., -3.], [3., 3.]), ([3., 3.], [-3., 3.]), ([-3., 3.], [-3., -3.])]
            {
                shapes.push(Shape::Segment { a, b });
            }
        }
        let radius = r.uniform(0.05, 0.3);
        let start = free_point(&mut r, &shapes, radius, half);
        let goal = free_point(&mut r, &shapes, radius, half);
        let gr = if seed % 3 == 0 { 0.01 } else { 0.3 };
        let t = Instant::now();
        let l = shortest_path(&shapes, radius, start, goal, gr);
        t1 += t.elapsed().as_secs_f64();
        let t = Instant::now();
        let v = visibility(&shapes, radius, start, goal, gr, 64);
        t2 += t.elapsed().as_secs_f64();
        match (l, v) {
            (Some(l), Some(v)) => {
                let e = (v - l) / l.max(0.1);
                if !(-1e-9..2e-3).contains(&e) {
                    println!("seed {seed} {l} {v} {e}");
                }
                errs.push(e);
            }
            (None, None) => {}
            _ => println!("seed {seed} {l:?} {v:?}"),
        }
    }
    errs.sort_by(f64::total_cmp);
    println!(
        "n {} min {:e} mean {:e} p99 {:e} max {:e}; {t1} {t2}",
        errs.len(),
        errs[0],
        errs.iter().sum::<f64>() / errs.len() as f64,
        errs[errs.len() * 99 / 100],
        errs[errs.len() - 1]
    );
}

fn td3(r: &mut Stream) -> Vec<Shape> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let b = |x: f64, y: f64, length: f64, yaw: f64| Shape::Box { center: [x, y], yaw, length, width: 0.15 };
    let mut s = vec![
        b(0., 5.425, 11., 0.),
        b(5.425, 0., 11., -FRAC_PI_2),
        b(0., -5.425, 11., PI),
        b(-5.425, 0., 11., PI / 2.),
        b(-2.152, 1.857, 2.5, 0.),
        b(-2.155, 1.764, 2.75, -FRAC_PI_2),
        b(2.724, 3.029, 1.268, 0.),
        b(3.292, 2.622, 0.965, -1.55),
        b(2.75, 2.214, 1.25, PI),
        b(2.183, 2.622, 0.965, 1.614),
        b(-2.896, -2.491, 1.977, 1.0946),
        b(-1.971, -2.491, 2.064, -1.0133),
        b(-2.39, -3.285, 2.0, PI),
        b(2.388, -2.48, 1.75, 0.),
        b(3.206, -1.288, 2.5, FRAC_PI_2),
        Shape::Circle { center: [-4.572, 4.551], radius: 0.2 },
        Shape::Box { center: [4.784, -3.93], yaw: 0., length: 0.92, width: 0.4 },
        Shape::Box { center: [-4.342, -0.533], yaw: 0., length: 1.5, width: 0.8 },
    ];
    for _ in 0..4 {
        s.push(Shape::Box {
            center: [r.uniform(-4.5, 4.5), r.uniform(-4.5, 4.5)],
            yaw: r.uniform(-3.2, 3.2),
            length: 0.5,
            width: 0.4,
        });
    }
    s
}

fn room(h: f64) -> Vec<Shape> {
    [([-h, -h], [h, -h]), ([h, -h], [h, h]), ([h, h], [-h, h]), ([-h, h], [-h, -h])]
        .map(|(a, b)| Shape::Segment { a, b })
        .to_vec()
}

fn cpu() -> f64 {
    let t = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    t.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9
}

fn report(name: &str, times: &mut Vec<f64>, none: usize) {
    times.sort_by(f64::total_cmp);
    println!(
        "{name}: n {} none {none} median {:.2} p90 {:.2} max {:.2} ms",
        times.len(),
        times[times.len() / 2] * 1e3,
        times[times.len() * 9 / 10] * 1e3,
        times[times.len() - 1] * 1e3
    );
}

fn time(name: &str, count: u64, radius: f64, half: f64, make: impl Fn(&mut Stream) -> Vec<Shape>) {
    let (mut times, mut none) = (vec![], 0);
    for seed in 0..count {
        let mut r = stream(seed);
        let shapes = make(&mut r);
        let start = free_point(&mut r, &shapes, radius, half);
        let goal = free_point(&mut r, &shapes, radius, half);
        let t = cpu();
        let l = shortest_path(&shapes, radius, start, goal, 0.3);
        let dt = cpu() - t;
        none += usize::from(l.is_none());
        if needs_detour(&shapes, radius, start, goal) {
            times.push(dt);
        }
    }
    report(name, &mut times, none);
}

#[test]
#[ignore = "timing"]
fn timing() {
    time("td3", 400, 0.25, 4.5, td3);
    for (radius, size) in [(0.25, 0.05), (0.2, 0.1), (0.15, 0.2), (0.1, 0.1), (0.05, 0.1)] {
        time(&format!("1000 circles r={radius} size {size}"), 40, radius, 9.5, |r| {
            let mut s = room(10.0);
            for _ in 0..1000 {
                s.push(Shape::Circle {
                    center: [r.uniform(-10., 10.), r.uniform(-10., 10.)],
                    radius: r.uniform(0.5 * size, 1.5 * size),
                });
            }
            s
        });
    }
    // grid of circles, all gaps free
    time("grid circles", 40, 0.15, 9.5, |r| {
        let mut s = room(10.0);
        for i in 0..1000 {
            let (x, y) = (i % 32, i / 32);
            s.push(Shape::Circle {
                center: [
                    -9.7 + 0.62 * f64::from(x) + r.uniform(-0.02, 0.02),
                    -9.7 + 0.62 * f64::from(y) + r.uniform(-0.02, 0.02),
                ],
                radius: 0.12,
            });
        }
        s
    });
    for (count, half, length) in [(2000, 20.0, 1.0), (5000, 50.0, 2.0)] {
        time(&format!("{count} segments"), 20, 0.25, half - 0.5, move |r| {
            let mut s = room(half);
            for _ in 0..count {
                let a = r.uniform(0.0, 6.28);
                let l = r.uniform(0.2, length);
                let c = [r.uniform(-half, half), r.uniform(-half, half)];
                s.push(Shape::Segment { a: c, b: [c[0] + l * a.cos(), c[1] + l * a.sin()] });
            }
            s
        });
    }
    // rectilinear maze: perfect spanning tree 30x30, cell 1 m
    for (n, cell, radius) in [(30usize, 1.0, 0.25), (50, 1.0, 0.05), (50, 2.0, 0.25)] {
        time(&format!("maze {n} cell {cell} r {radius}"), 10, radius, 0.5 * n as f64 * cell - 0.5, move |r| {
            let h = 0.5 * n as f64 * cell;
            let mut s = room(h);
            let mut seen = vec![false; n * n];
            let mut open = vec![[false; 2]; n * n];
            let mut stack = vec![0usize];
            seen[0] = true;
            while let Some(&i) = stack.last() {
                let (x, y) = (i % n, i / n);
                let mut o = vec![];
                if x > 0 && !seen[i - 1] {
                    o.push(i - 1)
                }
                if x + 1 < n && !seen[i + 1] {
                    o.push(i + 1)
                }
                if y > 0 && !seen[i - n] {
                    o.push(i - n)
                }
                if y + 1 < n && !seen[i + n] {
                    o.push(i + n)
                }
                if o.is_empty() {
                    stack.pop();
                    continue;
                }
                let j = o[(r.unit() * o.len() as f64) as usize];
                open[i.min(j)][usize::from(i.abs_diff(j) == n)] = true;
                seen[j] = true;
                stack.push(j);
            }
            for i in 0..n * n {
                let (x, y) = ((i % n) as f64 * cell - h, (i / n) as f64 * cell - h);
                if i % n + 1 < n && !open[i][0] {
                    s.push(Shape::Segment { a: [x + cell, y], b: [x + cell, y + cell] });
                }
                if i / n + 1 < n && !open[i][1] {
                    s.push(Shape::Segment { a: [x, y + cell], b: [x + cell, y + cell] });
                }
            }
            s
        });
    }
    // open world, no walls, far apart
    time("open 10 circles 200 m", 20, 0.25, 100.0, |r| {
        (0..10)
            .map(|_| Shape::Circle { center: [r.uniform(-100., 100.), r.uniform(-100., 100.)], radius: 20.0 })
            .collect()
    });
    for n in [1000usize] {
        let grid = Grid { origin: [0.0, 0.0], cell: 0.01, columns: n, rows: n };
        let t = cpu();
        let f = Field::march(grid, &vec![false; n * n], &[(n * n / 3, 0.0)]);
        println!("field {n}: {:.1} ms {}", (cpu() - t) * 1e3, f.distances()[n * n / 2 + 7]);
    }
}
#[test]
#[ignore = "timing"]
fn slow() {
    let (count, half, length, radius) = (5000, 50.0, 2.0, 0.25);
    for seed in 0..20 {
        let mut r = stream(seed);
        let mut s = room(half);
        for _ in 0..count {
            let a = r.uniform(0.0, 6.28);
            let l = r.uniform(0.2, length);
            let c = [r.uniform(-half, half), r.uniform(-half, half)];
            s.push(Shape::Segment { a: c, b: [c[0] + l * a.cos(), c[1] + l * a.sin()] });
        }
        let start = free_point(&mut r, &s, radius, half - 0.5);
        let goal = free_point(&mut r, &s, radius, half - 0.5);
        let t = Instant::now();
        let l = shortest_path(&s, radius, start, goal, 0.3);
        println!("seed {seed} {start:?} {goal:?} {l:?} {:.1}", t.elapsed().as_secs_f64() * 1e3);
    }
}

use super::shortest_path::around;
use super::{
    goal_disc::GoalDisc,
    guide::Guide,
    inflated::{Inflated, Solid},
};
fn grow(shapes: &[Shape], radius: f64) -> (Vec<Solid>, [f64; 4]) {
    let solids: Vec<Solid> = shapes.iter().map(|s| Solid::new(s, radius)).collect();
    let b = solids
        .iter()
        .map(Solid::bounds)
        .fold([f64::INFINITY, f64::INFINITY, -f64::INFINITY, -f64::INFINITY], |a, b| {
            [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
        });
    (solids, [b[0] - 5.0, b[1] - 5.0, b[2] + 5.0, b[3] + 5.0])
}
fn marched(shapes: &[Shape], radius: f64, start: [f64; 2], goal: [f64; 2], gr: f64) -> f64 {
    let (solids, bounds) = grow(shapes, radius);
    let w = Inflated::new(solids, bounds);
    let j = w.joints();
    let Some(g) = GoalDisc::new(&w, &j, start, goal, gr) else { return f64::NAN };
    let guide = Guide::new(&w, &j, &g, bounds, radius, 1.0);
    guide.remaining(start)
}
#[test]
#[ignore = "study"]
fn trust() {
    let mut worst = vec![];
    let (mut differ, mut infs) = (0, 0);
    for seed in 0..4000u64 {
        let mut r = stream(seed);
        let half = 3.0;
        let n = 8 + (seed % 20) as usize;
        let mut shapes: Vec<Shape> = (0..n).map(|_| random_shape(&mut r, half)).collect();
        shapes.extend(room(3.0));
        let radius = r.uniform(0.05, 0.3);
        let start = free_point(&mut r, &shapes, radius, half);
        let goal = free_point(&mut r, &shapes, radius, half);
        let gr = if seed % 3 == 0 { 0.01 } else { 0.3 };
        let solids = grow(&shapes, radius).0;
        if dist(start, goal) < gr {
            continue;
        }
        let a = around(solids.clone(), radius, start, goal, gr, 0.0);
        let b = shortest_path(&shapes, radius, start, goal, gr);
        let c = around(solids, radius, start, goal, gr, 1.0);
        let m = marched(&shapes, radius, start, goal, gr);
        match (a, b, c) {
            (Some(a), Some(b), Some(c)) => {
                if (a - b).abs() > 1e-9 || (a - c).abs() > 1e-9 {
                    differ += 1;
                    println!("seed {seed} {a} {b} {c}");
                }
                worst.push(((m - a) / (radius / 3.0), m / a - 1.0, a, seed));
                if m < a * 0.7 {
                    infs += 1;
                }
            }
            (None, None, None) => {}
            _ => println!("seed {seed} {a:?} {b:?}"),
        }
    }
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("differ {differ} weak {infs} of {} worst by cells {:?}", worst.len(), &worst[..8]);
    worst.sort_by(|a, b| b.1.total_cmp(&a.1));
    println!("worst by share {:?}", &worst[..8]);
    worst.sort_by(|a, b| a.1.total_cmp(&b.1));
    println!("weakest {:?}", &worst[..8]);
    println!("mean {}", worst.iter().map(|w| w.1).sum::<f64>() / worst.len() as f64);
}

#[test]
#[ignore = "study"]
fn corridors() {
    for (gap, len) in [(1e-6, 5.0), (1e-6, 20.0), (0.02, 5.0), (0.1, 5.0)] {
        let mut worst: (f64, f64, f64) = (-1.0, 0.0, 0.0);
        for k in 0..400 {
            let mut r = stream(k);
            let a = r.uniform(0.0, 6.28);
            let radius = 0.25;
            let o = [r.uniform(0.0, 0.1), r.uniform(0.0, 0.1)];
            let at = |x: f64, y: f64| [o[0] + x * a.cos() - y * a.sin(), o[1] + x * a.sin() + y * a.cos()];
            let h = radius + 0.5 * gap;
            let shapes =
                [Shape::Segment { a: at(0.0, h), b: at(len, h) }, Shape::Segment { a: at(0.0, -h), b: at(len, -h) }];
            let (s, g) = (at(-0.5, 0.0), at(len + 0.5, 0.0));
            let m = marched(&shapes, radius, s, g, 0.3) / (len + 0.7) - 1.0;
            if m > worst.0 {
                worst = (m, a, 0.0);
            }
        }
        println!("gap {gap} len {len}: {worst:?}");
    }
}
#[test]
#[ignore = "study"]
fn differing() {
    for seed in [234u64, 2106, 2965, 3213, 3745] {
        let mut r = stream(seed);
        let half = 3.0;
        let n = 8 + (seed % 20) as usize;
        let mut shapes: Vec<Shape> = (0..n).map(|_| random_shape(&mut r, half)).collect();
        shapes.extend(room(3.0));
        let radius = r.uniform(0.05, 0.3);
        let start = free_point(&mut r, &shapes, radius, half);
        let goal = free_point(&mut r, &shapes, radius, half);
        let gr = if seed % 3 == 0 { 0.01 } else { 0.3 };
        let solids = grow(&shapes, radius).0;
        let a = around(solids.clone(), radius, start, goal, gr, 0.0);
        let b = shortest_path(&shapes, radius, start, goal, gr);
        println!(
            "{seed} n {n} radius {radius} gr {gr} start {start:?} clear {} goal {goal:?} clear {} a {a:?} b {b:?}",
            clear(&shapes, radius, start),
            clear(&shapes, radius, goal)
        );
        for n in [64, 256] {
            println!("  {:?}", visibility(&shapes, radius, start, goal, gr, n));
        }
        for t in [0.0, 0.2, 0.5, 0.8, 0.9, 0.95] {
            println!("  trust {t} {:?}", around(solids.clone(), radius, start, goal, gr, t));
        }
        println!("{:?}", std::env::var("SHAPES").map(|_| &shapes));
    }
}
