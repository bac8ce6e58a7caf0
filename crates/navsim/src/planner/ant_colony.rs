//! Ant colony optimisation on a map: ants walk at random, drawn by trails and by the goal; the best way is marked.
//!
//! Dorigo, Maniezzo and Colorni, "Ant system", IEEE Transactions on Systems, Man, and Cybernetics B 26, 1996; trails
//! between two limits that only the best ways strengthen: Stuetzle and Hoos, "MAX-MIN ant system", Future Generation
//! Computer Systems 16, 2000. An ant never visits a node twice and turns back where it is stuck, so that it comes to
//! the goal if there is a way; its way is then freed of its loops.

use super::budget::Budget;
use super::config::PlannerConfig;
use super::grid_search::{Route, STEPS};
use super::occupancy::{Anchor, Map};
use super::problem::Problem;
use crate::rng::Stream;

/// Strength of a trail that no ant has followed for long; the strongest is 1.
const TRAIL_MIN: f64 = 0.01;
/// Strength of every trail at the beginning: between the limits, so that a first best way already stands out.
const TRAIL_FIRST: f64 = 0.3;

/// A colony at work.
struct Colony<'a> {
    map: &'a Map,
    config: &'a PlannerConfig,
    /// Where a way may end, in rising order.
    goals: &'a [Anchor],
    /// Strength of the trail from each node along each of `STEPS`.
    trails: Vec<[f32; 8]>,
    /// Attraction of each step by its direction, in ratio to the best: exp(weight (cos angle - 1)), for 64 directions
    /// of the goal.
    pulls: Vec<[f32; 8]>,
    /// The ant that visited each node last, by number from 1.
    visited: Vec<u32>,
    /// Place of each node in the way that is being freed of loops.
    places: Vec<u32>,
    steps: u64,
}

/// Directions of the goal that are told apart.
const DIRECTIONS: usize = 64;

/// The shortest way that any ant of all rounds walked. `expansions` counts the steps of all ants.
pub(crate) fn ant_colony(
    problem: &Problem,
    map: &Map,
    config: &PlannerConfig,
    random: &mut Stream,
    budget: &mut Budget,
) -> Route {
    let (mut starts, goals) = (map.around(problem, problem.start), map.goals(problem));
    let mut best = Route { nodes: Vec::new(), length: f64::INFINITY, expansions: 0 };
    let mut colony = Colony::new(map, config, &goals);
    let mut ant = 0;
    while !goals.is_empty() && !starts.is_empty() && budget.spend() {
        let mut round = Route { nodes: Vec::new(), length: f64::INFINITY, expansions: 0 };
        for _ in 0..config.ants {
            if starts.is_empty() || budget.is_late() {
                break;
            }
            ant += 1;
            let start = starts[((random.unit() * starts.len() as f64) as usize).min(starts.len() - 1)];
            let Some(nodes) = colony.walk(start.0, problem.goal, ant, random) else {
                // Nothing leads on from there, nor from where else the ant has been.
                starts.retain(|(node, _)| colony.visited[*node] != ant);
                continue;
            };
            let nodes = colony.without_loops(&nodes);
            let length = start.1 + colony.length(&nodes);
            if length < round.length {
                (round.nodes, round.length) = (nodes, length);
            }
        }
        colony.fade();
        colony.mark(&round.nodes);
        if round.length < best.length {
            best = round;
        } else {
            colony.mark(&best.nodes);
        }
    }
    best.expansions = colony.steps;
    best
}

impl<'a> Colony<'a> {
    fn new(map: &'a Map, config: &'a PlannerConfig, goals: &'a [Anchor]) -> Self {
        let pull = |direction: usize| {
            let toward = std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64;
            std::array::from_fn(|step| {
                let angle = std::f64::consts::FRAC_PI_4 * step as f64 - toward;
                libm::exp(config.goal_weight * (libm::cos(angle) - 1.0)) as f32
            })
        };
        let pulls = (0..DIRECTIONS).map(pull).collect();
        let count = map.grid.len();
        let trails = vec![[TRAIL_FIRST as f32; 8]; count];
        Self { map, config, goals, trails, pulls, visited: vec![0; count], places: vec![0; count], steps: 0 }
    }

    fn tail(&self, node: usize) -> Option<f64> {
        self.goals.binary_search_by_key(&node, |anchor| anchor.0).ok().map(|i| self.goals[i].1)
    }

    /// The nodes from `start` to one where a way may end; `None` if the ant has seen all that it can reach.
    fn walk(&mut self, start: usize, goal: [f64; 2], ant: u32, random: &mut Stream) -> Option<Vec<usize>> {
        let columns = self.map.grid.columns as isize;
        let mut way = vec![start];
        self.visited[start] = ant;
        while let Some(&node) = way.last() {
            if self.tail(node).is_some() {
                return Some(way);
            }
            let [x, y] = self.map.grid.position(node);
            let toward = libm::atan2(goal[1] - y, goal[0] - x) / std::f64::consts::TAU * DIRECTIONS as f64;
            let pulls = &self.pulls[(toward.round() as isize).rem_euclid(DIRECTIONS as isize) as usize];
            let (mut weights, mut sum) = ([0.0f32; 8], 0.0f32);
            for (step, (right, up, _)) in STEPS.iter().enumerate() {
                let next = node.wrapping_add_signed(up * columns + right);
                if !self.map.blocked[next] && self.visited[next] != ant {
                    weights[step] = self.trails[node][step] * pulls[step];
                    sum += weights[step];
                }
            }
            if sum <= 0.0 {
                way.pop();
                continue;
            }
            let mut drawn = (random.unit() as f32) * sum;
            let likeliest = (0..8).fold(0, |best, step| if weights[step] > weights[best] { step } else { best });
            let chosen = (0..8).find(|step| {
                drawn -= weights[*step];
                drawn < 0.0 && weights[*step] > 0.0
            });
            let (right, up, _) = STEPS[chosen.unwrap_or(likeliest)];
            let next = node.wrapping_add_signed(up * columns + right);
            self.visited[next] = ant;
            self.steps += 1;
            way.push(next);
        }
        None
    }

    /// The way with every detour left out that comes back to a neighbour of where it began.
    fn without_loops(&mut self, way: &[usize]) -> Vec<usize> {
        let columns = self.map.grid.columns as isize;
        for (place, node) in way.iter().enumerate() {
            self.places[*node] = place as u32 + 1;
        }
        let mut place = 0;
        let mut nodes = vec![way[0]];
        while place + 1 < way.len() {
            let near = STEPS.map(|(right, up, _)| self.places[way[place].wrapping_add_signed(up * columns + right)]);
            place = near.into_iter().fold(place + 1, |last, found| last.max((found as usize).saturating_sub(1)));
            nodes.push(way[place]);
        }
        way.iter().for_each(|node| self.places[*node] = 0);
        nodes
    }

    /// Length (m) of a way with its tail.
    fn length(&self, nodes: &[usize]) -> f64 {
        let grid = &self.map.grid;
        let steps = nodes.windows(2).map(|pair| STEPS[self.step(pair[0], pair[1])].2 * grid.cell).sum::<f64>();
        steps + nodes.last().and_then(|node| self.tail(*node)).unwrap_or(f64::INFINITY)
    }

    /// Which of `STEPS` leads from a node to its neighbour.
    fn step(&self, from: usize, to: usize) -> usize {
        let columns = self.map.grid.columns as isize;
        let leads = |step: &usize| from.wrapping_add_signed(STEPS[*step].1 * columns + STEPS[*step].0) == to;
        (0..8).find(leads).unwrap_or(0)
    }

    /// Weakens all trails.
    fn fade(&mut self) {
        let kept = (1.0 - self.config.evaporation) as f32;
        for trail in self.trails.iter_mut().flatten() {
            *trail = (*trail * kept).max(TRAIL_MIN as f32);
        }
    }

    /// Strengthens the trails along a way, towards 1.
    fn mark(&mut self, nodes: &[usize]) {
        for pair in nodes.windows(2) {
            let step = self.step(pair[0], pair[1]);
            let trail = &mut self.trails[pair[0]][step];
            *trail += self.config.evaporation as f32 * (1.0 - *trail);
        }
    }
}
