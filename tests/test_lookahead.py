"""Intermediate goals along paths: known by hand, for who follows them, and from the robots' point of view."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from navrl.batch import Scenario
from navrl.planners import Lookahead, Plan, plan, plan_all
from planning import WORLDS, Points, scenario


def follow(task: Scenario, route: Plan, distance: float, steps: int) -> tuple[list[float], Points]:
    """Drives a point 0.05 m a step straight at its target: progress after each step, and where it ends."""
    guide = Lookahead([route], np.array([task.goal]), distance=distance)
    place, progress = np.array([task.start[:2]]), []
    for _ in range(steps):
        offset = guide.update(place) - place
        away = np.linalg.norm(offset)
        place = place + offset * min(1.0, 0.05 / max(away, 1e-9))
        progress.append(float(guide.progress[0]))
    return progress, place[0]


@pytest.mark.parametrize("world", WORLDS)
def test_who_follows_the_targets_reaches_the_goal(world: str) -> None:
    scenarios = WORLDS[world]()[:40]
    for task, route in zip(scenarios, plan_all(scenarios, "fmm", num_threads=2), strict=True):
        if route.found:
            progress, end = follow(task, route, 0.5, int(route.length / 0.05) + 40)
            assert progress == sorted(progress)
            assert math.dist(end, task.goal) < task.goal_radius
            assert progress[-1] > route.length - 0.5


def test_targets_by_hand() -> None:
    corner = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)])
    bent = Plan("found", corner, 7.0, 0.25, 0, 0.0)
    none = Plan("no path", np.zeros((0, 2)), math.inf, 0.25, 0, 0.0)
    guide = Lookahead([bent, none, bent], np.array([(4.0, 3.2), (9.0, 9.0), (4.0, 3.2)]), distance=1.5)
    targets = guide.update(np.array([(0.0, 0.0), (1.0, 1.0), (1.0, 0.7)]))
    assert targets.tolist() == [[1.5, 0.0], [9.0, 9.0], [2.5, 0.0]]
    assert guide.progress.tolist() == [0.0, 0.0, 1.0]
    guide.update(np.array([(1.4, 0.0), (1.0, 1.0), (2.4, 0.0)]))
    targets = guide.update(np.array([(0.0, 0.0), (2.0, 2.0), (3.5, -0.2)]))
    np.testing.assert_allclose(targets, [(2.9, 0.0), (9.0, 9.0), (4.0, 1.0)], atol=1e-12)
    np.testing.assert_allclose(guide.progress, [1.4, 0.0, 3.5], atol=1e-12)


@pytest.mark.parametrize(
    ("positions", "error"),
    [
        (np.zeros((1, 2)), ValueError),
        (np.zeros((2, 3)), ValueError),
        (np.zeros((2, 2), np.float32), TypeError),
        ([[0.0, 0.0], [0.0, 0.0]], TypeError),
        (np.array([[0.0, 0.0], [math.nan, 0.0]]), ValueError),
    ],
)
def test_positions_that_cannot_be(positions: Any, error: type[Exception]) -> None:  # noqa: ANN401 - that is the point
    route = plan(scenario())
    guide = Lookahead([route, route], np.array([(2.5, 0.0)] * 2), distance=1.0)
    guide.update(np.array([route.path[5], route.path[9]]))
    before = guide.progress
    with pytest.raises(error, match="positions"):
        guide.update(positions)
    assert guide.progress.tolist() == before.tolist()
    assert before[0] > 0


def test_strides_do_not_matter() -> None:
    route = plan(scenario())
    sparse = np.zeros((2, 4))
    sparse[:, ::2] = [route.path[5], route.path[9]]
    guides = [Lookahead([route, route], np.array([(2.5, 0.0)] * 2), distance=1.0) for _ in range(2)]
    answers = [
        guide.update(array) for guide, array in zip(guides, (sparse[:, ::2], sparse[:, ::2].copy()), strict=True)
    ]
    assert np.array_equal(*answers)


@pytest.mark.parametrize(
    ("plans", "goals", "distance", "line"),
    [
        (1, [(1.0, 1.0)], 0.0, "distance = 0: expected a number in (0, 1000]"),
        (2, [(1.0, 1.0)], 1.0, "goals: expected 2 elements, got 1"),
        (1, [(1.0, math.inf)], 1.0, "goals: expected finite numbers, got inf for robot 0"),
        (1, [(1.0, 1.0, 1.0)], 1.0, "goals: expected shape [1, 2], got [1, 3]"),
    ],
)
def test_guides_that_cannot_be(plans: int, goals: Sequence[Any], distance: float, line: str) -> None:
    route = plan(scenario())
    with pytest.raises(ValueError, match=re.escape(line)):
        Lookahead([route] * plans, np.array(goals), distance=distance)


def test_goals_as_robots_see_them() -> None:
    path = np.array([(0.0, 0.0), (4.0, 0.0)])
    poses = np.array([(1.0, 0.0, 0.0), (1.0, 0.0, math.pi / 2), (1.0, 1.0, -math.pi / 4), (1.0, 1.0, 3.0 * math.pi)])
    guide = Lookahead([Plan("found", path, 4.0, 0.25, 0, 0.0)] * 4, np.array([(4.0, 0.0)] * 4), distance=1.0)
    # The robots' places on the path are at 1 m, the intermediate goals at (2, 0).
    expected = [(1.0, 0.0), (1.0, -math.pi / 2), (math.sqrt(2), 0.0), (math.sqrt(2), 0.75 * math.pi)]
    np.testing.assert_allclose(guide.goal(poses), expected, atol=1e-12)
    assert guide.progress.tolist() == [1.0] * 4
    for broken in (
        poses[:, :2],
        poses[0],
        np.full((4, 3), math.nan),
        poses + np.array([2.0, 0.0, math.inf]),
        poses[:3] + 2.0,
    ):
        with pytest.raises(ValueError, match=r"(poses|positions): expected"):
            guide.goal(broken)
    assert guide.progress.tolist() == [1.0] * 4
