"""The learner's equations with values computed by hand: 4, 7, 8, 9, 10, 11 and 12.

Equations 1, 2, 3, 5, 6 and 13 are tested where they live; docs/equations.md says where.
"""

from __future__ import annotations

from dataclasses import replace
from math import tanh

import numpy as np
import pytest
import torch
from torch import Tensor

from navrl.config import Config, ExplorationConfig, LearnerConfig, LidarConfig, NetworksConfig
from navrl.delayed_reward import delayed_reward
from navrl.exploration import Exploration
from navrl.networks import Actor, TwinCritic
from navrl.replay import Replay, row_width
from navrl.streams import stream
from navrl.td3 import TD3

TWO_TWO = NetworksConfig(hidden_sizes=(2, 2))


def _set(parameter: Tensor, values: object) -> None:
    """Writes numbers of the parameter's shape."""
    with torch.no_grad():
        parameter.copy_(torch.tensor(values))


def test_equation_4_delayed_reward() -> None:
    """r_g / i on the i-th step before the goal: 100 (1 + 1/2 + ... + 1/10) = 292.9 in all, nothing on the goal step."""
    shares = [delayed_reward(i, 100.0, 10) for i in range(13)]
    assert shares[:5] == pytest.approx([0.0, 100.0, 50.0, 100.0 / 3.0, 25.0])
    assert shares[10] == pytest.approx(10.0)
    assert shares[11:] == [0.0, 0.0]
    assert sum(shares) == pytest.approx(100.0 * 2.929, abs=0.01)


def test_equation_7_combined_layer() -> None:
    """Both critics with the numbers of a small example worked out by hand."""
    critic = TwinCritic(2, TWO_TWO, stream(0, "test"))
    # l_s = relu(s W_1 + b_1) with s = (1, 2): (1 - 2 + 0.5, 3 + 2 - 1) = (-0.5, 4) -> (0, 4)
    _set(critic.weights[0], [[[1.0, -1.0], [3.0, 1.0]]] * 2)
    _set(critic.biases[0], [[[0.5, -1.0]]] * 2)
    # a = (0.5, -1): l_c = relu(l_s W_s + a W_a + b)
    # first critic:  unit 1: 0 * 7 + 4 * 0.25 + 0.5 * 2 - 1 * 1 + 0.1 = 1.1;  unit 2: 4 * -1 + 0.5 * 4 + 0 = -2 -> 0
    # second critic: unit 1 the same;  unit 2: 4 * 1 + 0.5 * 4 - 1 = 5
    _set(critic.weights[1], [[[7.0, 0.25], [0.0, -1.0]], [[7.0, 0.25], [0.0, 1.0]]])
    _set(critic.action_weight, [[[2.0, 4.0], [1.0, 0.0]], [[2.0, 4.0], [1.0, 0.0]]])
    _set(critic.biases[1], [[[0.1, 0.0]], [[0.1, -1.0]]])
    # Q = 10 l_c1 + 2 l_c2 + 0.5
    _set(critic.weights[2], [[[10.0, 2.0]]] * 2)
    _set(critic.biases[2], [[[0.5]]] * 2)
    values = critic(torch.tensor([[1.0, 2.0]]), torch.tensor([[0.5, -1.0]]))
    assert values.tolist() == [pytest.approx([11.5], abs=1e-5), pytest.approx([21.5], abs=1e-5)]


def test_equation_8_actor() -> None:
    """Two relu layers, then tanh, worked out by hand."""
    actor = Actor(2, TWO_TWO, stream(0, "test"))
    # (1, 2): (1 - 2 + 0.5, 3 + 2 - 1) = (-0.5, 4) -> (0, 4)
    _set(actor.hidden[0].weight, [[1.0, -1.0], [3.0, 1.0]])
    _set(actor.hidden[0].bias, [0.5, -1.0])
    # (4 * 0.25 + 0.5, 4 * -1) = (1.5, -4) -> (1.5, 0)
    _set(actor.hidden[1].weight, [[9.0, 0.25], [5.0, -1.0]])
    _set(actor.hidden[1].bias, [0.5, 0.0])
    # (1.5 * 0.2 + 0.1, 1.5 * -2) = (0.4, -3)
    _set(actor.output.weight, [[0.2, 6.0], [-2.0, 8.0]])
    _set(actor.output.bias, [0.1, 0.0])
    encoded = torch.tensor([[1.0, 2.0]])
    assert actor.pre_tanh(encoded)[0].tolist() == pytest.approx([0.4, -3.0], abs=1e-6)
    assert actor(encoded)[0].tolist() == pytest.approx([tanh(0.4), tanh(-3.0)], abs=1e-6)


def _constant_learner(learner: LearnerConfig) -> TD3:
    """One bin, raw; target critics Q1' = 2 a1 + a2 + 3 and Q2' = a1 + 3; target actor (tanh 1, tanh -0.2)."""
    config = Config(
        lidar=LidarConfig(bins=1),
        networks=NetworksConfig(hidden_sizes=(2, 2), encoding="raw"),
        learner=replace(learner, mirror=False),
    )
    replay = Replay(8, row_width(5))
    # successor terminal in the second row: bootstrap factor 0
    rows = np.zeros((2, replay.width), np.float32)
    rows[:, -2], rows[:, -1] = [0.5, -3.0], [0.9, 0.0]
    replay.add(rows)
    td3 = TD3(config, replay, seed=0)
    for parameter in (*td3.actor_target.parameters(), *td3.critic_target.parameters()):
        _set(parameter, np.zeros(tuple(parameter.shape)).tolist())
    _set(td3.actor_target.output.bias, [1.0, -0.2])
    critics = 2 if learner.algorithm == "td3" else 1
    # l_c = relu(a1 + 2, a2 + 1), Q1' = 2 (a1 + 2) + (a2 + 1) - 2, Q2' = (a1 + 2) + 1
    _set(td3.critic_target.action_weight, [[[1.0, 0.0], [0.0, 1.0]]] * critics)
    _set(td3.critic_target.biases[1], [[[2.0, 1.0]]] * critics)
    _set(td3.critic_target.weights[2], [[[2.0, 1.0]], [[1.0, 0.0]]][:critics])
    _set(td3.critic_target.biases[2], [[[-2.0]], [[1.0]]][:critics])
    return td3


def _target(td3: TD3, noise: list[float]) -> list[float]:
    """Targets of the learner's two rows, with the same noise in both."""
    td3._rows.copy_(torch.from_numpy(td3.replay.read(0, 2)))
    return td3._target(torch.tensor([noise, noise])).tolist()


def test_equation_9_target() -> None:
    """y = R + gamma^m (1 - terminated) min(Q1', Q2') with the action clipped to [-1, 1]."""
    td3 = _constant_learner(LearnerConfig(batch_size=2, n_step=1))
    # a' = (tanh 1 + 0.1, tanh -0.2 - 0.5) = (0.8616, -0.6974): Q1' = 4.0258, Q2' = 3.8616
    a1 = tanh(1.0) + 0.1
    assert _target(td3, [0.1, -0.5]) == pytest.approx([0.5 + 0.9 * (a1 + 3.0), -3.0], abs=1e-5)
    # tanh 1 + 0.5 is clipped to 1, tanh -0.2 - 0.9 to -1: Q1' = 4, Q2' = 4
    assert _target(td3, [0.5, -0.9]) == pytest.approx([0.5 + 0.9 * 4.0, -3.0], abs=1e-5)
    # a' = (tanh 1 - 0.5, tanh -0.2 - 0.5) = (0.2616, -0.6974): Q1' = 2.8258, Q2' = 3.2616
    a1, a2 = tanh(1.0) - 0.5, tanh(-0.2) - 0.5
    assert _target(td3, [-0.5, -0.5]) == pytest.approx([0.5 + 0.9 * (2 * a1 + a2 + 3.0), -3.0], abs=1e-5)


def test_equation_9_noise_is_clipped() -> None:
    """clip(N(0, sigma), +-c), as numbers and in the share that is clipped."""
    td3 = _constant_learner(LearnerConfig(batch_size=2, n_step=1, policy_noise=0.2, noise_clip=0.3))
    noise = td3._target_noise((50_000, 2))
    assert np.abs(noise).max() == np.float32(0.3)
    # P(|N(0, 1)| > 1.5) = 0.1336; five standard errors of 100,000 draws are 0.0054
    assert (np.abs(noise) == np.float32(0.3)).mean() == pytest.approx(0.1336, abs=0.0054)
    # Var of N(0, 0.2) clipped at 1.5 sigma: 0.04 (1 - 2 * 1.5 phi(1.5) - 0.1336 + 2.25 * 0.1336) = 0.04 * 0.7785
    assert noise.var() == pytest.approx(0.04 * 0.7785, rel=0.02)


def test_equation_9_ddpg() -> None:
    """DDPG: one critic, no noise, no minimum."""
    td3 = _constant_learner(LearnerConfig(algorithm="ddpg", batch_size=2, n_step=1))
    noise = td3._target_noise((1, 2))[0].tolist()
    assert noise == [0.0, 0.0]
    value = 2 * tanh(1.0) + tanh(-0.2) + 3.0
    assert _target(td3, noise) == pytest.approx([0.5 + 0.9 * value, -3.0], abs=1e-5)


def test_equation_10_soft_update() -> None:
    """theta' <- tau theta + (1 - tau) theta' with every second update, and nothing in between."""
    td3 = _constant_learner(LearnerConfig(batch_size=2, n_step=1, tau=0.25, policy_delay=2))
    before = td3.actor_target.output.bias.tolist()
    td3.update(1)
    assert td3.actor_target.output.bias.tolist() == before == pytest.approx([1.0, -0.2])
    old = [parameter.detach().clone() for parameter in td3.critic_target.parameters()]
    td3.update(1)
    online = td3.actor.output.bias.tolist()
    expected = [0.25 * online[0] + 0.75 * 1.0, 0.25 * online[1] + 0.75 * -0.2]
    assert td3.actor_target.output.bias.tolist() == pytest.approx(expected, abs=1e-6)
    for target, source, was in zip(td3.critic_target.parameters(), td3.critic.parameters(), old, strict=True):
        torch.testing.assert_close(target, 0.25 * source + 0.75 * was)


def test_equation_11_exploration() -> None:
    """Sigma falls from 1 to 0.1 over 500,000 steps, and is the standard deviation of what is added."""
    config = ExplorationConfig(schedule="linear", random_steps=0)
    exploration = Exploration(config, num_envs=20_000, seed=0)
    sigmas = [exploration.sigma(step)[0] for step in (0, 100_000, 250_000, 500_000, 700_000)]
    assert sigmas == pytest.approx([1.0, 0.82, 0.55, 0.1, 0.1])
    noise = exploration.explore(np.zeros((20_000, 2), np.float32), np.ones((20_000, 24), np.float32), 500_000)
    # Five standard errors of 40,000 draws: 0.1 / sqrt(80,000) * 5
    assert noise.std() == pytest.approx(0.1, abs=0.0018)
    clipped = exploration.explore(np.full((20_000, 2), 0.5, np.float32), np.ones((20_000, 24), np.float32), 0)
    assert clipped.max() == 1.0
    assert clipped.min() == -1.0
    # P(0.5 + N(0, 1) > 1) = 0.3085
    assert (clipped == 1.0).mean() == pytest.approx(0.3085, abs=0.0116)


def test_equation_12_forced_actions() -> None:
    """15 % of the robots that have an obstacle under 0.6 m in bins 4..15 turn on the spot for 8 to 15 steps."""
    robots = 20_000
    config = ExplorationConfig(forced=True, random_steps=0, sigma_min=0.0, sigma_max=0.0)
    exploration = Exploration(config, num_envs=robots, seed=0)
    policy = np.full((robots, 2), 0.25, np.float32)
    near, far = np.full((2, robots, 24), 3.0, np.float32)
    near[0::4, 4], near[1::4, 15] = 0.59, 0.59
    near[2::4, [3]], near[3::4, [16]] = 0.59, 0.59
    near[2::4, 10] = 0.6
    started = exploration.explore(policy, near, 0)[:, 0] == -1.0
    assert not started[2::4].any()
    assert not started[3::4].any()
    # Five standard errors of 10,000 draws of probability 0.15: 0.0179
    assert started[0::2].mean() == pytest.approx(0.075, abs=0.0179)
    assert started[1::2].mean() == pytest.approx(0.075, abs=0.0179)
    lengths = started.astype(int)
    first = exploration._forced_actions.copy()
    assert (first[started, 0] == -1.0).all()
    assert first[started, 1].min() < -0.95
    assert first[started, 1].max() > 0.95
    for _ in range(20):
        actions = exploration.explore(policy, far, 0)
        active = actions[:, 0] == -1.0
        np.testing.assert_array_equal(actions[active], first[active])
        np.testing.assert_array_equal(actions[~active], policy[~active])
        lengths += active
    counts = np.bincount(lengths[started])
    assert set(np.flatnonzero(counts)) == set(range(8, 16))
    # About 188 of 1,500 robots for each of the eight lengths
    assert counts[8:].min() > 0.6 * counts[8:].mean()
