"""Scenario lists: what is drawn, what is read, what is refused, and the lengths of their shortest paths."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from navrl import _navsim, length_cache, scenarios
from navrl.batch import Scenario
from navrl.config import LidarConfig, RobotConfig, SimConfig, TaskConfig, WorldConfig
from navrl.scenarios import (
    LIST_SIZES,
    SHIPPED_WORLDS,
    ScenarioError,
    given_list,
    hash_scenarios,
    load_list,
    measure_lengths,
    read_list,
    robot_radius,
    shortest_lengths,
)

ALL = os.environ.get("NAVRL_FULL") == "1"
"""Whether to run the full counts."""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def scenario(x: float = 0.0, goal: float = 3.0, **changes: object) -> Scenario:
    values = {"start": (x, 0.0, 0.0), "goal": (goal, 0.0), "goal_radius": 0.3, "time_limit": 50.0} | changes
    return Scenario(**values)  # type: ignore[arg-type]


def write_lines(file: Path, *lines: str) -> Path:
    file.write_text("".join(line + "\n" for line in lines), encoding="utf-8")
    return file


# Built-in lists


def test_sizes_of_the_lists() -> None:
    assert LIST_SIZES == {"tuning": 500, "validation": 1000, "test": 1000, "final": 4000}
    assert len(load_list(SimConfig(), "tuning")) == 500


def test_lists_share_no_scenario_and_do_not_change() -> None:
    lists = {name: load_list(SimConfig(), name, count=50) for name in LIST_SIZES}
    everything = [s.to_json() for drawn in lists.values() for s in drawn.scenarios]
    assert len(set(everything)) == 200
    for name, drawn in lists.items():
        again = load_list(SimConfig(), name, count=50)
        assert (again.sha256, again.name) == (drawn.sha256, name)
        assert np.array_equal(again.shortest, drawn.shortest)


def test_a_shorter_list_is_the_beginning_of_the_longer() -> None:
    longer, shorter = (load_list(SimConfig(), "test", count=count) for count in (30, 10))
    assert shorter.scenarios == longer.scenarios[:10]
    assert np.array_equal(shorter.shortest, longer.shortest[:10])
    assert shorter.sha256 == longer.first(10).sha256 != longer.sha256


def test_training_settings_do_not_change_a_list() -> None:
    plain = load_list(SimConfig(), "test", count=20)
    other = SimConfig(world=WorldConfig(goal_range_start=5.0, goal_range_growth=0.1), lidar=LidarConfig(noise=0.1))
    assert load_list(other, "test", count=20).sha256 == plain.sha256


def test_goal_radius_and_time_limit_of_the_task_are_those_of_the_scenarios() -> None:
    drawn = load_list(SimConfig(task=TaskConfig(goal_radius=0.4, time_limit=30.0)), "test", count=3)
    assert {(s.goal_radius, s.time_limit) for s in drawn.scenarios} == {(0.4, 30.0)}


@pytest.mark.parametrize(("count", "name"), [(0, "test"), (1001, "test"), (501, "tuning")])
def test_a_list_has_no_more_than_it_has(count: int, name: str) -> None:
    with pytest.raises(ScenarioError, match=f"{count} scenarios of the list {name}"):
        load_list(SimConfig(), name, count=count)  # type: ignore[arg-type]


def test_an_unknown_list_is_refused() -> None:
    with pytest.raises(ScenarioError, match="list exam: expected tuning, validation, test, final"):
        load_list(SimConfig(), "exam")  # type: ignore[arg-type]


@pytest.mark.parametrize("world", SHIPPED_WORLDS, ids=lambda world: f"{world.name}{world.boxes}")
def test_the_lengths_that_ship_are_those_of_the_lists(world: WorldConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    sim = SimConfig(world=world)
    every = 1 if ALL else 97

    def never(*_: object, **__: object) -> None:
        raise AssertionError("a length of a built-in list does not ship")

    with monkeypatch.context() as context:
        context.setattr(scenarios, "shortest_lengths", never)
        lists = [load_list(sim, name) for name in LIST_SIZES]
    for drawn in lists:
        checked = range(0, len(drawn), every)
        computed = measure_lengths([drawn.scenarios[i] for i in checked], robot_radius(sim), num_threads=2)
        np.testing.assert_allclose(drawn.shortest[::every], computed, rtol=1e-6)


# Shortest paths


def test_lengths_of_straight_ways() -> None:
    """To the goal circle, so the goal radius is not part of the way; errors stay under 0.3 %."""
    lengths = shortest_lengths([scenario(), scenario(goal=-6.0), scenario(goal_radius=1.0)], 0.25)
    assert lengths == pytest.approx([2.7, 5.7, 2.0], rel=0.003)


def test_a_wall_is_driven_round_at_the_robots_radius() -> None:
    """A thin wall of half height 1 m across the way: two tangents to the disc of the robot's radius round its end, and
    an arc between them."""
    wall = scenario(-3.0, 3.0, segments=[(0.0, -1.0, 0.0, 1.0)], goal_radius=0.1)
    to_end = math.sqrt(10.0)
    for radius in (0.2, 0.4):
        tangent = math.sqrt(to_end**2 - radius**2)
        # Seen from the wall's end: a full turn, less the angle from start to goal below, less those to the tangents.
        arc = 2 * math.pi - 2 * math.atan2(3.0, 1.0) - 2 * math.acos(radius / to_end)
        assert shortest_lengths([wall], radius)[0] == pytest.approx(2 * tangent + radius * arc - 0.1, rel=0.003)


def test_given_lengths_are_taken_as_they_are() -> None:
    assert shortest_lengths([scenario(shortest=2.5)], 0.25).tolist() == [2.5]


def test_unreachable_goals_are_infinitely_far() -> None:
    cage = [(2.0, -1.0, 2.0, 1.0), (4.0, -1.0, 4.0, 1.0), (2.0, -1.0, 4.0, -1.0), (2.0, 1.0, 4.0, 1.0)]
    assert shortest_lengths([scenario(segments=cage)], 0.25).tolist() == [math.inf]


def test_the_radius_of_a_rectangle_is_that_of_its_corners() -> None:
    assert robot_radius(SimConfig(robot=RobotConfig(footprint="rectangle", length=0.6, width=0.8))) == 0.5
    assert robot_radius(SimConfig(robot=RobotConfig(radius=0.3))) == 0.3


# The cache


def test_lengths_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    compute = _navsim.shortest_path

    def counting(given: Scenario, radius: float) -> float | None:
        calls.append(radius)
        return compute(given, radius)

    monkeypatch.setattr(_navsim, "shortest_path", counting)
    first = shortest_lengths([scenario(), scenario(goal=4.0)], 0.25)
    assert len(calls) == 2
    assert np.array_equal(shortest_lengths([scenario(goal=4.0), scenario()], 0.25), first[::-1])
    assert len(calls) == 2
    shortest_lengths([scenario()], 0.3)
    assert calls == [0.25, 0.25, 0.3]
    shortest_lengths([scenario(goal_radius=0.2)], 0.25)
    assert len(calls) == 4


def test_a_damaged_cache_does_no_harm() -> None:
    expected = shortest_lengths([scenario()], 0.25)
    length_cache.cache_file().write_bytes(b"not a database" * 100)
    assert np.array_equal(shortest_lengths([scenario()], 0.25), expected)


def test_a_cache_that_cannot_be_written_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert shortest_lengths([scenario()], 0.25) == pytest.approx([2.7], rel=0.003)


def test_values_that_are_no_lengths_are_not_believed() -> None:
    shortest_lengths([scenario()], 0.25)
    import sqlite3
    from contextlib import closing

    with closing(sqlite3.connect(length_cache.cache_file())) as database, database:
        database.execute("UPDATE lengths SET length = -1.0")
    assert shortest_lengths([scenario()], 0.25) == pytest.approx([2.7], rel=0.003)


# Files


def test_a_file_reads_back(tmp_path: Path) -> None:
    written = [scenario(), scenario(goal=2.0, circles=[(5.0, 5.0, 0.5)]), scenario(boxes=[(0.0, 3.0, 0.1, 1.0, 2.0)])]
    lines = [s.to_json() for s in written]
    file = write_lines(tmp_path / "list.jsonl", lines[0], "", lines[1], lines[2])
    drawn = read_list(file, SimConfig())
    assert list(drawn.scenarios) == written
    assert (drawn.name, drawn.sha256) == (str(file), hash_scenarios(written))
    assert drawn.shortest == pytest.approx([2.7, 1.7, 2.7], rel=0.003)


BAD_LINES = {
    "{": "",
    '{"start": [0, 0, 0]}': "goal",
    scenario().to_json()[:-1] + ', "colour": 3}': "colour",
    scenario(circles=[(0.1, 0.0, 0.3)]).to_json(): "",
    scenario(circles=[(3.0, 0.0, 1.0)]).to_json(): "",
    scenario(goal=0.35).to_json(): "the way to the goal circle is 0.05 m long, at least 0.1 m are needed",
    scenario(goal=0.2).to_json(): "",
}


@pytest.mark.parametrize("line", BAD_LINES)
def test_a_bad_line_is_named(tmp_path: Path, line: str) -> None:
    file = write_lines(tmp_path / "list.jsonl", scenario().to_json(), "", line)
    with pytest.raises(ScenarioError, match=rf"list\.jsonl, line 3: .*{BAD_LINES[line]}") as error:
        read_list(file, SimConfig())
    assert "\n" not in str(error.value)


def test_bad_lines_can_be_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = [scenario().to_json(), scenario(goal=4.0).to_json()]
    file = write_lines(tmp_path / "list.jsonl", good[0], *BAD_LINES, good[1])
    drawn = read_list(file, SimConfig(), skip_invalid=True)
    assert [s.to_json() for s in drawn.scenarios] == good
    assert drawn.shortest == pytest.approx([2.7, 3.7], rel=0.003)
    assert drawn.lines == (1, 2 + len(BAD_LINES))
    assert drawn.first(1).lines == (1,)
    told = capsys.readouterr().err.splitlines()
    assert [int(line.split(", line ")[1].split(":")[0]) for line in told] == list(range(2, 2 + len(BAD_LINES)))


@pytest.mark.parametrize(("more", "counted"), [(0, ""), (1, "and 1 more line; "), (5, "and 5 more lines; ")])
def test_the_first_bad_line_is_named_and_all_are_counted(tmp_path: Path, more: int, counted: str) -> None:
    # What the lengths of the ways tell comes first in the file, what its text tells later.
    bad = [scenario(goal=0.35).to_json(), *["{", scenario(goal=0.2).to_json()] * 3][: more + 1]
    file = write_lines(tmp_path / "list.jsonl", scenario().to_json(), *bad, scenario().to_json())
    with pytest.raises(ScenarioError) as refusal:
        read_list(file, SimConfig())
    reason = "the way to the goal circle is 0.05 m long, at least 0.1 m are needed"
    left = "it" if more == 0 else "them"
    assert str(refusal.value) == f"{file}, line 2: {reason} ({counted}--skip-invalid leaves {left} out)"


def test_a_list_without_scenarios_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="no scenario that the robot can run"):
        read_list(write_lines(tmp_path / "empty.jsonl"), SimConfig())
    with pytest.raises(ScenarioError, match="no scenario that the robot can run"):
        read_list(write_lines(tmp_path / "bad.jsonl", "{"), SimConfig(), skip_invalid=True)


def test_what_is_no_scenario_is_named() -> None:
    with pytest.raises(ScenarioError, match="scenario 1: expected a Scenario, got 1"):
        given_list([scenario(), 1], SimConfig())  # type: ignore[list-item]
    with pytest.raises(ValueError, match=r"expected a sequence of length 3 \(got 2\)\nwhile processing 'start'"):
        scenario(start=[0, 0])


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"none\.jsonl: cannot be read: No such file"):
        read_list(tmp_path / "none.jsonl", SimConfig())
    (tmp_path / "binary.jsonl").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=r"binary\.jsonl: cannot be read: not UTF-8"):
        read_list(tmp_path / "binary.jsonl", SimConfig())


def test_a_robot_too_wide_for_a_scenario_is_told_so(tmp_path: Path) -> None:
    walls = [(-2.0, -3.0, 5.0, -3.0), (-2.0, 3.0, 5.0, 3.0), (-2.0, -3.0, -2.0, 3.0), (5.0, -3.0, 5.0, 3.0)]
    gap = scenario(segments=[(1.5, 0.5, 1.5, 3.0), (1.5, -3.0, 1.5, -0.5), *walls])
    file = write_lines(tmp_path / "gap.jsonl", gap.to_json())
    assert len(read_list(file, SimConfig(robot=RobotConfig(radius=0.25)))) == 1
    with pytest.raises(ScenarioError, match="line 1"):
        read_list(file, SimConfig(robot=RobotConfig(radius=0.6)))
