"""Floors of the classical baselines: whoever makes one weaker, by its code or by the settings that ship, hears of it.

Each drives the first scenarios of a validation list once. Nothing is random in that: a count is the same in every run,
and the floor lies below it by no more than what a compiler's other rounding may turn, two episodes of a hundred.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest

from contending import SIM
from navrl.compare import compare
from navrl.comparing.folder import Record
from navrl.config import ControllersConfig, DwaConfig, GapConfig, MppiConfig, PursuitConfig, WorldConfig
from navrl.config.levels import Level
from navrl.scenarios import load_list

WORLDS = {"td3": WorldConfig(name="td3"), "boxes": WorldConfig(name="boxes", boxes=16)}


class Measured(NamedTuple):
    """What a baseline did with the settings that ship for the level."""

    contender: str
    world: str
    level: Level
    scenarios: int
    arrived: int
    collided: int
    spl: float


MEASURED = [
    Measured("dwa", "td3", "ideal", 100, 99, 0, 0.805),
    Measured("dwa", "boxes", "ideal", 100, 99, 0, 0.792),
    Measured("dwa", "td3", "real", 100, 97, 0, 0.757),
    Measured("gap", "td3", "ideal", 100, 95, 0, 0.860),
    Measured("gap", "boxes", "ideal", 100, 94, 0, 0.851),
    Measured("gap", "td3", "real", 100, 94, 0, 0.858),
    Measured("mppi", "td3", "ideal", 20, 20, 0, 0.943),
    Measured("pursuit+astar", "td3", "ideal", 100, 100, 0, 0.969),
    Measured("pursuit+astar", "boxes", "ideal", 100, 100, 0, 0.956),
]
WEAKER = {
    "dwa": ControllersConfig(dwa=DwaConfig(heading=2.0, clearance=0.2, speed=0.2)),
    "gap": ControllersConfig(gap=GapConfig(margin=0.15)),
    "mppi": ControllersConfig(mppi=MppiConfig(temperature=1000.0)),
    "pursuit+astar": ControllersConfig(pursuit=PursuitConfig(lookahead=1.2)),
}
"""Settings that make a baseline clearly weaker."""


Drive = Callable[[Measured, ControllersConfig | None], Record]
"""Drives a baseline with settings, or with those that ship."""


@pytest.fixture
def drive(tmp_path: Path, quick: None) -> Drive:
    """The first scenarios of a validation list, as `navrl compare` runs them."""

    def driven(measured: Measured, controllers: ControllersConfig | None = None) -> Record:
        sim = replace(SIM, world=WORLDS[measured.world])
        scenarios = load_list(sim, "validation", count=measured.scenarios)
        names = [measured.contender]
        return compare(names, scenarios, sim, tmp_path, level=measured.level, controllers=controllers).records[0]

    return driven


def falls_short(record: Record, measured: Measured) -> bool:
    """Whether it did less than was measured, beyond rounding."""
    turned = max(1, round(0.02 * measured.scenarios))
    outcomes = [episode.outcome for episode in record.episodes]
    return (
        outcomes.count("goal") < measured.arrived - turned
        or outcomes.count("collision") > measured.collided + turned
        or record.scores["spl"] < measured.spl - 0.02
    )


@pytest.mark.parametrize("measured", MEASURED, ids=lambda m: f"{m.contender} {m.world} {m.level}")
def test_a_baseline_is_as_strong_as_it_was(measured: Measured, drive: Drive) -> None:
    record = drive(measured, None)
    rates = {key: record.scores[key] for key in ("success_rate", "collision_rate", "spl")}
    assert not falls_short(record, measured), f"{rates}; measured: {measured}"


@pytest.mark.parametrize("contender", WEAKER)
def test_a_weaker_baseline_is_noticed(contender: str, drive: Drive) -> None:
    measured = next(m for m in MEASURED if m.contender == contender)
    assert falls_short(drive(measured, WEAKER[contender]), measured)
