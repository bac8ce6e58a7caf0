//! The actor (equation 8) and the critics (equation 7): a batch forward, and gradients back.
//!
//! A network here is sizes and memory for one batch; parameters are passed in, so that the same memory serves the
//! networks and their targets in turn. `backward` needs the `forward` before it.

use crate::batch::ACTIONS;
use crate::kernels::product::{Matrix, transpose};
use crate::kernels::{Isa, combined_relu, narrow, narrow_inputs, narrow_weights};
use crate::layer::Layer;
use crate::real::Real;

/// The actor.
#[derive(Debug)]
pub struct Actor<T> {
    hidden: Vec<Layer>,
    output: Layer,
    batch: usize,
    isa: Isa,
    /// y of each hidden layer (units, batch).
    values: Vec<Vec<T>>,
    /// dL/dy of each.
    uppers: Vec<Vec<T>>,
    /// Room for y^T (batch, units) of one.
    turned: Vec<T>,
    /// (2, batch) what goes into the output's tanh.
    pub outputs: Vec<T>,
}

impl<T: Real> Actor<T> {
    /// Memory for batches of `batch` through `layers`, at least two, of which the last is the output.
    pub fn new(layers: &[Layer], batch: usize, isa: Isa) -> Self {
        let (output, hidden) = (layers[layers.len() - 1], &layers[..layers.len() - 1]);
        let memory = || hidden.iter().map(|layer| vec![T::ZERO; layer.outputs * batch]).collect();
        let (outputs, turned) = (vec![T::ZERO; ACTIONS * batch], turned(hidden, batch));
        Self { hidden: hidden.to_vec(), output, batch, isa, values: memory(), uppers: memory(), turned, outputs }
    }

    /// Computes `outputs` for `observations` (inputs, batch).
    pub fn forward(&mut self, parameters: &[T], observations: &[T]) {
        for (i, layer) in self.hidden.iter().enumerate() {
            let (below, values) = self.values.split_at_mut(i);
            let inputs = below.last().map_or(observations, Vec::as_slice);
            layer.forward(self.isa, parameters, inputs, &mut values[0], self.batch);
        }
        let inputs = self.values.last().map_or(observations, Vec::as_slice);
        let (weight, bias) = (&parameters[self.output.weights()], &parameters[self.output.biases()]);
        narrow(self.isa, weight, Some(bias), inputs, &mut self.outputs, self.batch);
    }

    /// Sets all gradients from `upper` (2, batch), dL/d outputs; `observations` are (batch, inputs).
    pub fn backward(&mut self, parameters: &[T], observations: Matrix<'_, T>, upper: &[T], gradient: &mut [T]) {
        backward_output(self.isa, self.output, upper, &self.values[self.hidden.len() - 1], gradient, self.batch);
        if let Some(top) = self.uppers.last_mut() {
            narrow_inputs(self.isa, &parameters[self.output.weights()], upper, top, self.batch);
        }
        for (i, layer) in self.hidden.iter().enumerate().rev() {
            let (below, upper) = self.uppers.split_at_mut(i);
            layer.through_relu(self.isa, &mut upper[0], &self.values[i], gradient, self.batch);
            let inputs = if i == 0 { observations } else { turn(&self.values[i - 1], &mut self.turned, self.batch) };
            layer.weight_gradient(self.isa, &upper[0], inputs, gradient);
            if let Some(lower) = below.last_mut() {
                layer.input_gradient(self.isa, parameters, &upper[0], lower, self.batch);
            }
        }
    }
}

/// Room for the transposed values of any of some layers.
fn turned<T: Real>(layers: &[Layer], batch: usize) -> Vec<T> {
    vec![T::ZERO; layers.iter().map(|layer| layer.outputs * batch).max().unwrap_or_default()]
}

/// y^T (batch, units) of `values` y (units, batch), in `room`.
fn turn<'a, T: Real>(values: &[T], room: &'a mut [T], batch: usize) -> Matrix<'a, T> {
    let room = &mut room[..values.len()];
    transpose(values, batch, room);
    Matrix::by_rows(room, values.len() / batch)
}

/// Sets the gradients of an output layer from `upper` (outputs, batch).
fn backward_output<T: Real>(isa: Isa, layer: Layer, upper: &[T], inputs: &[T], gradient: &mut [T], batch: usize) {
    narrow_weights(isa, upper, inputs, &mut gradient[layer.weights()], batch);
    for (bias, row) in gradient[layer.biases()].iter_mut().zip(upper.chunks_exact(batch)) {
        *bias = row.iter().fold(T::ZERO, |sum, &u| sum + u);
    }
}

/// One critic or two, which lie one after the other in every parameter.
#[derive(Debug)]
pub struct Critics<T> {
    /// Layers of the first critic: the one that sees the observation, the combined one, further ones, the output.
    layers: Vec<Layer>,
    /// Place of W_a (2, units of the combined layer) of the first critic.
    action_weight: usize,
    frozen_combined: bool,
    batch: usize,
    isa: Isa,
    /// y of each hidden layer (critics, units, batch).
    values: Vec<Vec<T>>,
    /// dL/dy of each.
    uppers: Vec<Vec<T>>,
    /// Room for y^T (batch, units) of one layer of one critic.
    turned: Vec<T>,
    /// (critics, batch) Q(s, a).
    pub outputs: Vec<T>,
}

/// The part of `memory` (critics, units, batch) that belongs to one critic.
fn part<T>(memory: &[T], critic: usize, size: usize) -> &[T] {
    &memory[critic * size..][..size]
}

/// As `part`, to be written.
fn part_mut<T>(memory: &mut [T], critic: usize, size: usize) -> &mut [T] {
    &mut memory[critic * size..][..size]
}

impl<T: Real> Critics<T> {
    /// Memory for batches of `batch` through `count` critics of two hidden layers or more.
    pub fn new(
        layers: Vec<Layer>,
        action_weight: usize,
        frozen_combined: bool,
        count: usize,
        batch: usize,
        isa: Isa,
    ) -> Self {
        let hidden = &layers[..layers.len() - 1];
        let memory = || hidden.iter().map(|layer| vec![T::ZERO; count * layer.outputs * batch]).collect();
        let (values, uppers, turned) = (memory(), memory(), turned(hidden, batch));
        let outputs = vec![T::ZERO; count * batch];
        Self { layers, action_weight, frozen_combined, batch, isa, values, uppers, turned, outputs }
    }

    fn output(&self) -> Layer {
        self.layers[self.layers.len() - 1]
    }

    /// W_a of a critic.
    fn action_weights(&self, critic: usize) -> std::ops::Range<usize> {
        let size = ACTIONS * self.layers[1].outputs;
        self.action_weight + critic * size..self.action_weight + (critic + 1) * size
    }

    /// Computes the outputs of the first `count` critics for observations (inputs, batch) and actions (2, batch).
    pub fn forward(&mut self, parameters: &[T], observations: &[T], actions: &[T], count: usize) {
        let (isa, batch) = (self.isa, self.batch);
        let first = self.layers[0].of_critics(count);
        let values = &mut self.values[0][..first.outputs * batch];
        first.forward(isa, parameters, observations, values, batch);
        for critic in 0..count {
            let action_weights = self.action_weights(critic);
            for i in 1..self.layers.len() - 1 {
                let layer = self.layers[i].of_critic(critic);
                let (below, above) = self.values.split_at_mut(i);
                let inputs = part(&below[i - 1], critic, layer.inputs * batch);
                let values = part_mut(&mut above[0], critic, layer.outputs * batch);
                if i == 1 {
                    // Eq. 7: l_c = relu(l_s W_s + a W_a + b)
                    layer.product(isa, parameters, inputs, values, batch);
                    let weight = &parameters[action_weights.clone()];
                    combined_relu(isa, values, &parameters[layer.biases()], weight, actions, batch);
                } else {
                    layer.forward(isa, parameters, inputs, values, batch);
                }
            }
            let output = self.output().of_critic(critic);
            let inputs = part(&self.values[self.layers.len() - 2], critic, output.inputs * batch);
            let (weight, bias) = (&parameters[output.weights()], &parameters[output.biases()]);
            narrow(isa, weight, Some(bias), inputs, part_mut(&mut self.outputs, critic, batch), batch);
        }
    }

    /// Sets the gradients of all trained parameters of all critics from `upper` (critics, batch), dL/dQ; `observations`
    /// are (batch, inputs), `actions` (2, batch).
    pub fn backward(
        &mut self,
        parameters: &[T],
        observations: Matrix<'_, T>,
        actions: &[T],
        upper: &[T],
        gradient: &mut [T],
    ) {
        let (isa, batch, count) = (self.isa, self.batch, upper.len() / self.batch);
        for (critic, upper) in upper.chunks_exact(batch).enumerate() {
            let output = self.output().of_critic(critic);
            let inputs = part(&self.values[self.layers.len() - 2], critic, output.inputs * batch);
            backward_output(isa, output, upper, inputs, gradient, batch);
            for i in (1..self.layers.len() - 1).rev() {
                self.reach_layer(i, critic, parameters, upper, gradient);
                let layer = self.layers[i].of_critic(critic);
                let upper = part(&self.uppers[i], critic, layer.outputs * batch);
                if i > 1 || !self.frozen_combined {
                    let inputs = part(&self.values[i - 1], critic, layer.inputs * batch);
                    layer.weight_gradient(isa, upper, turn(inputs, &mut self.turned, batch), gradient);
                    if i == 1 {
                        narrow_weights(isa, actions, upper, &mut gradient[self.action_weights(critic)], batch);
                    }
                } else {
                    gradient[layer.biases()].fill(T::ZERO);
                }
            }
            let combined = self.layers[1].of_critic(critic);
            let (below, above) = self.uppers.split_at_mut(1);
            let upper = part(&above[0], critic, combined.outputs * batch);
            combined.input_gradient(
                isa,
                parameters,
                upper,
                part_mut(&mut below[0], critic, combined.inputs * batch),
                batch,
            );
        }
        let first = self.layers[0].of_critics(count);
        first.through_relu(isa, &mut self.uppers[0], &self.values[0], gradient, batch);
        first.weight_gradient(isa, &self.uppers[0], observations, gradient);
    }

    /// Sets dL/d(W x + b) of hidden layer `i` and the gradient of its b from the layer above, or the output's `upper`.
    fn reach_layer(&mut self, i: usize, critic: usize, parameters: &[T], upper: &[T], gradient: &mut [T]) {
        let (isa, batch) = (self.isa, self.batch);
        let (layer, above) = (self.layers[i].of_critic(critic), self.layers[i + 1].of_critic(critic));
        let (own, further) = self.uppers.split_at_mut(i + 1);
        let own = part_mut(&mut own[i], critic, layer.outputs * batch);
        match further.first() {
            Some(upper) => {
                above.input_gradient(isa, parameters, part(upper, critic, above.outputs * batch), own, batch)
            }
            None => narrow_inputs(isa, &parameters[above.weights()], upper, own, batch),
        }
        layer.through_relu(isa, own, part(&self.values[i], critic, layer.outputs * batch), gradient, batch);
    }

    /// dL/da (2, batch) from `upper` (batch), dL/dQ of the first critic. Of `gradient` some biases are overwritten.
    pub fn action_gradient(&mut self, parameters: &[T], upper: &[T], gradient: &mut [T], actions: &mut [T]) {
        for i in (1..self.layers.len() - 1).rev() {
            self.reach_layer(i, 0, parameters, upper, gradient);
        }
        let combined = part(&self.uppers[1], 0, self.layers[1].outputs * self.batch);
        narrow(self.isa, &parameters[self.action_weights(0)], None, combined, actions, self.batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUTS: usize = 5;
    const BATCH: usize = 3;
    const STEP: f64 = 1e-6;

    fn numbers(count: usize, seed: f64) -> Vec<f64> {
        (0..count).map(|i| (seed + 2.3 * i as f64).sin()).collect()
    }

    /// Layers one after the other for `count` critics, from place `first` on; and the place after them.
    fn layers(sizes: &[usize], count: usize, first: usize) -> (Vec<Layer>, usize) {
        let mut end = first;
        let mut place = |size: usize| {
            end += count * size;
            end - count * size
        };
        let layer = |pair: &[usize]| {
            let (inputs, outputs) = (pair[0], pair[1]);
            Layer { inputs, outputs, weight: place(inputs * outputs), bias: place(outputs) }
        };
        (sizes.windows(2).map(layer).collect(), end)
    }

    /// Compares a gradient with differences of the loss, entry by entry.
    fn compare(parameters: &[f64], gradient: &[f64], mut loss: impl FnMut(&[f64]) -> f64) {
        for place in 0..parameters.len() {
            let mut moved = parameters.to_vec();
            moved[place] += STEP;
            let above = loss(&moved);
            moved[place] -= 2.0 * STEP;
            let slope = (above - loss(&moved)) / (2.0 * STEP);
            assert!((slope - gradient[place]).abs() < 1e-7, "entry {place}: {slope} {}", gradient[place]);
        }
    }

    /// Observations (batch, inputs) from (inputs, batch).
    fn by_rows(observations: &[f64]) -> Vec<f64> {
        let mut rows = vec![0.0; observations.len()];
        transpose(observations, BATCH, &mut rows);
        rows
    }

    fn weighted(outputs: &[f64], upper: &[f64]) -> f64 {
        outputs.iter().zip(upper).map(|(y, u)| y * u).sum()
    }

    #[test]
    fn actor_gradients_are_slopes() {
        for sizes in [vec![INPUTS, 4, 2], vec![INPUTS, 7, 6, 2], vec![INPUTS, 4, 9, 3, 2]] {
            let (layers, size) = layers(&sizes, 1, 0);
            let (parameters, observations) = (numbers(size, 0.1), numbers(INPUTS * BATCH, 0.2));
            let upper = numbers(2 * BATCH, 0.3);
            let mut actor = Actor::new(&layers, BATCH, Isa::detect());
            let mut gradient = vec![f64::NAN; size];
            actor.forward(&parameters, &observations);
            let rows = by_rows(&observations);
            actor.backward(&parameters, Matrix::by_rows(&rows, INPUTS), &upper, &mut gradient);
            compare(&parameters, &gradient, |moved| {
                actor.forward(moved, &observations);
                weighted(&actor.outputs, &upper)
            });
        }
    }

    #[test]
    fn critic_gradients_are_slopes() {
        for sizes in [vec![INPUTS, 6, 4, 1], vec![INPUTS, 4, 7, 5, 1], vec![INPUTS, 3, 4, 5, 6, 1]] {
            for count in [1, 2] {
                let action_size = count * ACTIONS * sizes[2];
                let (layers, size) = layers(&sizes, count, action_size);
                let (parameters, observations) = (numbers(size, 0.4), numbers(INPUTS * BATCH, 0.5));
                let (actions, upper) = (numbers(ACTIONS * BATCH, 0.6), numbers(count * BATCH, 0.7));
                let mut critics = Critics::new(layers, 0, false, count, BATCH, Isa::detect());
                let mut gradient = vec![f64::NAN; size];
                critics.forward(&parameters, &observations, &actions, count);
                let rows = by_rows(&observations);
                critics.backward(&parameters, Matrix::by_rows(&rows, INPUTS), &actions, &upper, &mut gradient);
                compare(&parameters, &gradient, |moved| {
                    critics.forward(moved, &observations, &actions, count);
                    weighted(&critics.outputs, &upper)
                });
                critics.forward(&parameters, &observations, &actions, 1);
                let mut slopes = vec![0.0; ACTIONS * BATCH];
                critics.action_gradient(&parameters, &upper[..BATCH], &mut gradient, &mut slopes);
                compare(&actions, &slopes, |moved| {
                    critics.forward(&parameters, &observations, moved, 1);
                    weighted(&critics.outputs[..BATCH], &upper[..BATCH])
                });
            }
        }
    }

    #[test]
    fn a_frozen_combined_layer_has_no_gradient() {
        let (layers, size) = layers(&[INPUTS, 4, 6, 1], 2, 2 * ACTIONS * 6);
        let mut critics = Critics::new(layers.clone(), 0, true, 2, BATCH, Isa::detect());
        let (observations, actions, parameters) =
            (numbers(INPUTS * BATCH, 0.5), numbers(ACTIONS * BATCH, 0.6), numbers(size, 0.4));
        let mut gradient = vec![0.0; size];
        critics.forward(&parameters, &observations, &actions, 2);
        let rows = by_rows(&observations);
        let upper = numbers(2 * BATCH, 0.7);
        critics.backward(&parameters, Matrix::by_rows(&rows, INPUTS), &actions, &upper, &mut gradient);
        let combined = layers[1].of_critics(2);
        let frozen = [0..2 * ACTIONS * 6, combined.weights(), combined.biases()];
        assert!(frozen.into_iter().all(|range| gradient[range].iter().all(|&g| g == 0.0)));
        assert!(gradient[layers[0].of_critics(2).weights()].iter().any(|&g| g != 0.0));
    }
}
