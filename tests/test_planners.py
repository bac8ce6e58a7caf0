"""Planners: every path against a clearance check of another kind, what there is no path for, seeds, and look-ahead."""

import json
import math
import re
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import FrozenInstanceError, asdict, fields
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl import _navsim
from navrl.batch import Scenario, draw_list
from navrl.config import RobotConfig, SimConfig, WorldConfig
from navrl.errors import ConfigError
from navrl.planners import PLANNERS, Lookahead, Plan, Planner, PlannerConfig, Status, plan, plan_all

ROOT = Path(__file__).parent.parent
Points = NDArray[np.float64]
LIGHT = PlannerConfig(samples=1500, ants=8, rounds=8)
"""Less work than the defaults."""
RADIUS = RobotConfig().radius


def corners(scenario: Scenario) -> list[Points]:
    """Corners of every box and polygon, in order."""
    turned = []
    for x, y, yaw, length, width in scenario.boxes:
        c, s = math.cos(yaw), math.sin(yaw)
        signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        halves = [(i * length / 2, j * width / 2) for i, j in signs]
        turned.append(np.array([(x + c * u - s * v, y + s * u + c * v) for u, v in halves]))
    return turned + [np.array(polygon) for polygon in scenario.polygons]


def edges(scenario: Scenario) -> tuple[Points, Points, Points]:
    """Both ends of every edge (E, 2), a circle being one without length, and the distance (E,) that it adds."""
    rows = [(*wall, 0.0) for wall in scenario.segments] + [(x, y, x, y, r) for x, y, r in scenario.circles]
    for solid in corners(scenario):
        ends = np.hstack([solid, np.roll(solid, -1, axis=0)])
        rows += [(*row, 0.0) for row in ends.tolist()]
    table = np.array(rows).reshape(-1, 5)
    return table[:, :2], table[:, 2:4], table[:, 4]


def to_segments(points: Points, a: Points, b: Points) -> Points:
    """Distances (P, S) of points from segments."""
    along, offset = b - a, points[:, None] - a
    square = np.maximum((along**2).sum(-1), 1e-300)
    share = np.clip((offset * along).sum(-1) / square, 0, 1)
    return np.linalg.norm(offset - share[..., None] * along, axis=-1)


def turn(a: Points, b: Points, c: Points) -> Points:
    """z of (b - a) x (c - a)."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def path_clearance(scenario: Scenario, path: Points) -> float:
    """Distance from a path to the nearest shape; 0 if it touches or enters one."""
    a, b, grown = edges(scenario)
    if not len(a):
        return math.inf
    p, q = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
    nearest = np.minimum(to_segments(p, a, b), to_segments(q, a, b))
    nearest = np.minimum(nearest, np.minimum(to_segments(a, p, q), to_segments(b, p, q)).T)
    p, q = p[:, None], q[:, None]
    crossing = (turn(p, q, a) * turn(p, q, b) < 0) & (turn(a, b, p) * turn(a, b, q) < 0)
    for solid in corners(scenario):
        sides = turn(solid, np.roll(solid, -1, axis=0), path[:, None])
        if ((sides > 0).all(axis=1) | (sides < 0).all(axis=1)).any():
            return 0.0
    return float(np.where(crossing, 0.0, nearest - grown).min())


def check(scenario: Scenario, found: Plan) -> None:
    """What makes a path one."""
    path = found.path
    assert path.shape[1] == 2
    assert path.dtype == np.float64
    assert path[0].tolist() == list(scenario.start[:2])
    assert math.dist(path[-1], scenario.goal) < scenario.goal_radius
    assert path_clearance(scenario, path) >= found.clearance
    assert found.length == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).sum(), rel=1e-12)


def room(half: float = 3.0) -> list[list[float]]:
    """Four walls."""
    h = half
    return [[-h, -h, h, -h], [h, -h, h, h], [h, h, -h, h], [-h, h, -h, -h]]


def scenario(**changes: Any) -> Scenario:  # noqa: ANN401 - the keys of a scenario
    """A box between start and goal in a room."""
    values = {
        "start": (-2.5, 0.1, 0.0),
        "goal": (2.5, 0.0),
        "goal_radius": 0.3,
        "time_limit": 50.0,
        "segments": room(),
        "boxes": [(0.0, 0.0, 0.4, 1.5, 1.0)],
    }
    return Scenario(**(values | changes))


def user_worlds(count: int) -> list[Scenario]:
    """Circles, boxes, walls and triangles at random, some of them overlapping, some around the start or the goal."""
    random = np.random.Generator(np.random.Philox(5))
    worlds = []
    for _ in range(count):
        centers = random.uniform(-2.8, 2.8, (12, 2))
        angles = random.uniform(-math.pi, math.pi, 12)
        circles = [(x, y, random.uniform(0.05, 0.5)) for x, y in centers[:4]]
        boxes = [(x, y, yaw, *random.uniform(0.2, 1.0, 2)) for (x, y), yaw in zip(centers[4:7], angles, strict=False)]
        walls = [(x, y, x + math.cos(t), y + math.sin(t)) for (x, y), t in zip(centers[7:9], angles, strict=False)]
        triangles = [
            [(x + 0.5 * math.cos(t + k), y + 0.5 * math.sin(t + k)) for k in (0.0, 2.0, 4.0)]
            for (x, y), t in zip(centers[9:], angles, strict=False)
        ]
        start, goal = random.uniform(-2.7, 2.7, (2, 2))
        shapes = {"circles": circles, "boxes": boxes, "segments": [*room(), *walls], "polygons": triangles}
        worlds.append(scenario(start=(*start, 0.0), goal=tuple(goal), **shapes))
    return worlds


WORLDS = {
    "td3": lambda: draw_list(SimConfig(), "tuning", 150),
    "boxes": lambda: draw_list(SimConfig(world=WorldConfig(name="boxes", boxes=16)), "tuning", 150),
    "own": lambda: user_worlds(150),
}


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("world", WORLDS)
def test_every_path_is_clear(world: str, planner: Planner) -> None:
    scenarios = WORLDS[world]()
    plans = plan_all(scenarios, planner, config=LIGHT, num_threads=2)
    for task, found in zip(scenarios, plans, strict=True):
        shortest = _navsim.shortest_path(task, RADIUS)
        if found.found:
            check(task, found)
            assert shortest is not None
            assert found.length > shortest - 1e-9
            assert RADIUS <= found.clearance <= RADIUS + LIGHT.margin
        else:
            assert found.path.shape == (0, 2)
            assert found.length == math.inf
            assert (shortest is None) == (found.status not in ("too coarse", "budget spent"))
    counts = Counter(found.status for found in plans)
    missed = counts["too coarse"] + counts["budget spent"]
    assert missed <= (0 if planner in ("astar", "dijkstra", "fmm") and world != "own" else 8), counts
    assert counts["found"] > (60 if world == "own" else 140), counts


def test_the_check_itself() -> None:
    task = scenario(circles=[(0.0, 2.0, 0.5)], polygons=[[(2, 2), (2.5, 2), (2, 2.5)]])
    assert path_clearance(task, np.array([(-2.0, 1.2), (2.0, 1.2)])) == pytest.approx(0.3)
    assert path_clearance(task, np.array([(-2.0, 0.0), (2.0, 0.0)])) == 0.0
    assert path_clearance(task, np.array([(0.1, 0.0)])) == 0.0
    assert path_clearance(task, np.array([(2.75, 0.0), (2.75, 1.0)])) == pytest.approx(0.25)
    assert path_clearance(task, np.array([(1.9, 0.0), (1.9, 2.9)])) == pytest.approx(0.1)
    assert path_clearance(scenario(boxes=[], segments=[]), np.array([(0.0, 0.0), (1.0, 0.0)])) == math.inf


@pytest.mark.parametrize("planner", PLANNERS)
def test_what_there_is_no_path_for(planner: Planner) -> None:
    def status(**changes: object) -> str:
        return plan(scenario(**changes), planner, config=LIGHT).status

    assert status() == "found"
    assert status(start=(0.6, 0.1, 0.0)) == "start in collision"
    assert status(goal=(0.0, 0.0)) == "goal in collision"
    assert status(goal=(0.0, 3.6)) == "no path"
    assert status(segments=[], boxes=[]) == "found"
    assert status(goal=(-2.4, 0.1)) == "found"
    assert status(circles=[(-2.5, 0.1, 1e-3)]) == "start in collision"


@pytest.mark.parametrize("planner", ["astar", "fmm", "antcolony"])
def test_cells_that_are_too_large_are_named_as_the_reason(planner: Planner) -> None:
    gap = scenario(boxes=[], segments=[*room(), [0, -3, 0, 0.11], [0, 0.63, 0, 3]])
    found = plan(gap, planner, config=PlannerConfig(resolution=0.3, ant_resolution=0.3))
    assert (found.status, len(found.path)) == ("too coarse", 0)
    check(gap, plan(gap, planner, config=PlannerConfig(resolution=0.02, ant_resolution=0.02, ants=4, rounds=2)))


def test_a_budget_ends_a_search() -> None:
    found = plan(scenario(), "rrt", config=PlannerConfig(samples=3, step=0.2))
    assert (found.status, found.expansions) == ("budget spent", 3)


def test_a_margin_shrinks_to_what_there_is_room_for() -> None:
    clearances = {}
    for gap in (2.0, 0.62, 0.52):
        walls = [*room(), [0, -3, 0, -gap / 2], [0, gap / 2, 0, 3]]
        clearances[gap] = plan(scenario(boxes=[], segments=walls), config=PlannerConfig(margin=0.1)).clearance
    assert list(clearances.values()) == pytest.approx([0.35, 0.30, 0.25], abs=1e-12)


@pytest.mark.parametrize("planner", ["rrt", "rrtstar", "antcolony"])
def test_a_seed_and_an_index_name_a_path(planner: Planner) -> None:
    scenarios = draw_list(SimConfig(), "tuning", 6)
    alone = [plan(task, planner, config=LIGHT, seed=3, index=i).path for i, task in enumerate(scenarios)]
    together = [found.path for found in plan_all(scenarios, planner, config=LIGHT, seed=3, num_threads=3)]
    assert all(np.array_equal(one, other) for one, other in zip(alone, together, strict=True))
    blocked = next(task for task in scenarios if _navsim.needs_detour(task, RADIUS))
    raw = PlannerConfig(samples=1500, ants=8, rounds=8, shortcut=False)
    first, *others = [
        plan(blocked, planner, config=raw, seed=seed, index=i).path for seed, i in ((3, 0), (4, 0), (3, 1))
    ]
    assert len(first) > 1
    assert not any(np.array_equal(first, other) for other in others)


def test_more_samples_never_make_a_path_longer() -> None:
    for index, task in enumerate(draw_list(SimConfig(), "tuning", 8)):
        counts = (50, 100, 300, 1000, 3000)
        settings = [PlannerConfig(samples=count, shortcut=False, margin=0.0) for count in counts]
        lengths = [plan(task, "rrtstar", config=one, index=index).length for one in settings]
        assert lengths == sorted(lengths, reverse=True)
        assert lengths[-1] < 1.1 * (_navsim.shortest_path(task, RADIUS) or 0.0)


def test_other_threads_run_during_a_plan() -> None:
    settings = PlannerConfig(samples=10_000_000, time_limit=0.4)
    thread = threading.Thread(target=plan, args=(scenario(), "rrtstar"), kwargs={"config": settings})
    thread.start()
    turns = 0
    while thread.is_alive():
        turns += 1
        thread.join(0.001)
    assert turns > 50


def test_a_plan_cannot_be_changed() -> None:
    found = plan(scenario())
    with pytest.raises(FrozenInstanceError):
        found.length = 0.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        found.path[0, 0] = 0.0


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"resolution": 0.0}, "resolution = 0.0: must be a number in [0.001, 100]"),
    ({"margin": -0.1}, "margin = -0.1: must be a number in [0, 100]"),
    ({"samples": 0}, "samples = 0: must be a whole number in [1, 10_000_000]"),
    ({"samples": 1.5}, "samples = 1.5: must be a whole number in [1, 10_000_000]"),
    ({"goal_bias": 1.0}, "goal_bias = 1.0: must be a number in [0, 1)"),
    ({"ants": "many"}, 'ants = "many": must be a whole number in [1, 10_000]'),
    ({"shortcut": 1}, "shortcut = 1: must be true or false"),
    ({"step": math.nan}, "step = nan: must be a number in [0.001, 1000]"),
    ({"spacing": 1e-9}, "spacing = 1e-09: must be 0 or a number in [0.001, 1000]"),
    ({"sample": 5}, "sample: no such setting; did you mean samples?"),
    ({"zzz": 5}, "zzz: no such setting; PlannerConfig has margin, resolution,"),
]


@pytest.mark.parametrize(("settings", "line"), REFUSED, ids=[line.split(":")[0] for _, line in REFUSED])
def test_settings_that_cannot_be(settings: dict[str, Any], line: str) -> None:
    with pytest.raises(ConfigError) as caught:
        PlannerConfig(**settings)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_the_core_takes_what_python_takes() -> None:
    here = scenario(goal=(-2.5, 0.1))
    lows = PlannerConfig(0.0, 1e-3, 1e-3, 1e-3, 1, 0.0, 1, 1, 1e-300, 0.0, 0.0, False, 0.0)
    highs = PlannerConfig(100.0, 100.0, 100.0, 1e3, 10**7, 1 - 1e-15, 10**4, 10**4, 1.0, 20.0, 1e6, True, 1e3)
    for settings in (lows, highs, PlannerConfig(spacing=1e-3)):
        assert plan(here, config=settings).found
    known = asdict(PlannerConfig())
    assert [field.name for field in fields(PlannerConfig)] == list(known)
    for broken in (known | {"more": 1}, {key: value for key, value in known.items() if key != "step"}):
        with pytest.raises(ValueError, match="planner: "):
            _navsim.plan(here, "astar", 0.25, json.dumps(broken), 0, 0)


def test_the_page_says_what_is_so() -> None:
    page = (ROOT / "docs/plan-on-your-own-world.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| `([\w.]+)` \|", page, re.MULTILINE)
    assert rows == [(name, str(value)) for name, value in asdict(PlannerConfig()).items()]
    statuses = re.findall(r"^\| `([a-z ]+)` \| (?!`)", page.split("## Which planner")[0], re.MULTILINE)
    assert tuple(statuses) == get_args(Status)
    lines = (ROOT / "docs/examples/office.jsonl").read_text(encoding="utf-8").splitlines()
    with pytest.raises(ValueError, match="resolution") as refusal:
        plan(Scenario.from_json(lines[3]), config=PlannerConfig(resolution=1e-3))
    assert f"    {refusal.value}\n" in page


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"planner": "a*"}, "planner = 'a*': expected one of astar, dijkstra, rrt, rrtstar, antcolony, fmm"),
        ({"radius": 0.0}, "radius = 0: expected a number above 0"),
        ({"radius": math.nan}, "radius = NaN: expected a number above 0"),
        ({"radius": 2000.0}, "radius = 2000.1: expected radius and margin together in (0, 1000]"),
        ({"seed": -1}, "seed = -1: expected 0 to "),
        ({"index": 2**32}, "index = 4294967296: expected 0 to "),
        (
            {"config": PlannerConfig(resolution=1e-3)},
            "resolution = 0.001: expected at least 0.003 m: a map of this world",
        ),
    ],
)
def test_arguments_that_cannot_be(arguments: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match=re.escape(line)) as caught:
        plan(scenario(), **arguments)
    assert "\n" not in str(caught.value)


def test_a_huge_world_is_refused_or_planned_but_never_too_large() -> None:
    huge = scenario(start=(-900, -900, 0), goal=(900, 900), segments=room(1000), boxes=[(0, 0, 0.3, 500, 500)])
    with pytest.raises(ValueError, match=r"resolution = 0.05: expected at least 0\.\d+ m: a map of this world, 2001"):
        plan(huge)
    coarse = PlannerConfig(resolution=5.0, ant_resolution=20.0, step=50.0, spacing=0.0)
    for planner in PLANNERS:
        found = plan(huge, planner, config=coarse)
        assert found.found, planner
        check(huge, found)


# Look-ahead


def follow(task: Scenario, found: Plan, distance: float, steps: int) -> tuple[list[float], Points]:
    """Drives a point 0.05 m a step straight at its target: progress after each step, and where it ends."""
    guide = Lookahead([found], np.array([task.goal]), distance=distance)
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
    for task, found in zip(scenarios, plan_all(scenarios, "fmm", num_threads=2), strict=True):
        if found.found:
            progress, end = follow(task, found, 0.5, int(found.length / 0.05) + 40)
            assert progress == sorted(progress)
            assert math.dist(end, task.goal) < task.goal_radius
            assert progress[-1] > found.length - 0.5


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
    found = plan(scenario())
    guide = Lookahead([found, found], np.array([(2.5, 0.0)] * 2), distance=1.0)
    guide.update(np.array([found.path[5], found.path[9]]))
    before = guide.progress
    with pytest.raises(error, match="positions"):
        guide.update(positions)
    assert guide.progress.tolist() == before.tolist()
    assert before[0] > 0


def test_strides_do_not_matter() -> None:
    found = plan(scenario())
    sparse = np.zeros((2, 4))
    sparse[:, ::2] = [found.path[5], found.path[9]]
    guides = [Lookahead([found, found], np.array([(2.5, 0.0)] * 2), distance=1.0) for _ in range(2)]
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
    found = plan(scenario())
    with pytest.raises(ValueError, match=re.escape(line)):
        Lookahead([found] * plans, np.array(goals), distance=distance)
