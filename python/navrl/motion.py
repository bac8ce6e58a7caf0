"""How robots moved: what is measured of every episode step by step, beside what the simulator sums up itself.

motion = Motion(num_envs, period)
motion.observe(simulator, robots)       after every step, with the robots that made it
motion.jerk(), motion.clearance(5), ... (num_envs,) each
"""

from __future__ import annotations

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
    """Sums over the steps of many robots, each on its own: none depends on how many run beside it."""

    def __init__(self, num_envs: int, period: float) -> None:
        """Robots that have not moved yet.

        Args:
            num_envs: Number of robots.
            period: Control period, seconds.
        """
        self._period = period
        self.steps = np.zeros(num_envs, np.intp)
        """(num_envs,) steps seen."""
        self._last = np.zeros((num_envs, 2, 2))  # velocities of the last step and of the one before
        self._second_differences = np.zeros(num_envs)
        self._omega_change = np.zeros(num_envs)
        self._turning = np.zeros(num_envs, np.intp)
        self._history: list[tuple[NDArray[np.intp], NDArray[np.float32], NDArray[np.float32]]] = []

    def observe(self, simulator: BatchSim, robots: NDArray[np.intp]) -> None:
        """Takes in the step just made.

        Args:
            simulator: All robots.
            robots: (n,) those that made the step; all that have made the ones before, less those that have ended.
        """
        velocities, last = simulator.velocities[robots], self._last[robots]
        self._history.append((robots, simulator.clearances[robots], simulator.poses[robots].astype(np.float32)))
        if len(self._history) >= 2:
            self._omega_change[robots] += np.abs(velocities[:, 1] - last[:, 0, 1])
        if len(self._history) >= 3:
            self._second_differences[robots] += np.abs(velocities[:, 0] - 2 * last[:, 0, 0] + last[:, 1, 0])
        self._turning[robots] += (velocities[:, 0] < STANDING) & (np.abs(velocities[:, 1]) > TURNING)
        self._last[robots] = np.stack([velocities, last[:, 0]], axis=1)
        self.steps[robots] += 1

    def jerk(self) -> NDArray[np.float64]:
        """(num_envs,) mean of |second difference of the executed v| / period^2 (m/s^3); 0 for less than three steps."""
        return self._second_differences / np.maximum(self.steps - 2, 1) / self._period**2

    def omega_change(self) -> NDArray[np.float64]:
        """(num_envs,) sum of |change of the executed omega| from step to step, rad/s."""
        return self._omega_change

    def turning_share(self) -> NDArray[np.float64]:
        """(num_envs,) share of the steps in which the robot turned in place."""
        return self._turning / np.maximum(self.steps, 1)

    def clearance(self, percentile: float) -> NDArray[np.float64]:
        """A percentile of the clearances at the ends of steps, linear between ranks.

        Args:
            percentile: 0 to 100.

        Returns:
            (num_envs,) metres.
        """
        rows = np.full((len(self._history), len(self.steps)), np.inf, np.float32)
        for row, (robots, clearances, _) in zip(rows, self._history, strict=True):
            row[robots] = clearances
        rows.sort(axis=0)
        rank = percentile / 100 * (self.steps - 1)
        low, everyone = np.floor(rank).astype(np.intp), np.arange(len(self.steps))
        below, above = (rows[place, everyone].astype(np.float64) for place in (low, np.ceil(rank).astype(np.intp)))
        values: NDArray[np.float64] = below + (rank - low) * (above - below)
        return values

    def tracks(self) -> list[NDArray[np.float32]]:
        """Where each robot was after each of its steps: (steps, 3) float32 each, x, y, yaw (m, m, rad)."""
        rows = np.empty((len(self._history), len(self.steps), 3), np.float32)
        for row, (robots, _, places) in zip(rows, self._history, strict=True):
            row[robots] = places
        return [rows[:steps, robot].copy() for robot, steps in enumerate(self.steps.tolist())]
