"""Pilots of the user's own: functions and objects beside the others, and what is said when one of them fails."""

import io
import re
import traceback
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from contending import SIM
from navrl import display
from navrl.compare import FailedPilots, compare, enter, write
from navrl.config import RobotConfig
from navrl.controllers import Controller
from navrl.display import Display
from navrl.errors import UserError
from navrl.scenarios import ScenarioList

pytestmark = pytest.mark.usefixtures("quick")

Ranges, Pairs = NDArray[np.float32], NDArray[np.float64]


def straight(ranges: Ranges, goal: Pairs, velocity: Pairs) -> Pairs:
    """As the built-in one."""
    return np.stack([np.where(np.abs(goal[:, 1]) < 0.3, 0.5, 0.0), np.clip(2 * goal[:, 1], -1, 1)], axis=1)


class Remembering:
    """The same, as an object that is told which robot it drives."""

    def reset(self) -> None:
        self.robots: set[int] = set()

    def command(self, ranges: Ranges, goal: Pairs, velocity: Pairs, robots: NDArray[np.intp]) -> Pairs:
        self.robots |= set(robots.tolist())
        return straight(ranges, goal, velocity)


def standing(ranges: Ranges, *_: Pairs) -> Pairs:
    return np.zeros((len(ranges), 2))


def test_functions_and_objects_take_part_under_their_names(drawn: ScenarioList, tmp_path: Path) -> None:
    mine = [enter("mine", straight), enter("object", Remembering()), enter("mine+astar", straight)]
    comparison = compare(["straight", "straight+astar", *mine], drawn, SIM, tmp_path / "out")
    built_in, led, function, remembering, own_led = comparison.records
    assert function.episodes == remembering.episodes == built_in.episodes
    assert own_led.episodes == led.episodes != built_in.episodes
    assert [record.name for record in comparison.records[2:]] == ["mine", "object", "mine+astar"]
    assert [record.scores["knows_map"] for record in comparison.records] == [False, True, False, False, True]
    assert comparison.pairs[1].mcnemar_p == 1.0


def test_a_function_is_driven_anew_each_time(drawn: ScenarioList, tmp_path: Path) -> None:
    """Nobody knows whether a function of the same name still does the same."""
    first = compare([enter("mine", straight)], drawn.first(3), SIM, tmp_path / "out")
    other = compare([enter("mine", standing)], drawn.first(3), SIM, tmp_path / "out")
    assert first.records[0].episodes != other.records[0].episodes
    assert {episode.outcome for episode in other.records[0].episodes} == {"timeout"}
    assert list((tmp_path / "out/contenders").glob("*")) == []


def test_a_controller_for_another_robot_is_refused(drawn: ScenarioList, tmp_path: Path) -> None:
    slow = Controller("gap", replace(SIM, robot=RobotConfig(v_max=0.2)))
    with pytest.raises(UserError, match=r"slow: robot\.v_max = 0\.5: the controller was made for 0\.2"):
        compare([enter("slow", slow)], drawn.first(2), SIM, tmp_path / "out")


@pytest.mark.parametrize("name", ["gap", "default", "gap+astar", "mine+astr"])
def test_what_is_given_has_a_name_of_its_own(name: str) -> None:
    with pytest.raises(UserError, match=rf"{name.replace('+', '.')}: expected a (name of your own|planner)"):
        enter(name, standing)


def test_what_cannot_drive_is_refused_at_once() -> None:
    with pytest.raises(TypeError, match="mine: dict is neither a policy with act nor a controller with command"):
        enter("mine", {})  # type: ignore[arg-type]


# Failures


def too_near(ranges: Ranges, goal: Pairs, velocity: Pairs) -> Pairs:
    """Fails once a robot is within 2 m of its goal."""
    if (goal[:, 0] < 2.0).any():
        raise ZeroDivisionError("division\nby zero")
    return straight(ranges, goal, velocity)


def lost(ranges: Ranges, goal: Pairs, velocity: Pairs) -> Pairs:
    """Knows nothing within 2 m of the goal."""
    commands = straight(ranges, goal, velocity)
    commands[goal[:, 0] < 2.0] = np.nan
    return commands


def of_two_arguments(ranges: Ranges, goal: Pairs) -> Pairs:
    return straight(ranges, goal, goal)


@pytest.mark.parametrize(
    ("pilot", "fault"),
    [
        (too_near, "ZeroDivisionError: division by zero"),
        (lost, "its command is not of finite numbers"),
        (of_two_arguments, r"TypeError: of_two_arguments\(\) takes 2 positional arguments but 3 were given"),
        (lambda *_: np.zeros(2), r"ValueError: command: expected commands of shape \(12, 2\), got \(2,\)"),
    ],
)
def test_a_failure_names_contender_and_scenario(
    pilot: Callable[..., Any], fault: str, drawn: ScenarioList, tmp_path: Path
) -> None:
    with pytest.raises(FailedPilots, match=rf"^mine\+astar: scenario \d+: {fault}$"):
        compare([enter("mine+astar", pilot)], drawn, SIM, tmp_path / "out")


def test_the_scenario_is_the_one_in_which_it_fails(drawn: ScenarioList, tmp_path: Path) -> None:
    """The first robot that comes near its goal, found by driving each alone."""
    ends = compare([enter("mine", straight)], drawn, SIM, tmp_path / "a").records[0]
    near = []
    for index, (scenario, track) in enumerate(zip(drawn.scenarios, ends.tracks, strict=True)):
        places = np.concatenate([[scenario.start[:2]], track[:, :2]])
        close = np.hypot(*(places - scenario.goal).T) < 2.0
        near += [(int(close.argmax()), index)] if close.any() else []
    for pilot in (too_near, lost):
        with pytest.raises(FailedPilots, match=rf"^mine: scenario {min(near)[1]}: "):
            compare([enter("mine", pilot)], drawn, SIM, tmp_path / "b")


def test_nothing_is_lost_of_the_others(drawn: ScenarioList, tmp_path: Path) -> None:
    out = tmp_path / "out"
    names = [enter("wrong", too_near), "gap", enter("mine", straight), enter("worse", lost)]
    with pytest.raises(FailedPilots) as failure:
        compare(names, drawn, SIM, out)
    assert re.fullmatch(r"wrong: scenario \d+: Zero.*; worse: scenario \d+: .*", str(failure.value))
    others = failure.value.comparison
    assert others is not None
    assert [record.name for record in others.records] == ["gap", "mine"]
    write(others, out, "typed")
    assert "| gap | mine |" in (out / "report.md").read_text()
    assert [path.name for path in (out / "contenders").glob("*.json")] == ["gap.json"]
    # Whoever wrote the function sees where it failed.
    with pytest.raises(FailedPilots) as alone:
        compare([enter("wrong", too_near)], drawn, SIM, tmp_path / "alone")
    assert alone.value.comparison is None
    assert "in too_near" in "".join(traceback.format_exception(alone.value))


# Progress


def shown_lines(
    monkeypatch: pytest.MonkeyPatch, name: str, drawn: ScenarioList, folder: Path, *, period_s: float
) -> list[str]:
    """What a comparison of one contender prints off a terminal, with a line of progress so often."""
    text = io.StringIO()
    monkeypatch.setattr(display, "Console", lambda **_: Console(file=text, width=150, highlight=False))
    monkeypatch.setattr(display, "PLAIN_PERIOD_S", period_s)
    with Display(at_once=False) as shown:
        compare([name], drawn, SIM, folder, display=shown)
    return text.getvalue().splitlines()


def test_slow_contenders_show_how_far_they_are(
    drawn: ScenarioList, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, *lines, last = shown_lines(monkeypatch, "straight+rrt", drawn, tmp_path / "out", period_s=0.0)
    assert first == f"navrl: comparing 1 contender on td3, list test, level ideal: 12 scenarios; {tmp_path / 'out'}"
    assert lines[:12] == [f"navrl: straight+rrt: {count} of 12 paths planned" for count in range(1, 13)]
    counts = [
        re.fullmatch(r"navrl: straight\+rrt: (\d+) of 12 scenarios ended, (\d+) steps, \d+ s", line)
        for line in lines[12:]
    ]
    ended = [int(count[1]) for count in counts if count]
    assert len(ended) == len(lines) - 12 > 20
    assert ended == sorted(ended)
    assert ended[0] == 0 < ended[-1] < 12
    assert [int(count[2]) for count in counts if count] == list(range(len(ended)))
    assert last.startswith("navrl: straight+rrt: success ")


def test_quick_ones_show_nothing_but_their_results(
    drawn: ScenarioList, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = shown_lines(monkeypatch, "straight", drawn, tmp_path / "out", period_s=60.0)
    assert len(lines) == 2
