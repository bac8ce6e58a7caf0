"""The ring, and rows of n-step returns against a slow formulation that knows whole episodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from navrl.config import LearnerConfig
from navrl.replay import NonFiniteError, NStepAssembler, Replay, Transition, row_width

ENCODED = 3


@pytest.mark.parametrize("sizes", [[3, 3, 3, 3], [1] * 23, [10], [7, 10, 2], [23, 4], [0, 5, 0]])
def test_ring_holds_the_newest_rows(sizes: list[int]) -> None:
    """Against a list, wraparound and more rows than places included."""
    replay, everything = Replay(10, 4), np.empty((0, 4), np.float32)
    generator = np.random.default_rng(0)
    for size in sizes:
        rows = generator.random((size, 4), np.float32)
        replay.add(rows)
        everything = np.concatenate([everything, rows])
        assert replay.added == len(everything)
        assert replay.size == min(10, len(everything))
        assert replay.oldest == max(0, len(everything) - 10)
        np.testing.assert_array_equal(replay.read(replay.oldest, replay.added), everything[-10:])
    held = {tuple(row) for row in everything[-10:]}
    assert {tuple(row) for row in replay.sample(np.arange(replay.size))} == held
    assert replay.nbytes == 160


def test_sample_copies_the_rows_that_are_asked_for() -> None:
    replay = Replay(4, 2)
    replay.add(np.array([[0, 1], [2, 3], [4, 5]], np.float32))
    rows = replay.sample(np.array([2, 0, 2]))
    np.testing.assert_array_equal(rows, [[4, 5], [0, 1], [4, 5]])
    rows[:] = 9.0
    assert replay.rows.max() == 5.0
    out = np.empty((1, 2), np.float32)
    assert replay.sample(np.array([1]), out=out) is out
    np.testing.assert_array_equal(out, [[2, 3]])


def test_rows_by_number_rebuild_the_ring() -> None:
    """What a checkpoint does: read new rows in pieces, write the pieces that are still present, set the counter."""
    replay, restored = Replay(10, 2), Replay(10, 2)
    replay.add(np.arange(46, dtype=np.float32).reshape(23, 2))
    for first, last in ((13, 16), (16, 22), (22, 23)):
        restored.write(first, replay.read(first, last))
    restored.restore(replay.state())
    assert restored.added == 23
    np.testing.assert_array_equal(restored.rows, replay.rows)
    restored.add(np.ones((3, 2), np.float32))
    replay.add(np.ones((3, 2), np.float32))
    np.testing.assert_array_equal(restored.rows, replay.rows)
    for first, last in ((15, 20), (20, 27), (22, 21)):
        with pytest.raises(IndexError, match="not in replay, which holds 16 to 26"):
            replay.read(first, last)


def test_counter_has_64_bits() -> None:
    replay = Replay(3, 1)
    replay.restore({"added": np.array(2**63 + 5, np.uint64)})
    replay.add(np.ones((2, 1), np.float32))
    assert int(replay.state()["added"]) == 2**63 + 7
    assert replay.state()["added"].dtype == np.uint64


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_ring_refuses_what_is_not_finite(bad: float) -> None:
    replay = Replay(5, 3)
    replay.add(np.ones((4, 3), np.float32))
    rows = np.ones((3, 3), np.float32)
    rows[1, 2] = bad
    with pytest.raises(NonFiniteError, match="replay row 5, column 2"):
        replay.add(rows)
    assert replay.added == 4
    assert np.isfinite(replay.rows).all()


@dataclass(frozen=True)
class Step:
    """One step of one robot."""

    observation: NDArray[np.float32]
    action: NDArray[np.float32]
    reward: float
    successor: NDArray[np.float32]
    outcome: int


def _episode(generator: np.random.Generator, length: int, outcome: int) -> list[Step]:
    """Made-up steps, the last with `outcome` (0 if the episode never ends)."""
    observations = generator.random((length + 1, ENCODED), np.float32)
    return [
        Step(
            observation=observations[t],
            action=generator.uniform(-1.0, 1.0, 2).astype(np.float32),
            reward=float(np.float32(generator.normal())),
            successor=observations[t + 1],
            outcome=outcome if t == length - 1 else 0,
        )
        for t in range(length)
    ]


def _rows_of(episode: list[Step], learner: LearnerConfig, goal_reward: float) -> list[tuple[int, NDArray[np.float32]]]:
    """Every row of an episode with the step (counted from its start) after which it is complete; by plain loops."""
    rewards, ended = [step.reward for step in episode], episode[-1].outcome
    if ended == 1:
        for i in range(1, learner.delayed_steps + 1):
            if len(episode) - 1 - i >= 0:
                rewards[len(episode) - 1 - i] += goal_reward / i
    rows = []
    for t in range(len(episode)):
        m = min(learner.n_step, len(episode) - t)
        complete = t + m - 1 + (learner.delayed_steps if m == learner.n_step else 0)
        if complete >= len(episode):
            complete = len(episode) - 1
            if not ended:
                continue
        if m < learner.n_step and not ended:
            continue
        value = sum(learner.gamma**k * learner.reward_scale * rewards[t + k] for k in range(m))
        last = episode[t + m - 1]
        factor = 0.0 if last.outcome in (1, 2) else learner.gamma**m
        row = np.concatenate([episode[t].observation, episode[t].action, last.successor, [value, factor]])
        rows.append((complete, row.astype(np.float32)))
    return rows


def _push(assembler: NStepAssembler, steps: list[Step]) -> NDArray[np.float32]:
    """One step of every robot."""
    outcome = np.array([step.outcome for step in steps], np.uint8)
    transition = Transition(
        observations=np.stack([step.observation for step in steps]),
        actions=np.stack([step.action for step in steps]),
        rewards=np.array([step.reward for step in steps], np.float32),
        successors=np.stack([step.successor for step in steps]),
        terminated=(outcome == 1) | (outcome == 2),
        truncated=outcome == 3,
        outcome=outcome,
    )
    return assembler.push(transition)


def _assembler(learner: LearnerConfig, robots: int, goal_reward: float = 100.0) -> NStepAssembler:
    return NStepAssembler(learner, num_envs=robots, encoded_size=ENCODED, goal_reward=goal_reward)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    n_step=st.integers(1, 7),
    delayed_steps=st.integers(0, 6),
    robots=st.integers(1, 5),
    longest=st.integers(1, 25),
    seed=st.integers(0, 2**32 - 1),
)
def test_rows_equal_the_plain_formulation(
    n_step: int, delayed_steps: int, robots: int, longest: int, seed: int
) -> None:
    """Random episodes of goals, collisions and time-outs, shorter and longer than the window, one after the other."""
    learner = LearnerConfig(gamma=0.9, n_step=n_step, delayed_steps=delayed_steps, reward_scale=0.5)
    generator, total = np.random.default_rng(seed), 60
    expected: list[list[tuple[NDArray[np.float32], int]]] = [[] for _ in range(total)]
    steps: list[list[Step]] = []
    for robot in range(robots):
        mine: list[Step] = []
        while len(mine) < total:
            length = int(generator.integers(1, longest + 1))
            rest = total - len(mine)
            outcome = int(generator.integers(1, 4)) if length <= rest else 0
            episode = _episode(generator, min(length, rest), outcome)
            for complete, row in _rows_of(episode, learner, 100.0):
                expected[len(mine) + complete].append((row, robot))
            mine += episode
        steps.append(mine)
    assembler = _assembler(learner, robots)
    for t in range(total):
        rows = _push(assembler, [mine[t] for mine in steps])
        assert rows.dtype == np.float32
        wanted = expected[t]
        assert rows.shape == (len(wanted), row_width(ENCODED))
        order = np.lexsort(rows.T)
        wanted_rows = np.array([row for row, _ in wanted], np.float32).reshape(-1, row_width(ENCODED))
        np.testing.assert_allclose(rows[order], wanted_rows[np.lexsort(wanted_rows.T)], rtol=1e-5, atol=1e-5)


def test_rows_come_oldest_first_then_by_robot() -> None:
    learner = LearnerConfig(gamma=0.5, n_step=3, delayed_steps=0, reward_scale=1.0)
    assembler, generator = _assembler(learner, 3), np.random.default_rng(0)
    episodes = [_episode(generator, 4, outcome) for outcome in (2, 0, 1)]
    pushed = [_push(assembler, [episode[t] for episode in episodes]) for t in range(4)]
    assert [len(rows) for rows in pushed] == [0, 0, 3, 7]
    np.testing.assert_array_equal(pushed[2][:, :ENCODED], [episode[0].observation for episode in episodes])
    starts = [episodes[r][t].observation for t, r in ((1, 0), (1, 1), (1, 2), (2, 0), (2, 2), (3, 0), (3, 2))]
    np.testing.assert_array_equal(pushed[3][:, :ENCODED], starts)


def test_time_limit_bootstraps_and_termination_does_not() -> None:
    """n = 3, gamma = 1/2, two steps of reward 4 and 8: R = 8 and 8; factors 1/4 and 1/2, or 0."""
    learner = LearnerConfig(gamma=0.5, n_step=3, delayed_steps=0, reward_scale=1.0)
    for outcome, factors in ((3, [0.25, 0.5]), (2, [0.0, 0.0]), (1, [0.0, 0.0])):
        assembler = _assembler(learner, 1)
        first, second = _episode(np.random.default_rng(0), 2, outcome)
        steps = [Step(s.observation, s.action, r, s.successor, s.outcome) for s, r in ((first, 4.0), (second, 8.0))]
        assert len(_push(assembler, [steps[0]])) == 0
        rows = _push(assembler, [steps[1]])
        assert rows[:, -2].tolist() == [8.0, 8.0]
        assert rows[:, -1].tolist() == factors
        np.testing.assert_array_equal(rows[:, -2 - ENCODED : -2], [second.successor] * 2)


def test_a_full_return_that_stops_before_the_end_bootstraps() -> None:
    """n = 1 with delayed steps: rows wait, and only the last one of the episode is terminal."""
    learner = LearnerConfig(gamma=0.5, n_step=1, delayed_steps=2, reward_scale=1.0)
    assembler = _assembler(learner, 1)
    steps = [
        Step(s.observation, s.action, 1.0, s.successor, s.outcome) for s in _episode(np.random.default_rng(0), 5, 1)
    ]
    pushed = [_push(assembler, [step]) for step in steps]
    assert [len(rows) for rows in pushed] == [0, 0, 1, 1, 3]
    rows = np.concatenate(pushed)
    assert rows[:, -2].tolist() == [1.0, 1.0, 51.0, 101.0, 1.0]
    assert rows[:, -1].tolist() == [0.5, 0.5, 0.5, 0.5, 0.0]


def test_assembler_restored_anywhere_continues_bitwise() -> None:
    learner = LearnerConfig(n_step=4, delayed_steps=3)
    generator = np.random.default_rng(0)
    steps = [step for _ in range(8) for step in _episode(generator, 5, int(generator.integers(1, 4)))]
    one, other = _assembler(learner, 1), _assembler(learner, 1)
    for t, step in enumerate(steps):
        state = one.state()
        kept = {name: array.tobytes() for name, array in state.items()}
        rows = _push(one, [step])
        assert {name: array.tobytes() for name, array in state.items()} == kept
        other = other if t % 3 else _assembler(learner, 1)
        other.restore(state)
        assert _push(other, [step]).tobytes() == rows.tobytes()


def test_assembler_refuses_a_state_of_other_sizes() -> None:
    learner = LearnerConfig()
    with pytest.raises(ValueError, match="this run needs"):
        _assembler(learner, 2).restore(_assembler(learner, 3).state())


def test_assembler_names_the_robot_that_is_not_finite() -> None:
    assembler, generator = _assembler(LearnerConfig(), 3), np.random.default_rng(0)
    steps = [_episode(generator, 1, 0)[0] for _ in range(3)]
    bad_reward = [*steps[:2], Step(steps[2].observation, steps[2].action, np.nan, steps[2].successor, 0)]
    with pytest.raises(NonFiniteError, match="reward of robot 2 is not finite: nan"):
        _push(assembler, bad_reward)
    steps[1].successor[0] = np.inf
    with pytest.raises(NonFiniteError, match="final_observation of robot 1"):
        _push(assembler, steps)
