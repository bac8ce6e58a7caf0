//! The actor (equation 8) and a critic (equation 7): a batch forward, and gradients back.
//!
//! A network here is sizes and memory for one batch; parameters are passed in, so that the same memory serves the
//! networks and their targets in turn. `backward` needs the `forward` before it.

use crate::aligned::Aligned;
use crate::batch::ACTIONS;
use crate::kernels::matrix::{Matrix, transpose};
use crate::kernels::{Isa, combined_relu, narrow, narrow_inputs, narrow_weights};
use crate::layer::Layer;
use crate::packed::Packed;
use crate::real::Real;
use std::ops::Range;

/// Working memory of one batch in hidden layers.
#[derive(Debug, Clone)]
struct Memory<T> {
    /// Rows of the batch, and how many of them are summed first in the gradients of weights and biases.
    sizes: [usize; 2],
    isa: Isa,
    /// y of each hidden layer (units, batch).
    values: Vec<Aligned<T>>,
    /// dL/dy of each.
    uppers: Vec<Aligned<T>>,
    /// Room for y^T (batch, units) of one layer.
    turned: Aligned<T>,
}

impl<T: Real> Memory<T> {
    /// For layers of such sizes.
    fn new(hidden: &[Layer], sizes: [usize; 2], isa: Isa) -> Self {
        let sized = |layer: &Layer| Aligned::zeros(layer.outputs * sizes[0]);
        let memory = || hidden.iter().map(sized).collect();
        let largest = hidden.iter().map(|layer| layer.outputs).max().unwrap_or_default();
        Self { sizes, isa, values: memory(), uppers: memory(), turned: Aligned::zeros(largest * sizes[0]) }
    }
}

/// The actor.
#[derive(Debug, Clone)]
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
        let (memory, outputs) = (Memory::new(hidden, sizes, isa), vec![T::ZERO; ACTIONS * sizes[0]]);
        Self { hidden: hidden.to_vec(), output, memory, outputs }
    }

    /// Computes `outputs` for `observations` (inputs, batch).
    pub fn forward(&mut self, parameters: Packed<'_, T>, observations: &[T]) {
        let Memory { sizes: [batch, _], isa, ref mut values, .. } = self.memory;
        for (i, layer) in self.hidden.iter().enumerate() {
            let (below, values) = values.split_at_mut(i);
            let inputs = below.last().map_or(observations, |values| values);
            layer.forward(isa, parameters, inputs, &mut values[0], batch);
        }
        let inputs = values.last().map_or(observations, |values| values);
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

/// One critic.
#[derive(Debug)]
pub struct Critic<T> {
    /// The layer that sees the observation, the combined one, further ones, the output.
    layers: Vec<Layer>,
    /// Place of W_a (2, units of the combined layer).
    action_weights: Range<usize>,
    frozen_combined: bool,
    memory: Memory<T>,
    /// (batch) Q(s, a).
    pub outputs: Vec<T>,
}

impl<T: Real> Critic<T> {
    /// Memory for batches through a critic of two hidden layers or more; `sizes` as in [`Actor::new`].
    pub fn new(
        layers: Vec<Layer>,
        action_weights: Range<usize>,
        frozen_combined: bool,
        sizes: [usize; 2],
        isa: Isa,
    ) -> Self {
        let memory = Memory::new(&layers[..layers.len() - 1], sizes, isa);
        Self { layers, action_weights, frozen_combined, memory, outputs: vec![T::ZERO; sizes[0]] }
    }

    fn hidden(&self) -> usize {
        self.layers.len() - 1
    }

    /// Computes `outputs` for observations (inputs, batch) and actions (2, batch).
    pub fn forward(&mut self, parameters: Packed<'_, T>, observations: &[T], actions: &[T]) {
        let Memory { sizes: [batch, _], isa, ref mut values, .. } = self.memory;
        let (output, hidden) = (self.layers[self.layers.len() - 1], &self.layers[..self.layers.len() - 1]);
        for (i, layer) in hidden.iter().enumerate() {
            let (below, above) = values.split_at_mut(i);
            let (inputs, values) = (below.last().map_or(observations, |values| values), &mut above[0]);
            if i == 1 {
                // Eq. 7: l_c = relu(l_s W_s + a W_a + b)
                layer.product(isa, parameters, inputs, values, batch);
                let weight = parameters.at(self.action_weights.clone());
                combined_relu(isa, values, parameters.at(layer.biases()), weight, actions, batch);
            } else {
                layer.forward(isa, parameters, inputs, values, batch);
            }
        }
        let (weight, bias) = (parameters.at(output.weights()), parameters.at(output.biases()));
        narrow(isa, weight, Some(bias), &values[hidden.len() - 1], &mut self.outputs, batch);
    }

    /// Sets the gradients of all trained parameters from `upper` (batch), dL/dQ; `observations` are (batch, inputs),
    /// `actions` (2, batch).
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
        let top = &self.memory.values[self.hidden() - 1];
        backward_output(isa, self.layers[self.hidden()], upper, top, gradient, sizes);
        for i in (0..self.hidden()).rev() {
            self.reach_layer(i, parameters, upper, gradient);
            let (layer, Memory { values, uppers, turned, .. }) = (self.layers[i], &mut self.memory);
            if i == 1 && self.frozen_combined {
                gradient[layer.biases()].fill(T::ZERO);
                continue;
            }
            let inputs = if i == 0 { observations } else { turn(&values[i - 1], turned, batch) };
            layer.weight_gradient(isa, &uppers[i], inputs, gradient, cut);
            if i == 1 {
                narrow_weights(isa, actions, &uppers[1], &mut gradient[self.action_weights.clone()], batch, cut);
            }
        }
    }

    /// Sets dL/d(W x + b) of hidden layer `i` and the gradient of its b from the layer above, or the output's `upper`.
    fn reach_layer(&mut self, i: usize, parameters: Packed<'_, T>, upper: &[T], gradient: &mut [T]) {
        let Memory { isa, sizes, ref values, ref mut uppers, .. } = self.memory;
        let (layer, above) = (self.layers[i], self.layers[i + 1]);
        let (own, further) = uppers.split_at_mut(i + 1);
        match further.first() {
            Some(upper) => above.input_gradient(isa, parameters, upper, &mut own[i], sizes[0]),
            None => narrow_inputs(isa, parameters.at(above.weights()), upper, &mut own[i], sizes[0]),
        }
        layer.through_relu(isa, &mut own[i], &values[i], gradient, sizes);
    }

    /// dL/da (2, batch) from `upper` (batch), dL/dQ. Of `gradient` some biases are overwritten.
    pub fn action_gradient(&mut self, parameters: Packed<'_, T>, upper: &[T], gradient: &mut [T], actions: &mut [T]) {
        for i in (1..self.hidden()).rev() {
            self.reach_layer(i, parameters, upper, gradient);
        }
        let Memory { isa, sizes: [batch, _], ref uppers, .. } = self.memory;
        narrow(isa, parameters.at(self.action_weights.clone()), None, &uppers[1], actions, batch);
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

    /// All of a vector in one piece.
    fn whole(numbers: &[f64]) -> [(usize, &[f64]); 1] {
        [(0, numbers)]
    }

    /// Layers one after the other, from place `first` on; and the place after them.
    fn layers(sizes: &[usize], first: usize) -> (Vec<Layer>, usize) {
        let mut end = first;
        let mut place = |size: usize| {
            end += size;
            end - size
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
            let (layers, size) = layers(&sizes, 0);
            let (parameters, observations) = (numbers(size, 0.1), numbers(INPUTS * BATCH, 0.2));
            let upper = numbers(2 * BATCH, 0.3);
            let mut actor = Actor::new(&layers, [BATCH, CUT], Isa::detect());
            let mut gradient = vec![f64::NAN; size];
            actor.forward(Packed::new(&whole(&parameters)), &observations);
            let rows = by_rows(&observations);
            let pieces = whole(&parameters);
            actor.backward(Packed::new(&pieces), Matrix::by_rows(&rows, INPUTS), &upper, &mut gradient);
            compare(&parameters, &gradient, |moved| {
                actor.forward(Packed::new(&whole(moved)), &observations);
                weighted(&actor.outputs, &upper)
            });
        }
    }

    #[test]
    fn critic_gradients_are_slopes() {
        for sizes in [vec![INPUTS, 6, 4, 1], vec![INPUTS, 4, 7, 5, 1], vec![INPUTS, 3, 4, 5, 6, 1]] {
            let action_weights = 0..ACTIONS * sizes[2];
            let (layers, size) = layers(&sizes, action_weights.end);
            let (parameters, observations) = (numbers(size, 0.4), numbers(INPUTS * BATCH, 0.5));
            let (actions, upper) = (numbers(ACTIONS * BATCH, 0.6), numbers(BATCH, 0.7));
            let mut critic = Critic::new(layers, action_weights, false, [BATCH, CUT], Isa::detect());
            let (mut gradient, pieces) = (vec![f64::NAN; size], whole(&parameters));
            critic.forward(Packed::new(&pieces), &observations, &actions);
            let rows = by_rows(&observations);
            critic.backward(Packed::new(&pieces), Matrix::by_rows(&rows, INPUTS), &actions, &upper, &mut gradient);
            compare(&parameters, &gradient, |moved| {
                critic.forward(Packed::new(&whole(moved)), &observations, &actions);
                weighted(&critic.outputs, &upper)
            });
            critic.forward(Packed::new(&pieces), &observations, &actions);
            let mut slopes = vec![0.0; ACTIONS * BATCH];
            critic.action_gradient(Packed::new(&pieces), &upper, &mut gradient, &mut slopes);
            compare(&actions, &slopes, |moved| {
                critic.forward(Packed::new(&pieces), &observations, moved);
                weighted(&critic.outputs, &upper)
            });
        }
    }

    #[test]
    fn a_frozen_combined_layer_has_no_gradient() {
        let action_weights = 0..ACTIONS * 6;
        let (layers, size) = layers(&[INPUTS, 4, 6, 1], action_weights.end);
        let (first, combined) = (layers[0], layers[1]);
        let mut critic = Critic::new(layers, action_weights.clone(), true, [BATCH, CUT], Isa::detect());
        let (observations, actions, parameters) =
            (numbers(INPUTS * BATCH, 0.5), numbers(ACTIONS * BATCH, 0.6), numbers(size, 0.4));
        let (mut gradient, pieces) = (vec![0.0; size], whole(&parameters));
        critic.forward(Packed::new(&pieces), &observations, &actions);
        let rows = by_rows(&observations);
        let upper = numbers(BATCH, 0.7);
        critic.backward(Packed::new(&pieces), Matrix::by_rows(&rows, INPUTS), &actions, &upper, &mut gradient);
        let frozen = [action_weights, combined.weights(), combined.biases()];
        assert!(frozen.into_iter().all(|range| gradient[range].iter().all(|&g| g == 0.0)));
        assert!(gradient[first.weights()].iter().any(|&g| g != 0.0));
    }
}
