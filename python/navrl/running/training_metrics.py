"""What a run reports about its training: rates over recent episodes, means since the last row.

    TrainingMetrics(num_envs, reward_scale)
        .add_step(sim);  .add_updates(metrics, count)
        .row(progress) -> dict[str, float | int | None]     the columns of metrics.csv; begins the next row
        .rates() -> Rates                                   over the newest episodes, for the screen
        .state() -> dict[str, ndarray];  .restore(state)

Everything is summed over the robots by numpy, and only the robots that finished are looked at one by one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isnan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from navrl.metrics import OUTCOMES, Scores
from navrl.replay import Arrays

if TYPE_CHECKING:
    from navrl.batch import BatchSim
    from navrl.td3 import UpdateMetrics

LEAST_WINDOW = 100
"""Episodes that the rates are taken over, or two of each robot if those are more."""

COLUMNS = (
    "steps",
    "episodes",
    "updates",
    "train_s",
    "success",
    "collision",
    "timeout",
    "return",
    "training_return",
    "episode_length",
    "v",
    "omega",
    "critic_loss",
    "average_q",
    "maximum_q",
    "actor_loss",
    "saturated_share",
    "sps",
    "ups",
    "validation_success",
    "validation_collision",
    "validation_timeout",
    "validation_return",
    "validation_spl",
)
"""Header of metrics.csv.

Rates, returns and episode_length (steps) are means over the newest training episodes, noise included: `return` in the
paper's form, `training_return` as the learner is paid, unscaled. The rest are means since the row before: v (m/s) and
the size of omega (rad/s) over all robots; the learner's figures over its updates, with Q in units of the unscaled
training reward; sps and ups per second of train_s. The validation columns are empty where none took place."""

CLOCKED = ("train_s", "sps", "ups")
"""Columns that depend on the clock; all others are the same for the same seed."""

Row = dict[str, float | int | None]


class Progress(NamedTuple):
    """How far a run is."""

    steps: int
    """Environment steps of all robots together."""
    episodes: int
    """Episodes that ended."""
    updates: int
    """Updates of the critics."""
    train_s: float
    """Seconds since the first step, without evaluation."""


class Rates(NamedTuple):
    """Means over the newest training episodes; NaN before the first has ended."""

    success: float
    collision: float
    timeout: float
    total_return: float
    """Paper's form."""
    training_return: float
    """As the learner is paid, unscaled."""
    episode_length: float
    """Steps."""


@dataclass
class _Sums:
    """Sums since the last row."""

    robot_steps: float = 0.0
    v: float = 0.0
    omega: float = 0.0
    updates: float = 0.0
    critic_loss: float = 0.0
    average_q: float = 0.0
    maximum_q: float = -np.inf
    actor_updates: float = 0.0
    actor_loss: float = 0.0
    saturated_share: float = 0.0


class TrainingMetrics:
    """Collects what the rows of metrics.csv and the screen show."""

    def __init__(self, num_envs: int, reward_scale: float) -> None:
        """Starts with no episode.

        Args:
            num_envs: Robots.
            reward_scale: Factor on rewards as the learner sees them.
        """
        self._reward_scale = reward_scale
        window = max(LEAST_WINDOW, 2 * num_envs)
        self._outcomes = np.zeros(window, np.uint8)
        # Columns: paper's return, training return, steps
        self._episodes = np.zeros((window, 3))
        self._ended = 0
        self._running_returns = np.zeros(num_envs)
        self._sums = _Sums()
        self._last = Progress(0, 0, 0, 0.0)

    def add_step(self, sim: BatchSim) -> None:
        """Counts the step that the simulator just made."""
        self._running_returns += sim.rewards
        velocities = sim.velocities
        self._sums.robot_steps += len(velocities)
        self._sums.v += float(velocities[:, 0].sum())
        self._sums.omega += float(np.abs(velocities[:, 1]).sum())
        ended = np.flatnonzero(sim.terminated | sim.truncated)
        if len(ended) == 0:
            return
        places = (self._ended + np.arange(len(ended))) % len(self._outcomes)
        self._outcomes[places] = sim.outcome[ended]
        self._episodes[places, 0] = sim.episode_returns[ended]
        self._episodes[places, 1] = self._running_returns[ended]
        self._episodes[places, 2] = sim.episode_steps[ended]
        self._running_returns[ended] = 0.0
        self._ended += len(ended)

    def add_updates(self, metrics: UpdateMetrics, count: int) -> None:
        """Counts `count` updates, of which `metrics` are the means."""
        sums = self._sums
        sums.updates += count
        sums.critic_loss += count * metrics.critic_loss
        sums.average_q += count * metrics.average_q / self._reward_scale
        sums.maximum_q = max(sums.maximum_q, metrics.maximum_q / self._reward_scale)
        if metrics.actor_updates:
            sums.actor_updates += metrics.actor_updates
            sums.actor_loss += metrics.actor_updates * metrics.actor_loss
            sums.saturated_share += metrics.actor_updates * metrics.saturated_share

    @property
    def episodes(self) -> int:
        """Episodes that ended since the start of the run."""
        return self._ended

    def rates(self) -> Rates:
        """Rates and means over the newest episodes."""
        count = min(self._ended, len(self._outcomes))
        if count == 0:
            return Rates(*[float("nan")] * len(Rates._fields))
        shares = [np.mean(self._outcomes[:count] == outcome) for outcome in OUTCOMES]
        means = self._episodes[:count].mean(axis=0)
        return Rates(*(float(number) for number in (*shares, *means)))

    def row(self, progress: Progress, validation: Scores | None) -> Row:
        """The numbers since the last row, which begin anew.

        Args:
            progress: How far the run is.
            validation: Scores, if a validation took place just now.

        Returns:
            A value by each name of COLUMNS; None where there is none.
        """
        sums, rates, last = self._sums, self.rates(), self._last
        seconds = progress.train_s - last.train_s
        numbers = {
            **progress._asdict(),
            "success": rates.success,
            "collision": rates.collision,
            "timeout": rates.timeout,
            "return": rates.total_return,
            "training_return": rates.training_return,
            "episode_length": rates.episode_length,
            "v": _ratio(sums.v, sums.robot_steps),
            "omega": _ratio(sums.omega, sums.robot_steps),
            "critic_loss": _ratio(sums.critic_loss, sums.updates),
            "average_q": _ratio(sums.average_q, sums.updates),
            "maximum_q": sums.maximum_q if sums.updates else None,
            "actor_loss": _ratio(sums.actor_loss, sums.actor_updates),
            "saturated_share": _ratio(sums.saturated_share, sums.actor_updates),
            "sps": _ratio(progress.steps - last.steps, seconds),
            "ups": _ratio(progress.updates - last.updates, seconds),
        }
        if validation is not None:
            numbers["validation_success"] = validation.success_rate
            numbers["validation_collision"] = validation.collision_rate
            numbers["validation_timeout"] = validation.timeout_rate
            numbers["validation_return"] = validation.average_return
            numbers["validation_spl"] = validation.spl
        self._sums, self._last = _Sums(), progress
        row = {name: numbers.get(name) for name in COLUMNS}
        return {name: None if number is None or isnan(number) else number for name, number in row.items()}

    def state(self) -> Arrays:
        """Everything, as copies."""
        return {
            "outcomes": self._outcomes.copy(),
            "episodes": self._episodes.copy(),
            "ended": np.array(self._ended, np.uint64),
            "running_returns": self._running_returns.copy(),
            "sums": np.array([getattr(self._sums, field.name) for field in fields(_Sums)]),
            "last": np.array(self._last, np.float64),
        }

    def restore(self, state: Arrays) -> None:
        """Puts back what `state` returned.

        Raises:
            ValueError: If it belongs to another number of robots.
        """
        for name, own in (("outcomes", self._outcomes), ("running_returns", self._running_returns)):
            if state[name].shape != own.shape:
                raise ValueError(f"saved {name} have shape {state[name].shape}, this run needs {own.shape}")
        self._outcomes[:] = state["outcomes"]
        self._episodes[:] = state["episodes"]
        self._ended = int(state["ended"])
        self._running_returns[:] = state["running_returns"]
        self._sums = _Sums(*(float(number) for number in state["sums"]))
        steps, episodes, updates, train_s = (float(number) for number in state["last"])
        self._last = Progress(int(steps), int(episodes), int(updates), train_s)


def _ratio(total: float, count: float) -> float | None:
    return total / count if count > 0 else None
