"""Sizes, first weights, the ablation, and the mirror of what networks see and do."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
import torch

from navrl.config import NetworksConfig
from navrl.encoding import Encoding, encode_observations, encoded_size
from navrl.mirror import mirror_actions, mirror_encoded
from navrl.networks import Actor, TwinCritic
from navrl.streams import stream

ZERO = NetworksConfig(hidden_sizes=(30, 20), output_scale=0.1)
TORCH = NetworksConfig(hidden_sizes=(30, 20), initialization="torch", output_scale=0.1)


def test_sizes_by_configuration() -> None:
    """The paper's networks have 501,802 (actor) and 502,401 (each critic) parameters from 24 inputs."""
    paper = NetworksConfig(hidden_sizes=(800, 600), encoding="raw", initialization="torch")
    actor = Actor(24, paper, stream(0, "test"))
    critic = TwinCritic(24, paper, stream(0, "test"))
    assert sum(p.numel() for p in actor.parameters()) == 501_802
    assert sum(p.numel() for p in critic.parameters()) == 2 * 502_401
    deep = NetworksConfig(hidden_sizes=(7, 6, 5, 4))
    assert Actor(9, deep, stream(0, "test"))(torch.zeros(3, 9)).shape == (3, 2)
    assert TwinCritic(9, deep, stream(0, "test"))(torch.zeros(3, 9), torch.zeros(3, 2)).shape == (2, 3)
    single = TwinCritic(9, deep, stream(0, "test"), num_critics=1)
    assert single(torch.zeros(3, 9), torch.zeros(3, 2)).shape == (1, 3)


def test_every_parameter_moves_the_value() -> None:
    """All of the combined layer counts, in each critic for itself."""
    critic = TwinCritic(3, ZERO, stream(0, "test"))
    generator = torch.Generator().manual_seed(0)
    encoded, actions = torch.rand(40, 3, generator=generator), torch.rand(40, 2, generator=generator)
    for number in (0, 1):
        critic.zero_grad()
        critic(encoded, actions)[number].sum().backward()
        for name, parameter in critic.named_parameters():
            assert parameter.grad is not None
            assert parameter.grad[number].any(), name
            assert not parameter.grad[1 - number].any(), name


def test_frozen_combined_layer_is_left_out() -> None:
    """95.9 % of the paper's critic: W_s, W_a and b; gradients still pass through to the first layer."""
    config = NetworksConfig(hidden_sizes=(800, 600), encoding="raw", frozen_combined=True)
    critic = TwinCritic(24, config, stream(0, "test"), num_critics=1)
    frozen = sum(p.numel() for p in critic.parameters() if not p.requires_grad)
    assert frozen == 800 * 600 + 2 * 600 + 600
    critic(torch.rand(8, 24), torch.rand(8, 2)).sum().backward()
    assert critic.weights[0].grad is not None
    assert critic.weights[0].grad.any()


def test_zero_bias_initialization() -> None:
    """Biases 0, weights uniform within 1 / sqrt(inputs), the actor's last layer scaled."""
    actor, critic = Actor(10, ZERO, stream(5, "test")), TwinCritic(10, ZERO, stream(5, "test"))
    biases = [layer.bias for layer in (*actor.hidden, actor.output)] + list(critic.biases)
    assert not any(bias.any() for bias in biases)
    expected = [
        (actor.hidden[0].weight, 1 / sqrt(10)),
        (actor.hidden[1].weight, 1 / sqrt(30)),
        (actor.output.weight, 0.1 / sqrt(20)),
        (critic.weights[0], 1 / sqrt(10)),
        (critic.weights[1], 1 / sqrt(30)),
        (critic.action_weight, 1 / sqrt(30)),
        (critic.weights[2], 1 / sqrt(20)),
    ]
    for weight, bound in expected:
        assert 0.8 * bound < weight.abs().max() <= bound
        # The standard deviation of a uniform number is its bound / sqrt(3); at least 40 numbers each.
        assert weight.std().item() == pytest.approx(bound / sqrt(3), rel=0.25)
    assert not torch.equal(critic.weights[1][0], critic.weights[1][1])


def test_torch_initialization() -> None:
    """As the framework's linear layers, the combined layer being one of the state and one of the action."""
    actor, critic = Actor(10, TORCH, stream(5, "test")), TwinCritic(10, TORCH, stream(5, "test"))
    expected = [
        (actor.output.weight, 1 / sqrt(20)),
        (actor.hidden[1].bias, 1 / sqrt(30)),
        (critic.biases[0], 1 / sqrt(10)),
        (critic.biases[1], 1 / sqrt(2)),
        (critic.weights[1], 1 / sqrt(30)),
        (critic.action_weight, 1 / sqrt(2)),
    ]
    for parameter, bound in expected:
        assert 0.8 * bound < parameter.abs().max() <= bound


def test_weights_come_from_the_generator_alone() -> None:
    before = torch.get_rng_state()
    first = Actor(10, ZERO, stream(1, "test")).state_dict()
    torch.rand(3)
    again, other = Actor(10, ZERO, stream(1, "test")), Actor(10, ZERO, stream(2, "test"))
    assert all(torch.equal(tensor, first[name]) for name, tensor in again.state_dict().items())
    assert not torch.equal(other.output.weight, again.output.weight)
    torch.set_rng_state(before)


def test_one_hidden_layer_has_nothing_to_combine_in() -> None:
    class Shallow:
        """What the configuration refuses."""

        hidden_sizes = (5,)
        initialization = "torch"
        frozen_combined = False

    with pytest.raises(ValueError, match="two hidden layers or more"):
        TwinCritic(4, Shallow(), stream(0, "test"))  # type: ignore[arg-type]


@pytest.mark.parametrize("encoding", ["inverse", "raw"])
@pytest.mark.parametrize("bins", [20, 7])
def test_mirror_is_what_a_mirrored_world_shows(encoding: Encoding, bins: int) -> None:
    """Encoding the mirrored observation and mirroring the encoded one give the same."""
    generator = np.random.default_rng(0)
    observations = generator.uniform(0.0, 9.0, (50, bins + 4)).astype(np.float32)
    observations[:, bins + 1] = generator.uniform(-np.pi, np.pi, 50)
    observations[:, bins + 2 :] = generator.uniform(-1.0, 1.0, (50, 2))
    mirrored = observations.copy()
    mirrored[:, :bins] = observations[:, :bins][:, ::-1]
    mirrored[:, [bins + 1, bins + 3]] *= -1.0
    mirror = mirror_encoded(bins, encoding)
    encoded = encode_observations(observations, encoding)
    assert mirror.permutation.shape == mirror.signs.shape == (encoded_size(bins, encoding),)
    reflected = encoded[:, mirror.permutation] * mirror.signs
    np.testing.assert_array_equal(reflected, encode_observations(mirrored, encoding))
    np.testing.assert_array_equal(reflected[:, mirror.permutation] * mirror.signs, encoded)
    assert not np.array_equal(reflected, encoded)


def test_mirrored_action_turns_the_other_way() -> None:
    mirror = mirror_actions()
    action = np.array([[0.3, -0.7]], np.float32)
    np.testing.assert_array_equal(action[:, mirror.permutation] * mirror.signs, np.array([[0.3, 0.7]], np.float32))
