"""Memory of past steps: n-step rows (equations 4 and 9) in one packed float32 ring.

    row = encoded observation | action (2) | encoded successor | return R | bootstrap factor

    NStepAssembler(learner, num_envs=, encoded_size=, goal_reward=)
        .push(Transition) -> rows (n, width), ready for Replay.add
    Transition(observations=, actions=, ...): one step of all robots, by name
    Replay(capacity, width)
        .add(rows); .sample(indices) -> (n, width); .added (rows ever added), .size, .capacity, .width, .nbytes
        .oldest, .read(first, last), .write(first, rows): rows by their number since the start, for checkpoints
    both: .state() -> dict[str, ndarray]; .restore(state)
    NonFiniteError: NaN or infinity in training (exit code 3)

A row is complete when it enters the ring, so that a batch is one gather.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navrl.config import LearnerConfig
from navrl.delayed_reward import delayed_returns
from navrl.mirror import ACTIONS

GOAL = 1
"""`outcome` of a step that reached the goal."""

Arrays = dict[str, NDArray[np.generic]]
"""A saved state: arrays by name, integers as arrays without dimensions."""


class NonFiniteError(ArithmeticError):
    """A NaN or an infinity where training needs a number; the text names what and where."""


def row_width(encoded_size: int) -> int:
    """Columns of a row of replay, for `encoded_size` columns of an encoded observation."""
    return 2 * encoded_size + ACTIONS + 2


class Replay:
    """The last `capacity` rows, in one array of `capacity * width * 4` bytes that the system fills as it is used.

    Row number i (counted from the first that was ever added) lies in place i modulo `capacity`.
    """

    def __init__(self, capacity: int, width: int) -> None:
        """Takes the memory.

        Args:
            capacity: Most rows kept.
            width: Columns of a row.
        """
        self.rows = np.zeros((capacity, width), np.float32)
        """(capacity, width) float32, of which the first `size` are filled."""
        self.added = 0
        """Rows added since the start."""

    @property
    def capacity(self) -> int:
        """Most rows kept."""
        return len(self.rows)

    @property
    def width(self) -> int:
        """Columns of a row."""
        return self.rows.shape[1]

    @property
    def size(self) -> int:
        """Rows present."""
        return min(self.added, self.capacity)

    @property
    def oldest(self) -> int:
        """Number of the oldest row present."""
        return self.added - self.size

    @property
    def nbytes(self) -> int:
        """Memory of the ring when full (bytes)."""
        return self.rows.nbytes

    def add(self, rows: NDArray[np.float32]) -> None:
        """Appends rows; the oldest make room.

        Args:
            rows: (n, width) float32.

        Raises:
            NonFiniteError: If a row holds NaN or infinity; nothing is added then.
        """
        if not np.isfinite(rows).all():
            row, column = np.argwhere(~np.isfinite(rows))[0]
            raise NonFiniteError(f"replay row {self.added + row}, column {column}, is {rows[row, column]}")
        first, self.added = self.added, self.added + len(rows)
        kept = min(len(rows), self.capacity)
        self.write(first + len(rows) - kept, rows[len(rows) - kept :])

    def sample(self, indices: NDArray[np.int64], out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Gathers rows.

        Args:
            indices: (n,) int64 in [0, size).
            out: (n, width) float32 to fill, a new array if None.

        Returns:
            (n, width) float32 copies.
        """
        # "clip" spares numpy a buffer of the result's size; the indices are within the range.
        return np.take(self.rows, indices, axis=0, out=out, mode="clip")

    def read(self, first: int, last: int) -> NDArray[np.float32]:
        """Copies rows out by number.

        Args:
            first: Number of the first row, at least `oldest`.
            last: Number after the last row, at most `added`.

        Returns:
            (last - first, width) float32.

        Raises:
            IndexError: If some of them are not present.
        """
        if not self.oldest <= first <= last <= self.added:
            raise IndexError(f"rows {first} to {last} are not in replay, which holds {self.oldest} to {self.added}")
        return self.rows[np.arange(first, last) % self.capacity]

    def write(self, first: int, rows: NDArray[np.float32]) -> None:
        """Puts rows in their places by number, without counting them.

        Args:
            first: Number of the first row.
            rows: (n, width) float32, n <= capacity.
        """
        start = first % self.capacity
        fit = min(len(rows), self.capacity - start)
        self.rows[start : start + fit] = rows[:fit]
        self.rows[: len(rows) - fit] = rows[fit:]

    def state(self) -> Arrays:
        """The counter; the rows themselves are read with `read`, so that only new ones need saving."""
        return {"added": np.array(self.added, np.uint64)}

    def restore(self, state: Arrays) -> None:
        """Takes the counter back, after the rows `oldest` to `added` were put back with `write`."""
        self.added = int(state["added"])


@dataclass(frozen=True, kw_only=True)
class Transition:
    """One step of every robot."""

    observations: NDArray[np.float32]
    """(num_envs, encoded_size) what the actions were chosen from, encoded."""
    actions: NDArray[np.float32]
    """(num_envs, 2) in [-1, 1]."""
    rewards: NDArray[np.float32]
    """(num_envs,) unscaled."""
    successors: NDArray[np.float32]
    """(num_envs, encoded_size) `final_observations`, encoded."""
    terminated: NDArray[np.bool_]
    """(num_envs,) goal or collision."""
    truncated: NDArray[np.bool_]
    """(num_envs,) time limit."""
    outcome: NDArray[np.uint8]
    """(num_envs,) 0 running, 1 goal, 2 collision, 3 time-out."""


class NStepAssembler:
    """Builds the rows of many robots from their steps.

    Row t of an episode of T steps: m = min(n_step, T - t); R = sum over k < m of gamma^k * scale * (reward + eq. 4) at
    step t + k; the successor of step t + m - 1; bootstrap factor 0 if that step terminated, else gamma^m, also at a
    time limit. It is handed out when nothing can change it any more: at the end of its episode, or once the steps up to
    t + m - 1 + delayed_steps are known.

    Pending steps lie in a ring of `n_step + delayed_steps` places, shared by all robots; a step's age is the number of
    steps since, so that place (newest - age) modulo the ring's length holds the step of that age of every robot.
    """

    def __init__(self, learner: LearnerConfig, *, num_envs: int, encoded_size: int, goal_reward: float) -> None:
        """Starts with no pending step.

        Args:
            learner: gamma, n_step, delayed_steps and reward_scale.
            num_envs: Robots.
            encoded_size: Columns of an encoded observation.
            goal_reward: r_g of equation 4, unscaled.
        """
        self.n_step, self.scale = learner.n_step, learner.reward_scale
        self.length = learner.n_step + learner.delayed_steps
        self.encoded_size = encoded_size
        ages = np.arange(self.length)
        self._powers = learner.gamma ** np.arange(self.n_step + 1, dtype=np.float64)
        # What a reward counts in the return of the row that began `age` steps earlier.
        self._weights = np.where(ages < self.n_step, self.scale * learner.gamma**ages, 0.0)
        self._delayed = self.scale * delayed_returns(
            gamma=learner.gamma, n_step=self.n_step, goal_reward=goal_reward, delayed_steps=learner.delayed_steps
        )
        self._observations = np.zeros((self.length, num_envs, encoded_size), np.float32)
        self._successors = np.zeros((self.length, num_envs, encoded_size), np.float32)
        self._actions = np.zeros((self.length, num_envs, ACTIONS), np.float32)
        self._returns = np.zeros((self.length, num_envs), np.float64)
        self._steps = np.zeros(num_envs, np.int64)
        self._newest = 0

    def push(self, transition: Transition) -> NDArray[np.float32]:
        """Takes one step of every robot.

        Args:
            transition: Its arrays are copied.

        Returns:
            (n, width) float32: rows that are complete now, older steps first, then in the robots' order.

        Raises:
            NonFiniteError: If a reward, action or observation is NaN or infinite; it names the robot.
        """
        _refuse_non_finite(
            reward=transition.rewards,
            action=transition.actions,
            observation=transition.observations,
            final_observation=transition.successors,
        )
        ended = transition.terminated | transition.truncated
        self._newest = (self._newest + 1) % self.length
        self._observations[self._newest] = transition.observations
        self._successors[self._newest] = transition.successors
        self._actions[self._newest] = transition.actions
        self._returns[self._newest] = 0.0
        self._steps += 1
        places = (self._newest - np.arange(self.length)) % self.length
        # Eq. 9, summed as the rewards come in: R += gamma^age * scale * reward
        self._returns[places] += self._weights[:, None] * transition.rewards
        goals = np.flatnonzero(transition.outcome == GOAL)
        # Eq. 4: the part of the goal's reward that the earlier steps in each row earn
        self._returns[places[:, None], goals] += self._delayed[:, None]
        rows = self._complete_rows(places, transition.terminated, ended)
        self._steps[ended] = 0
        return rows

    def _complete_rows(
        self, places: NDArray[np.int64], terminated: NDArray[np.bool_], ended: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """The rows that nothing can change any more; `places[age]` is the ring's place of that age."""
        oldest_first = np.arange(self.length)[::-1, None]
        pending = oldest_first < self._steps
        complete = pending & (ended | (oldest_first == self.length - 1))
        order, robots = np.nonzero(complete)
        ages = self.length - 1 - order
        rewards = np.minimum(self.n_step, ages + 1)
        starts, ends = places[ages], places[ages - rewards + 1]
        # Only a return that reaches up to this step can end in its termination.
        bootstrap = np.where(terminated[robots] & (ages < self.n_step), 0.0, self._powers[rewards])
        size = self.encoded_size
        rows = np.empty((len(robots), row_width(size)), np.float32)
        rows[:, :size] = self._observations[starts, robots]
        rows[:, size : size + ACTIONS] = self._actions[starts, robots]
        rows[:, size + ACTIONS : -2] = self._successors[ends, robots]
        rows[:, -2] = self._returns[starts, robots]
        rows[:, -1] = bootstrap
        return rows

    def state(self) -> Arrays:
        """Everything pending, as copies."""
        return {
            "observations": self._observations.copy(),
            "successors": self._successors.copy(),
            "actions": self._actions.copy(),
            "returns": self._returns.copy(),
            "steps": self._steps.copy(),
            "newest": np.array(self._newest, np.int64),
        }

    def restore(self, state: Arrays) -> None:
        """Puts back what `state` returned.

        Raises:
            ValueError: If it belongs to other sizes.
        """
        own = self.state()
        for name, array in own.items():
            if state[name].shape != array.shape:
                raise ValueError(f"saved {name} have shape {state[name].shape}, this run needs {array.shape}")
        self._observations[:] = state["observations"]
        self._successors[:] = state["successors"]
        self._actions[:] = state["actions"]
        self._returns[:] = state["returns"]
        self._steps[:] = state["steps"]
        self._newest = int(state["newest"])


def _refuse_non_finite(**arrays: NDArray[np.float32]) -> None:
    """Raises NonFiniteError if an array (one row per robot) holds NaN or infinity."""
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            robot = int(np.argwhere(~np.isfinite(array))[0, 0])
            raise NonFiniteError(f"{name} of robot {robot} is not finite: {array[robot]}")
