"""Schedules, first random steps, forced actions that end, and the saved state; equations are in test_equations.py."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl.config import ExplorationConfig
from navrl.exploration import Exploration
from navrl.streams import stream, stream_state

FORCED = ExplorationConfig(forced=True, forced_probability=1.0, random_steps=0, sigma_min=0.0, sigma_max=0.0)


def _near(robots: int) -> NDArray[np.float32]:
    """Observations with an obstacle in front."""
    return np.full((robots, 24), 0.5, np.float32)


def test_spread_is_even_over_the_robots() -> None:
    config = ExplorationConfig(sigma_min=0.1, sigma_max=0.5, random_steps=0)
    exploration = Exploration(config, num_envs=5, seed=0)
    assert exploration.sigma(123_456).tolist() == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert Exploration(config, num_envs=1, seed=0).sigma(0).tolist() == pytest.approx([0.3])
    noise = np.stack(
        [exploration.explore(np.zeros((5, 2), np.float32), np.ones((5, 24), np.float32), 0) for _ in range(4000)]
    )
    # Five standard errors of 8,000 draws: 4 % (clipping at 1 takes 1.6 % of 0.4 and 6 % of 0.5)
    assert noise[:, :3].std(axis=(0, 2)).tolist() == pytest.approx([0.1, 0.2, 0.3], rel=0.04)
    correlations = np.corrcoef(noise.reshape(4000, 10).T)
    assert np.abs(correlations - np.eye(10)).max() < 5.0 / np.sqrt(4000)


def test_first_steps_are_uniform() -> None:
    exploration = Exploration(ExplorationConfig(random_steps=100), num_envs=5000, seed=0)
    policy, observations = np.full((5000, 2), 0.9, np.float32), np.ones((5000, 24), np.float32)
    assert exploration.random(99)
    assert not exploration.random(100)
    actions = exploration.explore(policy, observations, 99)
    assert actions.dtype == np.float32
    # Five standard errors of 10,000 draws of variance 1/3: 0.029
    assert actions.mean() == pytest.approx(0.0, abs=0.029)
    assert np.abs(actions).max() <= 1.0
    assert (actions > 0.5).mean() == pytest.approx(0.25, abs=0.022)
    assert exploration.explore(policy, observations, 100).mean() > 0.5


def test_forced_action_ends_with_its_episode() -> None:
    exploration = Exploration(FORCED, num_envs=3, seed=0)
    policy, far = np.zeros((3, 2), np.float32), np.full((3, 24), 5.0, np.float32)
    assert (exploration.explore(policy, _near(3), 0)[:, 0] == -1.0).all()
    exploration.end_episodes(np.array([False, True, False]))
    assert exploration.explore(policy, far, 0)[:, 0].tolist() == [-1.0, 0.0, -1.0]


def test_forced_action_also_overrides_random_steps() -> None:
    config = ExplorationConfig(forced=True, forced_probability=1.0, random_steps=10)
    exploration = Exploration(config, num_envs=2, seed=0)
    assert (exploration.explore(np.zeros((2, 2), np.float32), _near(2), 0)[:, 0] == -1.0).all()


def test_policy_actions_are_not_written_to() -> None:
    exploration = Exploration(FORCED, num_envs=4, seed=0)
    policy = np.zeros((4, 2), np.float32)
    exploration.explore(policy, _near(4), 0)
    assert not policy.any()


def test_noise_of_a_robot_does_not_depend_on_the_others() -> None:
    """The same numbers whether or not another robot's forced action is under way."""
    config = ExplorationConfig(forced=True, forced_probability=1.0, random_steps=0)
    one, other = Exploration(config, num_envs=2, seed=0), Exploration(config, num_envs=2, seed=0)
    policy, far = np.zeros((2, 2), np.float32), np.full((2, 24), 5.0, np.float32)
    near = far.copy()
    near[1] = 0.5
    for _ in range(30):
        np.testing.assert_array_equal(one.explore(policy, far, 0)[0], other.explore(policy, near, 0)[0])


@pytest.mark.parametrize("bins", [5, 10, 20, 40])
def test_front_is_three_fifths_of_the_bins(bins: int) -> None:
    exploration = Exploration(FORCED, num_envs=bins, seed=0)
    observations = np.full((bins, bins + 4), 5.0, np.float32)
    observations[np.arange(bins), np.arange(bins)] = 0.5
    active = exploration.explore(np.zeros((bins, 2), np.float32), observations, 0)[:, 0] == -1.0
    front = np.flatnonzero(active)
    assert front.tolist() == list(range(bins // 5, bins - bins // 5))


@pytest.mark.parametrize("forced", [False, True])
def test_restored_exploration_continues_bitwise(forced: bool) -> None:
    config = ExplorationConfig(forced=forced, random_steps=40)
    one, generator = Exploration(config, num_envs=7, seed=4), np.random.default_rng(0)
    policy = generator.uniform(-1.0, 1.0, (7, 2)).astype(np.float32)
    for step in range(0, 210, 7):
        observations = generator.uniform(0.0, 2.0, (7, 24)).astype(np.float32)
        other = Exploration(config, num_envs=7, seed=4)
        other.restore({name: array.copy() for name, array in one.state().items()})
        ended = generator.random(7) < 0.1
        for exploration in (one, other):
            exploration.end_episodes(ended)
        actions = one.explore(policy, observations, step)
        assert other.explore(policy, observations, step).tobytes() == actions.tobytes()
        assert all(array.tobytes() == other.state()[name].tobytes() for name, array in one.state().items())


def test_restore_refuses_other_robots_and_seeds() -> None:
    exploration = Exploration(FORCED, num_envs=3, seed=0)
    with pytest.raises(ValueError, match="saved for 4 robots, this run has 3"):
        exploration.restore(Exploration(FORCED, num_envs=4, seed=0).state())
    with pytest.raises(ValueError, match="another seed"):
        exploration.restore(Exploration(FORCED, num_envs=3, seed=1).state())


def test_streams_of_different_names_differ() -> None:
    """Also neighbouring seeds; the same name repeats."""
    names = [(0, "mirror"), (1, "mirror"), (0, "exploration"), (2**64 - 1, "mirror")]
    draws = [tuple(stream(*name).integers(2**63, size=4)) for name in names]
    assert len(set(draws)) == len(names)
    assert tuple(stream(0, "mirror").integers(2**63, size=4)) == draws[0]
    assert stream_state(stream(2**64 - 1, "mirror"))[4] == 2**64 - 1
