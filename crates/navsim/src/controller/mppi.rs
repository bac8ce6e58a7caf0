//! Model predictive path integral control (Williams et al., "Information theoretic MPC for model-based reinforcement
//! learning", 2017): many noisy copies of the plan are driven in thought, and their mean, weighted by exp(-cost /
//! temperature), is the new plan.

use super::clearance_map::ClearanceMap;
use super::scene::Scene;
use super::settings::MppiConfig;
use super::{Limits, Sight};
use crate::cpu::{Dispatch, Isa, Kernel};
use crate::error::Result;
use crate::lidar::{draw_normals, sin_turn};
use crate::rng::StreamName;
use std::f32::consts::PI;

/// Samples that are driven side by side.
const LANES: usize = 16;
/// Random blocks of one call of `draw_normals`, which gives noise to all lanes twice.
const DRAW: usize = 4 * LANES;

/// How much nearer (m) than now a robot within the margin may come: the map's interpolation is no better.
const TOLERANCE: f32 = 0.001;

/// Commands (v m/s, omega rad/s) of the coming steps: what a robot remembers from its last decision.
pub(super) type Plan = Vec<[f32; 2]>;

/// The controller, with the memory that it works in.
#[derive(Debug, Clone)]
pub(super) struct Mppi {
    config: MppiConfig,
    dispatch: Dispatch,
    map: ClearanceMap,
    /// Commands of each group of samples before any limit: for each step the forward speeds, then the turning speeds.
    /// (The mean of commands that were cut off at 0 would never be 0.)
    commands: Vec<[[f32; LANES]; 2]>,
    costs: Vec<f32>,
}

/// One step of thought: what costs and limits need.
#[derive(Debug, Clone, Copy)]
struct Step {
    time: f32,
    goal: [f32; 2],
    goal_cost: f32,
    obstacle_cost: f32,
    collision_cost: f32,
    inflation: f32,
    radius: f32,
    /// Clearance beyond the margin at which a sample touches: 0, or less where the robot already is within the margin.
    contact: f32,
    /// Largest change of v and omega in a step.
    change: [f32; 2],
    /// 1 / `change`: 0 where nothing limits it.
    inverse: [f32; 2],
}

/// States of `LANES` samples.
#[derive(Debug, Clone, Copy)]
struct Lane {
    x: [f32; LANES],
    y: [f32; LANES],
    /// Heading as a share of a full turn, in [-1/2, 1/2].
    turn: [f32; LANES],
    v: [f32; LANES],
    omega: [f32; LANES],
    /// Means of v and omega over the step.
    v_mean: [f32; LANES],
    omega_mean: [f32; LANES],
    /// 1 until the sample touches something, then 0: it drives no farther.
    free: [f32; LANES],
    cost: [f32; LANES],
}

impl Mppi {
    /// The controller for a robot, on the instruction set of `Isa::current`.
    ///
    /// # Errors
    /// Those of `Isa::current`.
    pub fn new(config: &MppiConfig, limits: &Limits) -> Result<Self> {
        let groups = config.samples.div_ceil(LANES);
        let half = limits.v_max * (config.steps as f64 * config.step) as f32;
        let reach = limits.radius + (config.margin + config.inflation) as f32;
        Ok(Self {
            config: config.clone(),
            dispatch: Dispatch::new(Isa::current()?),
            map: ClearanceMap::new(half, 0.2 * limits.radius, reach),
            commands: vec![[[0.0; LANES]; 2]; groups * config.steps],
            costs: vec![0.0; groups * LANES],
        })
    }

    /// The first command of the new plan; `plan` is then the rest of it. An empty plan is one of standing still.
    pub fn command(&mut self, limits: &Limits, sight: &Sight, plan: &mut Plan, stream: &StreamName) -> [f32; 2] {
        plan.resize(self.config.steps, [0.0; 2]);
        self.dispatch.run(Look { map: &mut self.map, scene: sight.scene });
        let step = self.step(limits, sight);
        let Self { config, map, commands, costs, .. } = self;
        self.dispatch.run(Thought { config, limits, sight, step, map, plan, stream, commands, costs });
        self.average(limits, plan);
        let period = limits.period / self.config.step as f32;
        let first = mean_of_first(plan, period);
        shift(plan, period);
        first
    }

    fn step(&self, limits: &Limits, sight: &Sight) -> Step {
        let MppiConfig { step, goal, obstacle, inflation, margin, collision, .. } = self.config;
        let time = step as f32;
        let change = |acceleration: f32| if acceleration > 0.0 { acceleration * time } else { f32::INFINITY };
        let change = [change(limits.acceleration), change(limits.angular_acceleration)];
        let radius = limits.radius + margin as f32;
        Step {
            time,
            goal: sight.goal,
            goal_cost: goal as f32 * time,
            obstacle_cost: obstacle as f32 * time,
            collision_cost: collision as f32 * time,
            inflation: inflation as f32,
            radius,
            contact: (self.map.at(&[0.0], &[0.0])[0] - radius - TOLERANCE).min(0.0),
            change,
            inverse: change.map(|change| 1.0 / change),
        }
    }

    /// Eq. (Williams): u[t] = sum of w_k u_k[t] / sum of w_k, w_k = exp(-(S_k - min S) / temperature)
    ///
    /// The plan stays within one standard deviation of the limits, so that it comes back at once.
    fn average(&mut self, limits: &Limits, plan: &mut Plan) {
        let samples = self.config.samples;
        let least = self.costs[..samples].iter().fold(f32::INFINITY, |least, &cost| least.min(cost));
        let temperature = self.config.temperature as f32;
        for (k, cost) in self.costs.iter_mut().enumerate() {
            *cost = if k < samples { libm::expf(-(*cost - least) / temperature) } else { 0.0 };
        }
        let total: f32 = self.costs.iter().sum();
        let steps = self.config.steps;
        let mut sums = vec![[[0.0f32; LANES]; 2]; steps];
        for (commands, weights) in self.commands.chunks_exact(steps).zip(self.costs.chunks_exact(LANES)) {
            for (sum, command) in sums.iter_mut().zip(commands) {
                for part in 0..2 {
                    for i in 0..LANES {
                        sum[part][i] += weights[i] * command[part][i];
                    }
                }
            }
        }
        for (command, sum) in plan.iter_mut().zip(&sums) {
            let [v, omega] = sum.map(|part| part.iter().sum::<f32>() / total);
            let (v_slack, omega_most) = (self.config.v_noise as f32, limits.omega_max + self.config.omega_noise as f32);
            *command = [between(v, -v_slack, limits.v_max + v_slack), between(omega, -omega_most, omega_most)];
        }
    }
}

/// What the beams met, entered into the map.
struct Look<'a> {
    map: &'a mut ClearanceMap,
    scene: &'a Scene,
}

impl Kernel for Look<'_> {
    #[inline(always)]
    fn run(self) {
        self.map.fill(self.scene);
    }
}

/// Samples that are driven in thought.
struct Thought<'a> {
    config: &'a MppiConfig,
    limits: &'a Limits,
    sight: &'a Sight<'a>,
    step: Step,
    map: &'a ClearanceMap,
    plan: &'a Plan,
    stream: &'a StreamName,
    /// As of `Mppi`: to be filled.
    commands: &'a mut [[[f32; LANES]; 2]],
    costs: &'a mut [f32],
}

impl Kernel for Thought<'_> {
    #[inline(always)]
    fn run(mut self) {
        for group in 0..self.costs.len() / LANES {
            self.drive(group);
        }
    }
}

impl Thought<'_> {
    /// Drives the samples of a group along the plan with noise of their own. The first sample has none.
    #[inline(always)]
    fn drive(&mut self, group: usize) {
        let Self { limits, step, .. } = *self;
        let MppiConfig { steps, hold, .. } = *self.config;
        let sigma = [self.config.v_noise as f32, self.config.omega_noise as f32];
        let commands = &mut self.commands[group * steps..(group + 1) * steps];
        let mut normals = [0.0; DRAW];
        let mut lane = Lane::at_rest(self.sight.velocity);
        for (t, (command, &[v, omega])) in commands.iter_mut().zip(self.plan).enumerate() {
            // Every draw of noise lasts for `hold` steps.
            let held = t / hold;
            if t % (2 * hold) == 0 {
                let draw = group * steps.div_ceil(2 * hold) + held / 2;
                draw_normals(self.stream, (draw * LANES) as u32, &mut normals);
            }
            let (noise_v, noise_omega) = normals[held % 2 * 2 * LANES..][..2 * LANES].split_at(LANES);
            for i in 0..LANES {
                let quiet = group == 0 && i == 0;
                let scale = if quiet { 0.0 } else { 1.0 };
                command[0][i] = v + sigma[0] * scale * noise_v[i];
                command[1][i] = omega + sigma[1] * scale * noise_omega[i];
                let (v, omega) = (command[0][i], command[1][i]);
                let v = between(near(v, lane.v[i], step.change[0]), 0.0, limits.v_max);
                let omega = near(omega, lane.omega[i], step.change[1]);
                let omega = between(omega, -limits.omega_max, limits.omega_max);
                (lane.v_mean[i], lane.v[i]) = (mean_speed(lane.v[i], v, step.inverse[0]), v);
                (lane.omega_mean[i], lane.omega[i]) = (mean_speed(lane.omega[i], omega, step.inverse[1]), omega);
            }
            lane.advance(&step);
            lane.charge(&step, self.map);
        }
        self.costs[group * LANES..(group + 1) * LANES].copy_from_slice(&lane.cost);
    }
}

impl Lane {
    #[inline(always)]
    fn at_rest([v, omega]: [f32; 2]) -> Self {
        let zero = [0.0; LANES];
        let (v, omega, free) = ([v; LANES], [omega; LANES], [1.0; LANES]);
        Self { x: zero, y: zero, turn: zero, v, omega, v_mean: v, omega_mean: omega, free, cost: zero }
    }

    /// Drives for one step along the heading in its middle.
    #[inline(always)]
    fn advance(&mut self, step: &Step) {
        for i in 0..LANES {
            let turned = self.omega_mean[i] * step.time * (0.5 / PI);
            let middle = part_of_turn(self.turn[i] + 0.5 * turned);
            let way = self.free[i] * self.v_mean[i] * step.time;
            self.x[i] += way * sin_turn(part_of_turn(middle + 0.25));
            self.y[i] += way * sin_turn(middle);
            self.turn[i] = part_of_turn(self.turn[i] + turned);
        }
    }

    /// Adds what it costs to be there.
    #[inline(always)]
    fn charge(&mut self, step: &Step, map: &ClearanceMap) {
        for (i, away) in map.at(&self.x, &self.y).into_iter().enumerate() {
            let clearance = away - step.radius;
            let (dx, dy) = (step.goal[0] - self.x[i], step.goal[1] - self.y[i]);
            let distance = (dx * dx + dy * dy).sqrt();
            let near = 1.0 - clearance / step.inflation;
            let near = if near > 0.0 { near } else { 0.0 };
            self.free[i] = if clearance < step.contact { 0.0 } else { self.free[i] };
            let contact = (1.0 - self.free[i]) * step.collision_cost;
            self.cost[i] += step.goal_cost * distance + step.obstacle_cost * near * near + contact;
        }
    }
}

#[inline(always)]
fn between(value: f32, low: f32, high: f32) -> f32 {
    let value = if value > low { value } else { low };
    if value < high { value } else { high }
}

#[inline(always)]
fn near(value: f32, now: f32, change: f32) -> f32 {
    between(value, now - change, now + change)
}

/// Mean over a step in which a speed goes from `before` to `after` as fast as the limit allows, and stays: the change d
/// takes |d| / limit of the step, during which half of it is missing.
#[inline(always)]
fn mean_speed(before: f32, after: f32, inverse_limit: f32) -> f32 {
    let change = after - before;
    after - 0.5 * change * change.abs() * inverse_limit
}

/// A number of turns less its nearest whole number, in [-1/2, 1/2].
#[inline(always)]
fn part_of_turn(turns: f32) -> f32 {
    // Beyond 2^23 there are only whole numbers: adding and taking away 1.5 x 2^23 rounds.
    const ROUND: f32 = 12_582_912.0;
    turns - ((turns + ROUND) - ROUND)
}

/// Mean command of the first `steps` (>= 0, a fraction counts) of a plan; its first if that is none.
fn mean_of_first(plan: &Plan, steps: f32) -> [f32; 2] {
    let (mut sum, mut left) = ([0.0; 2], steps);
    for command in plan {
        let share = left.clamp(0.0, 1.0);
        sum = [sum[0] + share * command[0], sum[1] + share * command[1]];
        left -= share;
    }
    let counted = steps - left;
    if counted > 0.0 { sum.map(|part| part / counted) } else { plan[0] }
}

/// Moves a plan on by `steps` (a fraction interpolates); its last command stays.
fn shift(plan: &mut Plan, steps: f32) {
    let last = plan.len() - 1;
    for t in 0..plan.len() {
        let place = (t as f32 + steps).min(last as f32);
        let (before, share) = (place as usize, place - libm::floorf(place));
        let (a, b) = (plan[before], plan[(before + 1).min(last)]);
        plan[t] = [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plans_move_on_by_whole_and_broken_steps() {
        let plan: Plan = (0..5).map(|t| [t as f32, -(t as f32)]).collect();
        let mut moved = plan.clone();
        shift(&mut moved, 2.0);
        assert_eq!(moved, [[2.0, -2.0], [3.0, -3.0], [4.0, -4.0], [4.0, -4.0], [4.0, -4.0]]);
        let mut moved = plan.clone();
        shift(&mut moved, 0.5);
        assert_eq!(moved[..2], [[0.5, -0.5], [1.5, -1.5]]);
        assert_eq!(mean_of_first(&plan, 2.0), [0.5, -0.5]);
        assert_eq!(mean_of_first(&plan, 1.5), [0.5 / 1.5, -0.5 / 1.5]);
    }

    /// From 0.5 m/s by 0.2 m/s a step: to 0.3 m/s the mean is 0.4; to 0.4 m/s half of the step is driven at 0.4, half at
    /// 0.45 in the mean; without a limit all of it as fast as it ends.
    #[test]
    fn speeds_change_as_fast_as_they_may() {
        for (after, inverse, mean) in [(0.3, 5.0, 0.4), (0.4, 5.0, 0.425), (0.5, 5.0, 0.5), (0.1, 0.0, 0.1)] {
            assert!((mean_speed(0.5, after, inverse) - mean).abs() < 1e-6, "{after}");
        }
    }

    #[test]
    fn turns_are_brought_to_half_a_turn() {
        for (turns, part) in [(0.25, 0.25), (0.75, -0.25), (-1.25, -0.25), (7.0, 0.0)] {
            assert!((part_of_turn(turns) - part).abs() < 1e-6);
        }
    }
}
