"""One episode step by step, as pictures and films show it: the very one that an evaluation of the same list runs there.

drive(policy, scenario_list, index, sim) -> Trajectory
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from navrl.batch import BatchSim, Scenario
from navrl.config import SimConfig
from navrl.errors import UserError
from navrl.evaluate import EVALUATION_SEED, Actor
from navrl.metrics import OUTCOMES, RUNNING

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


def drive(policy: Actor, scenarios: ScenarioList, index: int, sim: SimConfig) -> Trajectory:
    """Drives one scenario of a list.

    Args:
        policy: What drives.
        scenarios: The list.
        index: Place in the list, from 0.
        sim: Robot, lidar and task.

    Returns:
        The episode.

    Raises:
        UserError: The list has no such place.
    """
    if not 0 <= index < len(scenarios):
        raise UserError(f"--index {index}: {scenarios.name} has scenarios 0 to {len(scenarios) - 1}")
    scenario = scenarios.scenarios[index]
    # The place in the list names the lidar's noise. The robots before it end after one step in an open world.
    idle = Scenario(start=(0.0, 0.0, 0.0), goal=(100.0, 0.0), goal_radius=0.1, time_limit=sim.task.period)
    simulator = BatchSim(
        sim,
        num_envs=index + 1,
        seed=EVALUATION_SEED,
        autoreset=False,
        scenarios=[*([idle] * index), scenario],
    )
    actions = np.zeros((index + 1, 2), np.float32)
    history = [_situation(simulator, index)]
    with threadpool_limits(1, user_api="blas"):
        while simulator.outcome[index] == RUNNING:
            actions[index] = policy.act(simulator.observations[index])
            simulator.step(actions)
            history.append(_situation(simulator, index))
    poses, ranges, velocities = (np.stack(rows) for rows in zip(*history, strict=True))
    return Trajectory(scenario, sim, poses, ranges, velocities, OUTCOMES[int(simulator.outcome[index])])


def _situation(simulator: BatchSim, robot: int) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float64]]:
    return simulator.poses[robot].copy(), simulator.ranges[robot].copy(), simulator.velocities[robot].copy()
