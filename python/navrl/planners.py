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
from dataclasses import asdict
from dataclasses import dataclass as record
from typing import Annotated, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from navrl import _navsim
from navrl.batch import Scenario
from navrl.config import RobotConfig
from navrl.config.faults import one_line
from navrl.config.tree import STRICT

Planner = Literal["astar", "dijkstra", "rrt", "rrtstar", "antcolony", "fmm"]
"""Names of the planners."""
PLANNERS: tuple[Planner, ...] = get_args(Planner)
Status = Literal["found", "no path", "start in collision", "goal in collision", "too coarse", "budget spent"]
"""How a plan ends: see Plan.status."""


def _spacing(value: float) -> float:
    if 0 < value < SPACING_MIN:
        raise ValueError("points that close would be too many")
    return value


SPACING_MIN = 1e-3
"""Least distance (m) of neighbouring points, if there is one."""
_Spacing = Annotated[
    float, Field(ge=0, le=1000, description="0 or a number in [0.001, 1000]"), AfterValidator(_spacing)
]
_Cell = Annotated[float, Field(ge=1e-3, le=100)]
_Crew = Annotated[int, Field(ge=1, le=10_000)]


@one_line
@dataclass(frozen=True, config=STRICT)
class PlannerConfig:
    """Settings of all planners; each reads its own."""

    margin: Annotated[float, Field(ge=0, le=100)] = 0.1
    """Clearance (m) wanted beyond the radius. Where start, goal or every way is narrower, half of it; then none."""
    resolution: _Cell = 0.05
    """Side of a cell (m) of "astar", "dijkstra" and "fmm"; a map has at most 10 million cells."""
    ant_resolution: _Cell = 0.2
    """Side of a cell (m) of "antcolony": on small cells its ants lose their way."""
    step: Annotated[float, Field(ge=1e-3, le=1000)] = 0.5
    """Longest edge (m) of the trees of "rrt" and "rrtstar"."""
    samples: Annotated[int, Field(ge=1, le=10_000_000)] = 5000
    """Samples of "rrtstar"; of "rrt" at most."""
    goal_bias: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Share of the samples of a tree that are the goal; of "rrtstar" until it has a path."""
    ants: _Crew = 32
    """Ants of a round of "antcolony"."""
    rounds: _Crew = 30
    """Rounds of "antcolony"."""
    evaporation: Annotated[float, Field(gt=0, le=1)] = 0.2
    """Share of a trail of the ants that is lost, and set anew along the best ways, in a round."""
    goal_weight: Annotated[float, Field(ge=0, le=20)] = 2.0
    """How strongly the goal draws ants: a step at an angle a from it has the odds exp(goal_weight cos a)."""
    time_limit: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Longest search (s) of "rrt", "rrtstar" and "antcolony"; 0: none, and then a seed always gives the same path."""
    shortcut: bool = True
    """Whether a path is pulled tight."""
    spacing: _Spacing = 0.1
    """Largest distance (m) of neighbouring points of a path, 0 or at least 0.001; 0 leaves its corners only."""


@record(frozen=True, eq=False)
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
    settings = json.dumps(asdict(config or PlannerConfig()))
    status, path, length, clearance, expansions, time = _navsim.plan(scenario, planner, radius, settings, seed, index)
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
