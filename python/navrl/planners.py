"""Paths through a known world, and intermediate goals along them.

    plan(scenario, "astar", radius=0.25) -> Plan
    plan_all(scenarios, "rrtstar", seed=1, num_threads=2) -> [Plan, ...]
    Lookahead(plans, goals, distance=1.0).update(positions) -> targets

Planners: A* ("astar"), Dijkstra ("dijkstra"), RRT ("rrt"), RRT* ("rrtstar"), ant colony ("antcolony"), fast marching
("fmm"). Every path keeps its clearance from the exact shapes, not only on a grid. That there is no path is a status of
the plan and no exception.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from navrl import _navsim
from navrl.batch import Scenario
from navrl.config import PlannerConfig, RobotConfig

Planner = Literal["astar", "dijkstra", "rrt", "rrtstar", "antcolony", "fmm"]
"""Names of the planners."""
PLANNERS: tuple[Planner, ...] = get_args(Planner)
Status = Literal["found", "no path", "start in collision", "goal in collision", "too coarse", "budget spent"]
"""How a plan ends: see Plan.status."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What a planner found."""

    status: Status
    """"found"; "no path": the obstacles cut the goal off, exactly; "start in collision", "goal in collision": nearer to
    an obstacle than the radius; "too coarse": there is a way, but the cells are too large to show it; "budget spent":
    samples, rounds or time ended before a path was found."""
    path: NDArray[np.float64]
    """(K, 2) points (m) from the start to just within the goal circle, joined by straight lines; K = 0 unless found."""
    length: float
    """Length of the path (m); infinity without one."""
    clearance: float
    """Distance (m) that the path keeps from every shape: the radius and the margin, or what there was room for."""
    expansions: int
    """Nodes expanded ("astar", "dijkstra", "fmm"), samples drawn ("rrt", "rrtstar") or steps walked ("antcolony")."""
    time: float
    """Time that it took (s)."""

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return self.status == "found"


def plan(
    scenario: Scenario,
    planner: Planner = "astar",
    *,
    radius: float = RobotConfig().radius,
    config: PlannerConfig | None = None,
    seed: int = 0,
    index: int = 0,
) -> Plan:
    """Plans the way from a scenario's start into its goal circle; other threads run meanwhile.

    Args:
        scenario: Start, goal and obstacles, all of them known to the planner.
        planner: Its name.
        radius: Radius (m) of the robot, for a rectangle of the circle around it: ``navrl.scenarios.robot_radius``.
        config: Settings; None for the defaults.
        seed: Names the random numbers of "rrt", "rrtstar" and "antcolony".
        index: Names them too, such as the scenario's place in its list.

    Returns:
        The plan; look at its status.

    Raises:
        ValueError: A name or number out of range, or a resolution too fine for so large a world.
    """
    settings = asdict(config or PlannerConfig())
    # Who follows a path looks ahead; who plans one does not.
    del settings["lookahead"]
    status, path, length, clearance, expansions, time = _navsim.plan(
        scenario, planner, radius, json.dumps(settings), seed, index
    )
    path.flags.writeable = False
    return Plan(status, path, length, clearance, expansions, time)  # type: ignore[arg-type]


def plan_all(
    scenarios: Sequence[Scenario],
    planner: Planner = "astar",
    *,
    radius: float = RobotConfig().radius,
    config: PlannerConfig | None = None,
    seed: int = 0,
    num_threads: int = 1,
) -> list[Plan]:
    """Plans the way of every scenario of a list, which is also its index.

    Args:
        scenarios: As of ``plan``, like the other arguments.
        planner: Its name.
        radius: Radius of the robot, metres.
        config: Settings; None for the defaults.
        seed: Names the random numbers.
        num_threads: Scenarios that are planned at once; this changes times and nothing else.

    Returns:
        Plans in the order of the scenarios.

    Raises:
        ValueError: As of ``plan``.
    """

    def one(index: int) -> Plan:
        return plan(scenarios[index], planner, radius=radius, config=config, seed=seed, index=index)

    with ThreadPoolExecutor(num_threads) as pool:
        return list(pool.map(one, range(len(scenarios))))


class Lookahead(_navsim.Lookahead):
    """Intermediate goals along paths, for many robots at once.

    A robot's place on its path is the point nearest to it between its last place and one look-ahead distance further
    on, so that it never goes back. Its target lies the look-ahead distance beyond, or is the goal itself where the path
    ends before; without a path it is always the goal.

        guide = Lookahead(plans, goals, distance=1.0)
        targets = guide.update(positions)       # (N, 2) float64, m
        goal = guide.goal(sim.poses)            # (N, 2) float64, m and rad in the robots' frames
        guide.progress                          # (N,) float64, m along the paths

    Args:
        plans: One for each robot.
        goals: (N, 2) float64 centres of the goals, metres.
        distance: Look-ahead distance along the path, metres, up to 1,000.

    Raises:
        ValueError: Plans and goals of different number, or a number out of range.
    """

    def __new__(cls, plans: Sequence[Plan], goals: NDArray[np.float64], *, distance: float) -> Self:
        """Puts every robot at the beginning of its path."""
        return super().__new__(cls, [plan.path for plan in plans], np.asarray(goals, np.float64), distance)

    def goal(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """``update``, as robots see it: what a controller takes for its goal, and a policy has in its observation.

        Args:
            poses: (N, 3) float64: x (m), y (m), yaw (rad).

        Returns:
            (N, 2) float64: distance (m) and angle (rad, in (-pi, pi]) of the intermediate goals in the robots' frames.

        Raises:
            TypeError: Not a float64 array.
            ValueError: Another shape, NaN or infinity; nothing has changed then.
        """
        if poses.ndim != 2 or poses.shape[1] != 3 or not np.isfinite(poses).all():
            raise ValueError(f"poses: expected finite numbers of shape (N, 3), got shape {poses.shape}")
        offset = self.update(poses[:, :2]) - poses[:, :2]
        angle = np.arctan2(offset[:, 1], offset[:, 0]) - poses[:, 2]
        return np.stack([np.hypot(offset[:, 0], offset[:, 1]), np.arctan2(np.sin(angle), np.cos(angle))], axis=1)
