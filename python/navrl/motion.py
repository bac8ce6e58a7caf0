"""How robots moved: what is measured of every episode step by step, beside what the simulator sums up itself.

motion = Motion(num_envs, period)
motion.observe(simulator, robots)       after every step, with the robots that made it
motion.jerk(), motion.clearance(5), ... (num_envs,) each
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from navrl.batch import BatchSim

STANDING = 0.05
"""A robot slower than this (m/s) turns in place if it turns faster than TURNING."""
TURNING = 0.1
"""Turning speed (rad/s)."""


class Motion:
    """What robots did, step by step. Each is measured on its own: nothing depends on how many run beside it."""

    def __init__(self, num_envs: int, period: float) -> None:
        """Robots that have not moved yet.

        Args:
            num_envs: Number of robots.
            period: Control period, seconds.
        """
        self._num_envs, self._period = num_envs, period
        self._robots: list[NDArray[np.intp]] = []
        self._velocities: list[NDArray[np.float64]] = []
        self._clearances: list[NDArray[np.float32]] = []
        self._poses: list[NDArray[np.float64]] = []

    def observe(self, simulator: BatchSim, robots: NDArray[np.intp]) -> None:
        """Takes in the step just made.

        Args:
            simulator: All robots.
            robots: (n,) those that made the step; all that have made the ones before, less those that have ended.
        """
        self._robots.append(robots)
        self._velocities.append(simulator.velocities[robots])
        self._clearances.append(simulator.clearances[robots])
        self._poses.append(simulator.poses[robots])

    @cached_property
    def steps(self) -> NDArray[np.intp]:
        """(num_envs,) steps made; no more may be observed from here on."""
        counts = np.bincount(np.concatenate(self._robots), minlength=self._num_envs)
        return counts.astype(np.intp)

    @cached_property
    def _speeds(self) -> NDArray[np.float64]:
        """(2, steps, num_envs) v and omega, 0 after the last step of a robot."""
        rows = np.zeros((2, len(self._robots), self._num_envs))
        for step, (robots, velocities) in enumerate(zip(self._robots, self._velocities, strict=True)):
            rows[:, step, robots] = velocities.T
        return rows

    def _sum(self, terms: Iterable[NDArray[np.float64]], first: int) -> NDArray[np.float64]:
        """(num_envs,) sum of terms (num_envs,) of the steps `first`, `first` + 1, ..., as far as each robot came."""
        total = np.zeros(self._num_envs)
        for step, term in enumerate(terms, first):
            total += np.where(step < self.steps, term, 0.0)
        return total

    def jerk(self) -> NDArray[np.float64]:
        """(num_envs,) mean of |second difference of the executed v| / period^2 (m/s^3); 0 for less than three steps."""
        v = self._speeds[0]
        second_differences = (np.abs(new - 2 * old + older) for new, old, older in zip(v[2:], v[1:], v, strict=False))
        return self._sum(second_differences, 2) / np.maximum(self.steps - 2, 1) / self._period**2

    def omega_change(self) -> NDArray[np.float64]:
        """(num_envs,) sum of |change of the executed omega| from step to step, rad/s."""
        omega = self._speeds[1]
        return self._sum((np.abs(new - old) for new, old in zip(omega[1:], omega, strict=False)), 1)

    def turning_share(self) -> NDArray[np.float64]:
        """(num_envs,) share of the steps in which the robot turned in place."""
        v, omega = self._speeds
        # After its last step a robot stands and does not turn.
        turning: NDArray[np.float64] = np.sum((v < STANDING) & (np.abs(omega) > TURNING), axis=0) / self.steps
        return turning

    def clearance(self, percentile: float) -> NDArray[np.float64]:
        """A percentile of the clearances at the ends of steps, linear between ranks.

        Args:
            percentile: 0 to 100.

        Returns:
            (num_envs,) metres.
        """
        rows = np.full((len(self._robots), self._num_envs), np.inf, np.float32)
        for row, robots, clearances in zip(rows, self._robots, self._clearances, strict=True):
            row[robots] = clearances
        rows.sort(axis=0)
        rank = percentile / 100 * (self.steps - 1)
        low, everyone = np.floor(rank).astype(np.intp), np.arange(self._num_envs)
        below, above = (rows[place, everyone].astype(np.float64) for place in (low, np.ceil(rank).astype(np.intp)))
        values: NDArray[np.float64] = below + (rank - low) * (above - below)
        return values

    def tracks(self) -> list[NDArray[np.float32]]:
        """Where each robot was after each of its steps: (steps, 3) float32 each, x, y, yaw (m, m, rad)."""
        rows = np.empty((len(self._robots), self._num_envs, 3), np.float32)
        for row, robots, poses in zip(rows, self._robots, self._poses, strict=True):
            row[robots] = poses
        return [rows[:steps, robot].copy() for robot, steps in enumerate(self.steps.tolist())]
