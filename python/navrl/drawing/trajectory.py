"""One episode step by step, as pictures and films show it: the very one that an evaluation of the same list runs there.

robots = with_idle(scenario_list, index, sim)
drive(driver(pilot, sim), robots, sim) -> Trajectory
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navrl.batch import BatchSim, Scenario
from navrl.config import SimConfig
from navrl.errors import UserError
from navrl.evaluate import EVALUATION_SEED, Driver, steps
from navrl.metrics import OUTCOMES

if TYPE_CHECKING:
    from navrl.drawing.render import Moment
    from navrl.scenarios import ScenarioList


@dataclass(frozen=True)
class Trajectory:
    """An episode step by step; entry 0 is its start."""

    scenario: Scenario
    """Start, goal and obstacles."""
    sim: SimConfig
    """Robot, lidar and task."""
    poses: NDArray[np.float64]
    """(steps + 1, 3) x, y, yaw (m, m, rad)."""
    ranges: NDArray[np.float32]
    """(steps + 1, beams) metres."""
    velocities: NDArray[np.float64]
    """(steps + 1, 2) m/s, rad/s of the step that led here."""
    outcome: str
    """How it ended: "goal", "collision" or "timeout"."""
    planned: NDArray[np.float64] | None = None
    """(K, 2) the path (m) that led the robot; None without a planner."""

    @property
    def steps(self) -> int:
        """Control periods driven."""
        return len(self.poses) - 1

    def moment(self, step: int) -> Moment:
        """What moves, after so many steps."""
        from navrl.drawing.render import Moment

        v, omega = (float(speed) for speed in self.velocities[step])
        return Moment(
            pose=self.poses[step],
            ranges=self.ranges[step],
            path=self.poses[: step + 1, :2],
            step=step,
            v=v,
            omega=omega,
            outcome=self.outcome if step == self.steps else "running",
        )


def with_idle(scenarios: ScenarioList, index: int, sim: SimConfig) -> list[Scenario]:
    """A scenario of a list at its place, which names its lidar's noise; robots before it stand in their goals.

    Args:
        scenarios: The list.
        index: Place in the list, from 0.
        sim: The robot's task.

    Returns:
        (index + 1) scenarios, of which the last is the one.

    Raises:
        UserError: The list has no such place.
    """
    if not 0 <= index < len(scenarios):
        raise UserError(f"--index {index}: {scenarios.name} has scenarios 0 to {len(scenarios) - 1}")
    idle = Scenario(start=(0.0, 0.0, 0.0), goal=(0.0, 0.0), goal_radius=0.1, time_limit=sim.task.period)
    return [*([idle] * index), scenarios.scenarios[index]]


def drive(
    drive: Driver, robots: Sequence[Scenario], sim: SimConfig, *, planned: NDArray[np.float64] | None = None
) -> Trajectory:
    """Drives the last of some scenarios.

    Args:
        drive: What drives; it knows the robot by its place.
        robots: Scenarios of all robots.
        sim: Robot, lidar and task.
        planned: (K, 2) the path (m) that leads the robot, to be drawn; None without a planner.

    Returns:
        The episode.
    """
    simulator = BatchSim(sim, num_envs=len(robots), seed=EVALUATION_SEED, autoreset=False, scenarios=list(robots))
    last = len(robots) - 1
    history = [_situation(simulator, last)]
    for _ in steps(drive, simulator, np.array([last])):
        history.append(_situation(simulator, last))
    poses, ranges, velocities = (np.stack(rows) for rows in zip(*history, strict=True))
    outcome = OUTCOMES[int(simulator.outcome[last])]
    return Trajectory(robots[last], sim, poses, ranges, velocities, outcome, planned)


def _situation(simulator: BatchSim, robot: int) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float64]]:
    return simulator.poses[robot].copy(), simulator.ranges[robot].copy(), simulator.velocities[robot].copy()
