"""Planners: every path against a clearance check of another kind, what there is no path for, seeds and settings."""

import json
import math
import re
import sys
import threading
from collections import Counter
from dataclasses import FrozenInstanceError, asdict
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from navrl import _navsim
from navrl.batch import Scenario, draw_list
from navrl.config import Config, PlannerConfig, SimConfig
from navrl.errors import ConfigError
from navrl.planners import PLANNERS, Planner, Status, plan, plan_all
from planning import RADIUS, WORLDS, check, path_clearance, room, scenario

ROOT = Path(__file__).parent.parent
LIGHT = PlannerConfig(samples=1500, ants=8, rounds=8)
"""Less work than the defaults."""


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("world", WORLDS)
def test_every_path_is_clear(world: str, planner: Planner) -> None:
    scenarios = WORLDS[world]()
    plans = plan_all(scenarios, planner, config=LIGHT, num_threads=2)
    for task, route in zip(scenarios, plans, strict=True):
        shortest = _navsim.shortest_path(task, RADIUS)
        if route.found:
            check(task, route)
            assert shortest is not None
            assert route.length > shortest - 1e-9
            assert RADIUS <= route.clearance <= RADIUS + LIGHT.margin
        else:
            assert route.path.shape == (0, 2)
            assert route.length == math.inf
            assert (shortest is None) == (route.status not in ("too coarse", "budget spent"))
    counts = Counter(route.status for route in plans)
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
    route = plan(gap, planner, config=PlannerConfig(resolution=0.3, ant_resolution=0.3))
    assert (route.status, len(route.path)) == ("too coarse", 0)
    check(gap, plan(gap, planner, config=PlannerConfig(resolution=0.02, ant_resolution=0.02, ants=4, rounds=2)))


def test_a_budget_ends_a_search() -> None:
    route = plan(scenario(), "rrt", config=PlannerConfig(samples=3, step=0.2))
    assert (route.status, route.expansions) == ("budget spent", 3)


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
    together = [route.path for route in plan_all(scenarios, planner, config=LIGHT, seed=3, num_threads=3)]
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
    ran: list[int] = []
    gate = threading.Lock()
    gate.acquire()
    thread = threading.Thread(target=lambda: gate.acquire() and ran.append(1), daemon=True)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(600)  # this thread keeps the interpreter lock until it hands it over by itself
    try:
        thread.start()
        gate.release()
        assert sum(range(10**6))
        assert not ran
        plans = 0
        while not ran and plans < 1000:
            plan(scenario(), "rrtstar")
            plans += 1
        assert ran
    finally:
        sys.setswitchinterval(interval)
    thread.join()


def test_a_plan_cannot_be_changed() -> None:
    route = plan(scenario())
    with pytest.raises(FrozenInstanceError):
        route.length = 0.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        route.path[0, 0] = 0.0


UNIT, CELL, CREW = "must be a number in", "must be a number in [0.001, 100]", "must be a whole number in [1, 10_000]"
SAMPLES, SPACING = "must be a whole number in [1, 10_000_000]", "must be 0 or a number in [0.001, 1000]"
REFUSED: list[tuple[str, object, str]] = [
    ("margin", -5e-324, f"{UNIT} [0, 100]"),
    ("margin", math.nextafter(100, 101), f"{UNIT} [0, 100]"),
    ("resolution", math.nextafter(1e-3, 0), CELL),
    ("resolution", math.nextafter(100, 101), CELL),
    ("ant_resolution", math.nextafter(1e-3, 0), CELL),
    ("ant_resolution", math.nextafter(100, 101), CELL),
    ("step", math.nextafter(1e-3, 0), f"{UNIT} [0.001, 1000]"),
    ("step", math.nextafter(1000, 1001), f"{UNIT} [0.001, 1000]"),
    ("step", math.nan, f"{UNIT} [0.001, 1000]"),
    ("samples", 0, SAMPLES),
    ("samples", 10_000_001, SAMPLES),
    ("samples", 1.5, SAMPLES),
    ("goal_bias", -5e-324, f"{UNIT} [0, 1)"),
    ("goal_bias", 1.0, f"{UNIT} [0, 1)"),
    ("ants", 0, CREW),
    ("ants", 10_001, CREW),
    ("ants", "many", CREW),
    ("rounds", 0, CREW),
    ("rounds", 10_001, CREW),
    ("evaporation", 0.0, f"{UNIT} (0, 1]"),
    ("evaporation", math.nextafter(1, 2), f"{UNIT} (0, 1]"),
    ("goal_weight", -5e-324, f"{UNIT} [0, 20]"),
    ("goal_weight", math.nextafter(20, 21), f"{UNIT} [0, 20]"),
    ("time_limit", -5e-324, f"{UNIT} [0, 1_000_000]"),
    ("time_limit", math.nextafter(1e6, 2e6), f"{UNIT} [0, 1_000_000]"),
    ("shortcut", 1, "must be true or false"),
    ("spacing", -5e-324, SPACING),
    ("spacing", 5e-324, SPACING),
    ("spacing", math.nextafter(1e-3, 0), SPACING),
    ("spacing", math.nextafter(1000, 1001), SPACING),
    ("sample", 5, "no such key; did you mean planner.samples?"),
]
"""Keys, values just outside of their ranges, and what is said of them."""


@pytest.mark.parametrize(("key", "value", "words"), REFUSED)
def test_settings_that_cannot_be(key: str, value: object, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        PlannerConfig(**{key: value})  # type: ignore[arg-type]
    shown = f" = {json.dumps(value) if isinstance(value, str) else value}" if key != "sample" else ""
    assert str(caught.value) == f"planner.{key}{shown}: {words}"


def test_the_core_takes_what_python_takes() -> None:
    here = scenario(goal=(-2.5, 0.1))
    lows = PlannerConfig(0.0, 1e-3, 1e-3, 1e-3, 1, 0.0, 1, 1, 1e-300, 0.0, 0.0, False, 0.0)
    highs = PlannerConfig(100.0, 100.0, 100.0, 1e3, 10**7, 1 - 1e-15, 10**4, 10**4, 1.0, 20.0, 1e6, True, 1e3)
    for settings in (lows, highs, PlannerConfig(spacing=1e-3)):
        assert plan(here, config=settings).found
    known = asdict(PlannerConfig())
    for broken in (known | {"more": 1}, {key: value for key, value in known.items() if key != "step"}):
        with pytest.raises(ValueError, match="planner: "):
            _navsim.plan(here, "astar", 0.25, json.dumps(broken), 0, 0)


def test_the_core_tests_and_benches_use_these_settings() -> None:
    text = (ROOT / "crates/navsim/tests/planner.json").read_text(encoding="utf-8")
    # The look-ahead distance is not planned with.
    assert json.loads(text) | {"lookahead": 1.0} == asdict(Config().planner)


def test_the_page_says_what_is_so() -> None:
    page = (ROOT / "docs/plan-on-your-own-world.md").read_text(encoding="utf-8")
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
        ({"radius": 0.0}, "radius = 0: expected in (0, 1000] m"),
        ({"radius": math.nan}, "radius = NaN: expected in (0, 1000] m"),
        ({"radius": 2000.0}, "radius = 2000: expected in (0, 1000] m"),
        ({"seed": -1}, "seed = -1: expected 0 to "),
        ({"index": 2**32}, "index = 4294967296: expected 0 to "),
        (
            {"config": PlannerConfig(resolution=1e-3)},
            "planner.resolution = 0.001: expected at least 0.003 m: a map of this world",
        ),
    ],
)
def test_arguments_that_cannot_be(arguments: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match=re.escape(line)) as caught:
        plan(scenario(), **arguments)
    assert "\n" not in str(caught.value)


def test_a_huge_world_is_refused_or_planned_but_never_too_large() -> None:
    huge = scenario(start=(-900, -900, 0), goal=(900, 900), segments=room(1000), boxes=[(0, 0, 0.3, 500, 500)])
    with pytest.raises(ValueError, match=r"planner.resolution = 0.05: expected at least 0\.\d+ m: a map of this"):
        plan(huge)
    coarse = PlannerConfig(resolution=5.0, ant_resolution=20.0, step=50.0, spacing=0.0)
    for planner in PLANNERS:
        route = plan(huge, planner, config=coarse)
        assert route.found, planner
        check(huge, route)
