"""Actor (equation 8) and critics (equation 7).

    Actor(inputs, config, generator)(encoded (B, inputs)) -> (B, 2) in [-1, 1];  .pre_tanh(encoded) -> (B, 2)
        parameters: hidden.<i>.weight (out, in), hidden.<i>.bias, output.weight (2, in), output.bias
    TwinCritic(inputs, config, generator, num_critics=2)(encoded (B, inputs), actions (B, 2)) -> (num_critics, B)

What they see is encoded by `navrl.encoding`.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt

import numpy as np
import torch
from torch import Tensor, nn

from navrl.config import NetworksConfig
from navrl.mirror import ACTIONS

__all__ = ["Actor", "TwinCritic"]


class Actor(nn.Module):
    """mu(s), the policy (equation 8): relu layers, then two outputs through tanh."""

    def __init__(self, inputs: int, config: NetworksConfig, generator: np.random.Generator) -> None:
        """Draws the first weights.

        Args:
            inputs: Columns of an encoded observation.
            config: Sizes and initialisation.
            generator: Source of the first weights.
        """
        super().__init__()
        sizes = (inputs, *config.hidden_sizes)
        self.hidden = nn.ModuleList(_linear(i, o, config, generator) for i, o in pairwise(sizes))
        self.output = _linear(sizes[-1], ACTIONS, config, generator)
        if config.initialization == "zero_bias":
            with torch.no_grad():
                self.output.weight.mul_(config.output_scale)

    def pre_tanh(self, encoded: Tensor) -> Tensor:
        """The input of the output's tanh.

        Args:
            encoded: (B, inputs) encoded observations.

        Returns:
            (B, 2).
        """
        hidden = encoded
        for layer in self.hidden:
            hidden = torch.relu(layer(hidden))
        output: Tensor = self.output(hidden)
        return output

    def forward(self, encoded: Tensor) -> Tensor:
        """The actions.

        Args:
            encoded: (B, inputs) encoded observations.

        Returns:
            (B, 2) in [-1, 1].
        """
        # Eq. 8: mu(s) = tanh(W_3 relu(W_2 relu(W_1 s + b_1) + b_2) + b_3)
        return torch.tanh(self.pre_tanh(encoded))


class TwinCritic(nn.Module):
    """Q(s, a) of one or two critics, computed together: every parameter has the critic as its first dimension.

    The first hidden layer sees the observation alone, the second is the combined layer of equation 7, further ones are
    plain. `weights[i]` (num_critics, out, in) and `biases[i]` (num_critics, 1, out) are layer i, the last one the
    output; `weights[1]` is W_s transposed and `action_weight` (num_critics, 2, out) is W_a.
    """

    def __init__(
        self, inputs: int, config: NetworksConfig, generator: np.random.Generator, *, num_critics: int = 2
    ) -> None:
        """Draws the first weights, critic after critic.

        Args:
            inputs: Columns of an encoded observation.
            config: Sizes, initialisation and the ablation `frozen_combined`.
            generator: Source of the first weights.
            num_critics: 2 for TD3, 1 for DDPG.

        Raises:
            ValueError: With fewer than two hidden layers there is none to combine in.
        """
        super().__init__()
        if len(config.hidden_sizes) < 2:
            raise ValueError(f"a critic needs two hidden layers or more, got {config.hidden_sizes}")
        sizes = (inputs, *config.hidden_sizes, 1)
        shapes = list(pairwise(sizes))
        torch_default = config.initialization == "torch"
        # The framework would make the combined layer of two linear layers, one for the state and one for the action,
        # and the published network takes the second one's bias. "zero_bias" treats it as one layer.
        action_fan_in = ACTIONS if torch_default else config.hidden_sizes[0]
        bias_fan_ins = [action_fan_in if i == 1 else fan_in for i, (fan_in, _) in enumerate(shapes)]
        self.weights = nn.ParameterList(torch.empty(num_critics, o, i) for i, o in shapes)
        self.action_weight = nn.Parameter(torch.empty(num_critics, ACTIONS, config.hidden_sizes[1]))
        self.biases = nn.ParameterList(torch.zeros(num_critics, 1, o) for _, o in shapes)
        for critic in range(num_critics):
            for weight, bias, fan_in in zip(self.weights, self.biases, bias_fan_ins, strict=True):
                _draw(weight[critic], weight.shape[2], generator)
                if torch_default:
                    _draw(bias[critic], fan_in, generator)
            _draw(self.action_weight[critic], action_fan_in, generator)
        if config.frozen_combined:
            for parameter in (self.weights[1], self.biases[1], self.action_weight):
                parameter.requires_grad_(False)

    def forward(self, encoded: Tensor, actions: Tensor) -> Tensor:
        """The values of all critics.

        Args:
            encoded: (B, inputs) encoded observations.
            actions: (B, 2) in [-1, 1].

        Returns:
            (num_critics, B).
        """
        batch = (len(self.action_weight), -1, -1)
        # l_s = relu(s W_1 + b_1)
        hidden = torch.relu(torch.baddbmm(self.biases[0], encoded.expand(batch), self.weights[0].transpose(1, 2)))
        # Eq. 7: l_c = relu(l_s W_s + a W_a + b)
        action_part = torch.baddbmm(self.biases[1], actions.expand(batch), self.action_weight)
        hidden = torch.relu(torch.baddbmm(action_part, hidden, self.weights[1].transpose(1, 2)))
        for i in range(2, len(self.weights) - 1):
            hidden = torch.relu(torch.baddbmm(self.biases[i], hidden, self.weights[i].transpose(1, 2)))
        return torch.baddbmm(self.biases[-1], hidden, self.weights[-1].transpose(1, 2)).squeeze(2)


def _linear(inputs: int, outputs: int, config: NetworksConfig, generator: np.random.Generator) -> nn.Linear:
    """A linear layer with first weights from `generator`, leaving the framework's own generator alone."""
    layer = nn.Linear(inputs, outputs, device="meta").to_empty(device="cpu")
    _draw(layer.weight, inputs, generator)
    if config.initialization == "torch":
        _draw(layer.bias, inputs, generator)
    else:
        nn.init.zeros_(layer.bias)
    return layer


def _draw(tensor: Tensor, fan_in: int, generator: np.random.Generator) -> None:
    """Fills with uniform numbers within +-1 / sqrt(fan_in)."""
    bound = 1.0 / sqrt(fan_in)
    numbers = generator.uniform(-bound, bound, tuple(tensor.shape)).astype(np.float32)
    with torch.no_grad():
        tensor.copy_(torch.from_numpy(numbers))
