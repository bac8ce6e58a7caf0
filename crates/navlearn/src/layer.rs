//! One dense layer, y = relu(W x + b), in its place in the packed parameters.

use crate::kernels::matrix::Matrix;
use crate::kernels::product::{Sum, multiply};
use crate::kernels::{Isa, bias_relu, through_relu};
use crate::packed::Packed;
use crate::real::Real;
use std::ops::Range;

/// Sizes of a layer, and where its numbers lie in the packed vector of parameters and in that of their gradients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layer {
    /// Units below.
    pub inputs: usize,
    /// Units of this layer.
    pub outputs: usize,
    /// Place of W (outputs, inputs).
    pub weight: usize,
    /// Place of b (outputs).
    pub bias: usize,
}

impl Layer {
    /// The same layer of the critic that lies `number` critics further.
    pub fn of_critic(self, number: usize) -> Self {
        let weight = self.weight + number * self.outputs * self.inputs;
        Self { weight, bias: self.bias + number * self.outputs, ..self }
    }

    /// Where W lies.
    pub fn weights(self) -> Range<usize> {
        self.weight..self.weight + self.outputs * self.inputs
    }

    /// Where b lies.
    pub fn biases(self) -> Range<usize> {
        self.bias..self.bias + self.outputs
    }

    /// W x (outputs, batch) for `inputs` x (inputs, batch).
    pub fn product<T: Real>(self, isa: Isa, parameters: Packed<'_, T>, inputs: &[T], outputs: &mut [T], batch: usize) {
        let mut rest = outputs;
        for weight in parameters.parts(self.weights()) {
            let (outputs, further) = rest.split_at_mut(weight.len() / self.inputs * batch);
            let weight = Matrix::by_rows(weight, self.inputs);
            multiply(isa, weight, Matrix::by_rows(inputs, batch), Sum::Whole, outputs);
            rest = further;
        }
    }

    /// relu(W x + b).
    pub fn forward<T: Real>(self, isa: Isa, parameters: Packed<'_, T>, inputs: &[T], outputs: &mut [T], batch: usize) {
        self.product(isa, parameters, inputs, outputs, batch);
        bias_relu(isa, outputs, parameters.at(self.biases()), batch);
    }

    /// Turns `upper` (outputs, batch) from dL/dy into dL/d(W x + b) and sets the gradient of b, a sum in two parts.
    pub fn through_relu<T: Real>(
        self,
        isa: Isa,
        upper: &mut [T],
        outputs: &[T],
        gradient: &mut [T],
        [batch, cut]: [usize; 2],
    ) {
        through_relu(isa, upper, outputs, &mut gradient[self.biases()], batch, cut);
    }

    /// Sets the gradient of W from dL/d(W x + b) and x^T (batch, inputs): the sum over the first `cut` rows of the
    /// batch plus that over the others.
    pub fn weight_gradient<T: Real>(
        self,
        isa: Isa,
        upper: &[T],
        inputs: Matrix<'_, T>,
        gradient: &mut [T],
        cut: usize,
    ) {
        let batch = upper.len() / self.outputs;
        multiply(isa, Matrix::by_rows(upper, batch), inputs, Sum::Parts(cut), &mut gradient[self.weights()]);
    }

    /// dL/dx (inputs, batch) from dL/d(W x + b).
    pub fn input_gradient<T: Real>(
        self,
        isa: Isa,
        parameters: Packed<'_, T>,
        upper: &[T],
        lower: &mut [T],
        batch: usize,
    ) {
        let (mut rest, mut sum) = (upper, Sum::Whole);
        for weight in parameters.parts(self.weights()) {
            let (upper, further) = rest.split_at(weight.len() / self.inputs * batch);
            let weight = Matrix::by_rows(weight, self.inputs).transposed();
            multiply(isa, weight, Matrix::by_rows(upper, batch), sum, lower);
            (rest, sum) = (further, Sum::Onto);
        }
    }
}
