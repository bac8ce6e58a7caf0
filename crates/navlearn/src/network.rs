//! The actor (equation 8) and the critics (equation 7): a batch forward, and gradients back.
//!
//! A network here is sizes and memory for one batch; parameters are passed in, so that the same memory serves the
//! networks and their targets in turn. `backward` needs the `forward` before it.

use crate::batch::ACTIONS;
use crate::kernels::matrix::{Matrix, transpose};
use crate::kernels::{Isa, combined_relu, narrow, narrow_inputs, narrow_weights};
use crate::layer::Layer;
use crate::packed::Packed;
use crate::real::Real;

/// Working memory of one batch in hidden layers.
#[derive(Debug)]
struct Memory<T> {
    /// Rows of the batch, and how many of them are summed first in the gradients of weights and biases.
    sizes: [usize; 2],
    isa: Isa,
    /// y of each hidden layer (critics, units, batch).
    values: Vec<Vec<T>>,
    /// dL/dy of each.
    uppers: Vec<Vec<T>>,
    /// Room for y^T (batch, units) of one layer of one network.
    turned: Vec<T>,
}

impl<T: Real> Memory<T> {
    /// For `count` networks with layers of such sizes.
    fn new(hidden: &[Layer], count: usize, sizes: [usize; 2], isa: Isa) -> Self {
        let sized = |layer: &Layer| vec![T::ZERO; count * layer.outputs * sizes[0]];
        let memory = || hidden.iter().map(sized).collect();
        let largest = hidden.iter().map(|layer| layer.outputs).max().unwrap_or_default();
        Self { sizes, isa, values: memory(), uppers: memory(), turned: vec![T::ZERO; largest * sizes[0]] }
    }
}

/// The actor.
#[derive(Debug)]
pub struct Actor<T> {
    hidden: Vec<Layer>,
    output: Layer,
    memory: Memory<T>,
    /// (2, batch) what goes into the output's tanh.
    pub outputs: Vec<T>,
}

impl<T: Real> Actor<T> {
    /// Memory for batches through `layers`, at least two, of which the last is the output. `sizes` are the rows of the
    /// batch, and those of them that gradients sum first.
    pub fn new(layers: &[Layer], sizes: [usize; 2], isa: Isa) -> Self {
        let (output, hidden) = (layers[layers.len() - 1], &layers[..layers.len() - 1]);
        let (memory, outputs) = (Memory::new(hidden, 1, sizes, isa), vec![T::ZERO; ACTIONS * sizes[0]]);
        Self { hidden: hidden.to_vec(), output, memory, outputs }
    }

    /// Computes `outputs` for `observations` (inputs, batch).
    pub fn forward(&mut self, parameters: Packed<'_, T>, observations: &[T]) {
        let Memory { sizes: [batch, _], isa, ref mut values, .. } = self.memory;
        for (i, layer) in self.hidden.iter().enumerate() {
            let (below, values) = values.split_at_mut(i);
            let inputs = below.last().map_or(observations, Vec::as_slice);
            layer.forward(isa, parameters, inputs, &mut values[0], batch);
        }
        let inputs = values.last().map_or(observations, Vec::as_slice);
        let (weight, bias) = (parameters.at(self.output.weights()), parameters.at(self.output.biases()));
        narrow(isa, weight, Some(bias), inputs, &mut self.outputs, batch);
    }

    /// Sets all gradients from `upper` (2, batch), dL/d outputs; `observations` are (batch, inputs).
    pub fn backward(
        &mut self,
        parameters: Packed<'_, T>,
        observations: Matrix<'_, T>,
        upper: &[T],
        gradient: &mut [T],
    ) {
        let Memory { sizes, isa, ref values, ref mut uppers, ref mut turned } = self.memory;
        let [batch, cut] = sizes;
        backward_output(isa, self.output, upper, &values[self.hidden.len() - 1], gradient, sizes);
        if let Some(top) = uppers.last_mut() {
            narrow_inputs(isa, parameters.at(self.output.weights()), upper, top, batch);
        }
        for (i, layer) in self.hidden.iter().enumerate().rev() {
            let (below, upper) = uppers.split_at_mut(i);
            layer.through_relu(isa, &mut upper[0], &values[i], gradient, sizes);
            let inputs = if i == 0 { observations } else { turn(&values[i - 1], turned, batch) };
            layer.weight_gradient(isa, &upper[0], inputs, gradient, cut);
            if let Some(lower) = below.last_mut() {
                layer.input_gradient(isa, parameters, &upper[0], lower, batch);
            }
        }
    }
}

/// y^T (batch, units) of `values` y (units, batch), in `room`.
fn turn<'a, T: Real>(values: &[T], room: &'a mut [T], batch: usize) -> Matrix<'a, T> {
    let room = &mut room[..values.len()];
    transpose(values, batch, room);
    Matrix::by_rows(room, values.len() / batch)
}

/// Sets the gradients of an output layer from `upper` (outputs, batch).
fn backward_output<T: Real>(
    isa: Isa,
    layer: Layer,
    upper: &[T],
    inputs: &[T],
    gradient: &mut [T],
    [batch, cut]: [usize; 2],
) {
    narrow_weights(isa, upper, inputs, &mut gradient[layer.weights()], batch, cut);
    let sum = |numbers: &[T]| numbers.iter().fold(T::ZERO, |sum, &u| sum + u);
    for (bias, row) in gradient[layer.biases()].iter_mut().zip(upper.chunks_exact(batch)) {
        *bias = sum(&row[..cut]) + sum(&row[cut..]);
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
    memory: Memory<T>,
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
    /// Memory for batches through `count` critics of two hidden layers or more; `sizes` as in [`Actor::new`].
    pub fn new(
        layers: Vec<Layer>,
        action_weight: usize,
        frozen_combined: bool,
        count: usize,
        sizes: [usize; 2],
        isa: Isa,
    ) -> Self {
        let memory = Memory::new(&layers[..layers.len() - 1], count, sizes, isa);
        let outputs = vec![T::ZERO; count * sizes[0]];
        Self { layers, action_weight, frozen_combined, memory, outputs }
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
    pub fn forward(&mut self, parameters: Packed<'_, T>, observations: &[T], actions: &[T], count: usize) {
        let (isa, [batch, _]) = (self.memory.isa, self.memory.sizes);
        let first = self.layers[0].of_critics(count);
        first.forward(isa, parameters, observations, &mut self.memory.values[0][..first.outputs * batch], batch);
        for critic in 0..count {
            let action_weights = self.action_weights(critic);
            for i in 1..self.layers.len() - 1 {
                let layer = self.layers[i].of_critic(critic);
                let (below, above) = self.memory.values.split_at_mut(i);
                let inputs = part(&below[i - 1], critic, layer.inputs * batch);
                let values = part_mut(&mut above[0], critic, layer.outputs * batch);
                if i == 1 {
                    // Eq. 7: l_c = relu(l_s W_s + a W_a + b)
                    layer.product(isa, parameters, inputs, values, batch);
                    let (weight, bias) = (parameters.at(action_weights.clone()), parameters.at(layer.biases()));
                    combined_relu(isa, values, bias, weight, actions, batch);
                } else {
                    layer.forward(isa, parameters, inputs, values, batch);
                }
            }
            let output = self.output().of_critic(critic);
            let inputs = part(&self.memory.values[self.layers.len() - 2], critic, output.inputs * batch);
            let (weight, bias) = (parameters.at(output.weights()), parameters.at(output.biases()));
            narrow(isa, weight, Some(bias), inputs, part_mut(&mut self.outputs, critic, batch), batch);
        }
    }

    /// Sets the gradients of all trained parameters of all critics from `upper` (critics, batch), dL/dQ; `observations`
    /// are (batch, inputs), `actions` (2, batch).
    pub fn backward(
        &mut self,
        parameters: Packed<'_, T>,
        observations: Matrix<'_, T>,
        actions: &[T],
        upper: &[T],
        gradient: &mut [T],
    ) {
        let Memory { isa, sizes, .. } = self.memory;
        let [batch, cut] = sizes;
        for (critic, upper) in upper.chunks_exact(batch).enumerate() {
            let output = self.output().of_critic(critic);
            let inputs = part(&self.memory.values[self.layers.len() - 2], critic, output.inputs * batch);
            backward_output(isa, output, upper, inputs, gradient, sizes);
            for i in (1..self.layers.len() - 1).rev() {
                self.reach_layer(i, critic, parameters, upper, gradient);
                let layer = self.layers[i].of_critic(critic);
                let action_weights = self.action_weights(critic);
                let Memory { values, uppers, turned, .. } = &mut self.memory;
                let upper = part(&uppers[i], critic, layer.outputs * batch);
                if i > 1 || !self.frozen_combined {
                    let inputs = turn(part(&values[i - 1], critic, layer.inputs * batch), turned, batch);
                    layer.weight_gradient(isa, upper, inputs, gradient, cut);
                    if i == 1 {
                        narrow_weights(isa, actions, upper, &mut gradient[action_weights], batch, cut);
                    }
                } else {
                    gradient[layer.biases()].fill(T::ZERO);
                }
            }
            let combined = self.layers[1].of_critic(critic);
            let (below, above) = self.memory.uppers.split_at_mut(1);
            let upper = part(&above[0], critic, combined.outputs * batch);
            let lower = part_mut(&mut below[0], critic, combined.inputs * batch);
            combined.input_gradient(isa, parameters, upper, lower, batch);
        }
        let first = self.layers[0].of_critics(upper.len() / batch);
        let Memory { values, uppers, .. } = &mut self.memory;
        first.through_relu(isa, &mut uppers[0], &values[0], gradient, sizes);
        first.weight_gradient(isa, &uppers[0], observations, gradient, cut);
    }

    /// Sets dL/d(W x + b) of hidden layer `i` and the gradient of its b from the layer above, or the output's `upper`.
    fn reach_layer(&mut self, i: usize, critic: usize, parameters: Packed<'_, T>, upper: &[T], gradient: &mut [T]) {
        let Memory { isa, sizes, ref values, ref mut uppers, .. } = self.memory;
        let batch = sizes[0];
        let (layer, above) = (self.layers[i].of_critic(critic), self.layers[i + 1].of_critic(critic));
        let (own, further) = uppers.split_at_mut(i + 1);
        let own = part_mut(&mut own[i], critic, layer.outputs * batch);
        match further.first() {
            Some(upper) => {
                above.input_gradient(isa, parameters, part(upper, critic, above.outputs * batch), own, batch)
            }
            None => narrow_inputs(isa, parameters.at(above.weights()), upper, own, batch),
        }
        layer.through_relu(isa, own, part(&values[i], critic, layer.outputs * batch), gradient, sizes);
    }

    /// dL/da (2, batch) from `upper` (batch), dL/dQ of the first critic. Of `gradient` some biases are overwritten.
    pub fn action_gradient(&mut self, parameters: Packed<'_, T>, upper: &[T], gradient: &mut [T], actions: &mut [T]) {
        for i in (1..self.layers.len() - 1).rev() {
            self.reach_layer(i, 0, parameters, upper, gradient);
        }
        let Memory { isa, sizes: [batch, _], ref uppers, .. } = self.memory;
        let combined = part(&uppers[1], 0, self.layers[1].outputs * batch);
        narrow(isa, parameters.at(self.action_weights(0)), None, combined, actions, batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUTS: usize = 5;
    const BATCH: usize = 3;
    const CUT: usize = 2;
    const STEP: f64 = 1e-6;

    fn numbers(count: usize, seed: f64) -> Vec<f64> {
        (0..count).map(|i| (seed + 2.3 * i as f64).sin()).collect()
    }

    fn whole(numbers: &[f64]) -> Packed<'_, f64> {
        Packed::new([numbers, &[]])
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
            let mut actor = Actor::new(&layers, [BATCH, CUT], Isa::detect());
            let mut gradient = vec![f64::NAN; size];
            actor.forward(whole(&parameters), &observations);
            let rows = by_rows(&observations);
            actor.backward(whole(&parameters), Matrix::by_rows(&rows, INPUTS), &upper, &mut gradient);
            compare(&parameters, &gradient, |moved| {
                actor.forward(whole(moved), &observations);
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
                let mut critics = Critics::new(layers, 0, false, count, [BATCH, CUT], Isa::detect());
                let mut gradient = vec![f64::NAN; size];
                critics.forward(whole(&parameters), &observations, &actions, count);
                let rows = by_rows(&observations);
                critics.backward(whole(&parameters), Matrix::by_rows(&rows, INPUTS), &actions, &upper, &mut gradient);
                compare(&parameters, &gradient, |moved| {
                    critics.forward(whole(moved), &observations, &actions, count);
                    weighted(&critics.outputs, &upper)
                });
                critics.forward(whole(&parameters), &observations, &actions, 1);
                let mut slopes = vec![0.0; ACTIONS * BATCH];
                critics.action_gradient(whole(&parameters), &upper[..BATCH], &mut gradient, &mut slopes);
                compare(&actions, &slopes, |moved| {
                    critics.forward(whole(&parameters), &observations, moved, 1);
                    weighted(&critics.outputs[..BATCH], &upper[..BATCH])
                });
            }
        }
    }

    #[test]
    fn a_frozen_combined_layer_has_no_gradient() {
        let (layers, size) = layers(&[INPUTS, 4, 6, 1], 2, 2 * ACTIONS * 6);
        let mut critics = Critics::new(layers.clone(), 0, true, 2, [BATCH, CUT], Isa::detect());
        let (observations, actions, parameters) =
            (numbers(INPUTS * BATCH, 0.5), numbers(ACTIONS * BATCH, 0.6), numbers(size, 0.4));
        let mut gradient = vec![0.0; size];
        critics.forward(whole(&parameters), &observations, &actions, 2);
        let rows = by_rows(&observations);
        let upper = numbers(2 * BATCH, 0.7);
        critics.backward(whole(&parameters), Matrix::by_rows(&rows, INPUTS), &actions, &upper, &mut gradient);
        let combined = layers[1].of_critics(2);
        let frozen = [0..2 * ACTIONS * 6, combined.weights(), combined.biases()];
        assert!(frozen.into_iter().all(|range| gradient[range].iter().all(|&g| g == 0.0)));
        assert!(gradient[layers[0].of_critics(2).weights()].iter().any(|&g| g != 0.0));
    }
}
