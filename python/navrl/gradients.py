"""The update's arithmetic: forward passes and hand-written gradients of the networks, in memory taken once.

    pack(network) -> Parameter                            all parameters and gradients of a network in one vector
    unpack(vector, network) -> dict[str, Tensor]          views of such a vector by the parameters' names
    ActorPass(actor, batch_size)
        .forward(encoded (B, inputs)) -> (B, 2)           before tanh;  .backward(gradient (B, 2))
    CriticPass(critic, batch_size, critics=None)
        .forward(encoded, actions (B, 2)) -> (C, B);      .backward(gradient (C, B))
        .action_gradient(gradient (C, B)) -> (B, 2)

Networks of this size spend more time in autograd's bookkeeping and in fresh memory than in arithmetic. A pass computes
what autograd would from `Actor` and `TwinCritic`, on their own parameters; `backward` overwrites the parameters'
gradients. Results live in the pass until its next `forward`.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from navrl.networks import Actor, TwinCritic

ALIGNED = 16
"""Numbers to whose multiple each parameter begins in the packed vector: 64 bytes of float32."""


def pack(network: nn.Module) -> nn.Parameter:
    """Moves the parameters and gradients of a network into one vector, so that each step over them is one operation.

    Args:
        network: Its parameters become views of the vector, their gradients views of the vector's gradient; it must
            not be copied or moved afterwards.

    Returns:
        (n,) the vector, with zeros between the parameters where alignment wants them.
    """
    parameters = dict(network.named_parameters())
    first = next(iter(parameters.values()))
    vector = nn.Parameter(first.new_zeros(sum(_aligned(parameter) for parameter in parameters.values())))
    vector.grad = torch.zeros_like(vector)
    values, gradients = unpack(vector.detach(), network), unpack(vector.grad, network)
    for name, parameter in parameters.items():
        values[name].copy_(parameter.detach())
        parameter.data, parameter.grad = values[name], gradients[name]
    return vector


def unpack(vector: Tensor, network: nn.Module) -> dict[str, Tensor]:
    """Views of a vector that `pack` laid out, such as the parameters' moments, by the parameters' names."""
    views, start = {}, 0
    for name, parameter in network.named_parameters():
        views[name] = vector[start : start + parameter.numel()].view_as(parameter)
        start += _aligned(parameter)
    return views


def _aligned(parameter: Tensor) -> int:
    """Numbers that a parameter takes in a packed vector."""
    return -(-parameter.numel() // ALIGNED) * ALIGNED


class Layer:
    """One linear layer of C networks at once, y = x W^T + b, with relu or without."""

    def __init__(self, weight: nn.Parameter, bias: nn.Parameter, *, networks: int, batch_size: int, relu: bool) -> None:
        """Takes memory for a batch.

        Args:
            weight: ([C,] out, in), with its gradient in place.
            bias: ([C, 1,] out), with its gradient in place.
            networks: C of the pass; the first C of the parameters.
            batch_size: B.
            relu: Whether relu follows.
        """
        outputs, inputs = weight.shape[-2:]
        self.weight, self._weight_gradient = _stacked(weight, (-1, outputs, inputs), networks)
        self.bias, self._bias_gradient = _stacked(bias, (-1, 1, outputs), networks)
        self._weight_transposed = self.weight.transpose(1, 2)
        self.trained, self.relu = weight.requires_grad, relu
        self.output = weight.new_empty(networks, batch_size, outputs)
        self._input_gradient = weight.new_empty(networks, batch_size, inputs)
        self._inputs = self._input_gradient

    def forward(self, inputs: Tensor, addend: Tensor | None = None) -> Tensor:
        """Computes y = relu(x W^T + b), or with `addend` in place of b.

        Args:
            inputs: (C, B, in); must not change until `backward`.
            addend: (C, B, out) what to add to x W^T; the bias if None.

        Returns:
            (C, B, out).
        """
        self._inputs = inputs
        torch.baddbmm(self.bias if addend is None else addend, inputs, self._weight_transposed, out=self.output)
        return self.output.relu_() if self.relu else self.output

    def through_relu(self, gradient: Tensor) -> Tensor:
        """Turns dL/dy into dL/d(x W^T + b), in place; the outputs are spent."""
        # d relu(z) / dz = sign(relu(z))
        return gradient.mul_(self.output.sign_()) if self.relu else gradient

    def backward(self, gradient: Tensor, *, into_inputs: bool = True) -> Tensor:
        """Sets the parameters' gradients.

        Args:
            gradient: (C, B, out) dL/d(x W^T + b).
            into_inputs: Whether dL/dx is wanted.

        Returns:
            (C, B, in) dL/dx, if wanted.
        """
        if self.trained:
            torch.bmm(gradient.transpose(1, 2), self._inputs, out=self._weight_gradient)
            torch.sum(gradient, 1, keepdim=True, out=self._bias_gradient)
        return self.input_gradient(gradient) if into_inputs else self._input_gradient

    def input_gradient(self, gradient: Tensor) -> Tensor:
        """(C, B, in) dL/dx for `gradient` (C, B, out) dL/d(x W^T + b)."""
        return torch.bmm(gradient, self.weight, out=self._input_gradient)


class ActorPass:
    """A batch through an actor (equation 8) and back."""

    def __init__(self, actor: Actor, batch_size: int) -> None:
        """Takes memory for batches of `batch_size`."""
        linears = [*actor.hidden, actor.output]
        self._layers = [
            Layer(linear.weight, linear.bias, networks=1, batch_size=batch_size, relu=linear is not actor.output)
            for linear in linears
        ]

    def forward(self, encoded: Tensor) -> Tensor:
        """The inputs of the output's tanh: (B, 2) for `encoded` (B, inputs)."""
        hidden = encoded[None]
        for layer in self._layers:
            hidden = layer.forward(hidden)
        return hidden[0]

    def backward(self, gradient: Tensor) -> None:
        """Sets the gradients of all parameters from `gradient` (B, 2), that of the inputs of tanh."""
        upper = gradient[None]
        for layer in reversed(self._layers):
            upper = layer.backward(layer.through_relu(upper), into_inputs=layer is not self._layers[0])


class CriticPass:
    """A batch through critics (equation 7) and back."""

    def __init__(self, critic: TwinCritic, batch_size: int, critics: int | None = None) -> None:
        """Takes memory.

        Args:
            critic: The critics.
            batch_size: B.
            critics: C, how many of them to pass through: the first ones; all if None.
        """
        count = len(critic.action_weight) if critics is None else critics
        last = len(critic.weights) - 1
        self._layers = [
            Layer(weight, bias, networks=count, batch_size=batch_size, relu=i < last)
            for i, (weight, bias) in enumerate(zip(critic.weights, critic.biases, strict=True))
        ]
        shape = critic.action_weight.shape
        self._action_weight, self._action_weight_gradient = _stacked(critic.action_weight, shape, count)
        self._action_part = torch.empty_like(self._layers[1].output)
        self._actions = self._action_part

    def forward(self, encoded: Tensor, actions: Tensor) -> Tensor:
        """Q(s, a).

        Args:
            encoded: (B, inputs); must not change until `backward`.
            actions: (B, 2), likewise.

        Returns:
            (C, B).
        """
        first, combined, *further = self._layers
        count = len(self._action_weight)
        self._actions = actions.expand(count, *actions.shape)
        hidden = first.forward(encoded.expand(count, *encoded.shape))
        # Eq. 7: l_c = relu(l_s W_s + a W_a + b)
        torch.baddbmm(combined.bias, self._actions, self._action_weight, out=self._action_part)
        hidden = combined.forward(hidden, self._action_part)
        for layer in further:
            hidden = layer.forward(hidden)
        return hidden[:, :, 0]

    def backward(self, gradient: Tensor) -> None:
        """Sets the gradients of all trained parameters from `gradient` (C, B), dL/dQ."""
        first, combined, *further = self._layers
        upper = gradient[:, :, None]
        for layer in reversed(further):
            upper = layer.backward(layer.through_relu(upper))
        upper = combined.through_relu(upper)
        if combined.trained:
            torch.bmm(self._actions.transpose(1, 2), upper, out=self._action_weight_gradient)
        first.backward(first.through_relu(combined.backward(upper)), into_inputs=False)

    def action_gradient(self, gradient: Tensor) -> Tensor:
        """dL/da (B, 2), summed over the critics, from `gradient` (C, B), dL/dQ."""
        _, combined, *further = self._layers
        upper = gradient[:, :, None]
        for layer in reversed(further):
            upper = layer.input_gradient(layer.through_relu(upper))
        return torch.bmm(combined.through_relu(upper), self._action_weight.transpose(1, 2)).sum(0)


def _stacked(parameter: nn.Parameter, shape: tuple[int, ...], networks: int) -> tuple[Tensor, Tensor]:
    """The first `networks` of a parameter and of its gradient, in `shape`."""
    gradient = parameter.grad if parameter.grad is not None else torch.zeros_like(parameter)
    return parameter.detach().view(shape)[:networks], gradient.view(shape)[:networks]
