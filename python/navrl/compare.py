"""Compares contenders on one list: policies, classical controllers, and either of them led by a planner.

    comparison = compare(["default", "dwa", "default+astar"], scenarios, sim, folder, level="real")
    comparison = compare(["dwa", enter("mine", my_controller)], scenarios, sim, folder)
    write(comparison, folder, "what I did")             results.json, episodes.jsonl, report.md, pictures

The one evaluator runs all of them, over the same scenarios with the same noise, so that `navrl eval` gives a policy the
same numbers. What a contender did is kept in the folder: the same call continues a comparison that was cut short, and
another call with the same settings adds its contenders to those that are kept.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from itertools import combinations
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from navrl.batch import config_json
from navrl.comparing.contenders import Contender, enter
from navrl.comparing.folder import ComparisonFolder, Record
from navrl.comparing.pilot_errors import PilotError
from navrl.comparing.progress import shown_drive, shown_plans
from navrl.comparing.report import headline, markdown
from navrl.comparing.short_names import short_names
from navrl.comparing.timing import decision_times
from navrl.config import ControllersConfig, PlannerConfig, SimConfig
from navrl.config.files import load_config
from navrl.config.levels import Level, at_level
from navrl.durable import write_file
from navrl.errors import UserError
from navrl.evaluate import EVALUATION_SEED, measure
from navrl.machine import made_with
from navrl.paired import bootstrap_interval, differences, mcnemar, mean_difference, only_one
from navrl.planners import Plan
from navrl.scenarios import ScenarioList

if TYPE_CHECKING:
    from navrl.display import Display

__all__ = ["Comparison", "Contender", "FailedPilots", "Pair", "compare", "enter", "write"]

SCHEMA = 1
"""Version of results.json."""


@dataclass(frozen=True)
class Pair:
    """Two contenders of one list, scenario by scenario; differences are those of `a` less those of `b`."""

    a: str
    b: str
    level: Level
    list: str
    """Name of the list."""
    only_a: int
    """Scenarios that only `a` solved."""
    only_b: int
    """Scenarios that only `b` solved."""
    mcnemar_p: float
    """Exact McNemar: p-value of equal success rates."""
    spl_diff: float
    """Difference of SPL."""
    spl_diff_ci95: tuple[float, float]
    """Its paired bootstrap interval over worlds."""
    time_diff_s: float | None
    """Mean difference of the time to the goal where both reached it, seconds; None if nowhere."""
    time_diff_s_ci95: tuple[float, float] | None
    """Its paired bootstrap interval over worlds."""


@dataclass(frozen=True)
class Comparison:
    """What came of it."""

    level: Level
    scenarios: ScenarioList
    """What all of them ran."""
    sim: SimConfig
    """Robot, lidar and task at the level."""
    records: list[Record]
    """In the order of their names as given; then those that the folder kept besides."""
    earlier: list[str]
    """Names of these last: they were compared before, with the same settings."""
    pairs: list[Pair]
    """Each with each."""
    common: list[int]
    """Scenarios that all of them solved."""

    def to_json(self, command: str) -> dict[str, Any]:
        """The content of results.json.

        Args:
            command: What was typed.

        Returns:
            Schema, software and processor, command, contenders and pairs.
        """
        called = {"command": command, "earlier": self.earlier, "solved_by_all": len(self.common)}
        results = {"contenders": self.contenders(), "pairs": [asdict(pair) for pair in self.pairs]}
        return {"schema": SCHEMA} | made_with() | called | results

    def contenders(self) -> list[dict[str, Any]]:
        """Name, level, all scores of each contender, and what they were made with."""
        return [
            {"name": record.name, "level": self.level, "made_with": record.made_with}
            | record.scores
            | self._over_common(record)
            for record in self.records
        ]

    def short_names(self) -> list[str]:
        """Names of all contenders as tables and pictures show them."""
        return short_names([record.name for record in self.records])

    def _over_common(self, record: Record) -> dict[str, float | None]:
        solved = [record.episodes[index] for index in self.common]
        return {
            "common_time_to_goal_s": float(np.mean([e.time_s for e in solved])) if solved else None,
            "common_path_length_m": float(np.mean([e.path_m for e in solved])) if solved else None,
        }


class FailedPilots(UserError):
    """Pilots that the user gave have failed; the text says which, in which scenarios and how."""

    def __init__(self, faults: Sequence[PilotError], comparison: Comparison | None) -> None:
        """Keeps what the other contenders did.

        Args:
            faults: One for each that failed.
            comparison: Of the others; None if there are none.
        """
        super().__init__("; ".join(str(fault) for fault in faults))
        self.comparison = comparison


def compare(
    names: Sequence[str | Contender],
    scenarios: ScenarioList,
    sim: SimConfig,
    folder: Path,
    *,
    level: Level = "ideal",
    controllers: ControllersConfig | None = None,
    planner: PlannerConfig | None = None,
    num_threads: int = 1,
    display: Display | None = None,
) -> Comparison:
    """Runs every contender over a list, or reads what it did before, and compares each with each.

    Args:
        names: Contenders: run folders, policy folders, "default", controllers, or one of these, "+" and a planner; or
            what `enter` made of such a name, or of a function of yours, which is driven anew each time.
        scenarios: The list.
        sim: Robot, lidar and task before the level changes them.
        folder: Where results are kept: new, empty, or of a comparison with the same settings, whose contenders stay.
        level: Under which conditions they drive.
        controllers: Settings of the classical controllers; those that ship for the level if None.
        planner: Settings of the planners; those that ship for the level if None.
        num_threads: Threads that step robots; they do not change results. Plans and decisions are made, and their times
            taken, on one.
        display: Shows a line for each contender, and how far it is; None shows nothing.

    Returns:
        All results.

    Raises:
        UserError: A name twice or unknown, a policy for another robot, or a folder of another comparison; before
            anything is driven.
        FailedPilots: A function of yours has failed; after all others have driven.
    """
    contenders = _entered(names)
    for contender in contenders:
        contender.check(sim, level)
    shipped = load_config(level=level)
    sim, controllers, planner = at_level(sim, level), controllers or shipped.controllers, planner or shipped.planner
    kept = ComparisonFolder(folder, _settings(scenarios, sim, level, controllers, planner))
    before = {c.name: kept.read(c.name, c.policy_sha256) for c in contenders if c.is_known}
    others = kept.others([contender.name for contender in contenders])
    _say(display, f"comparing {headline(scenarios, sim, level, len(contenders))}; {folder}")
    if others:
        _say(display, f"{folder} holds {', '.join(record.name for record in others)}, too: they stay in the report")
    records, faults = [], []
    for contender in contenders:
        record, begin = before.get(contender.name), perf_counter()
        if record is not None:
            _say(display, f"{_line(record)}, kept")
        else:
            try:
                record = _run(contender, scenarios, sim, controllers, planner, num_threads, display)
            except PilotError as error:
                _say(display, str(error))
                faults.append(error)
                continue
            if contender.is_known:
                kept.keep(record, contender.policy_sha256)
            _say(display, f"{_line(record)}, in {perf_counter() - begin:.1f} s")
        records.append(record)
    comparison = _compared(records, others, scenarios, sim, level) if records or others else None
    if comparison is None or faults:
        raise FailedPilots(faults, comparison) from faults[0]
    return comparison


def _entered(names: Sequence[str | Contender]) -> list[Contender]:
    typed = [name if isinstance(name, str) else name.name for name in names]
    if not typed:
        raise UserError("contenders: expected at least one name")
    if len(set(typed)) < len(typed):
        twice = next(name for name in typed if typed.count(name) > 1)
        raise UserError(f"{twice}: named twice")
    return [enter(name) if isinstance(name, str) else name for name in names]


def _say(display: Display | None, text: str) -> None:
    if display is not None:
        display.line(f"navrl: {text}")


def _compared(
    records: list[Record], others: list[Record], scenarios: ScenarioList, sim: SimConfig, level: Level
) -> Comparison:
    all_records = [*records, *others]
    common = np.flatnonzero(np.all([record.solved() for record in all_records], axis=0)).tolist()
    pairs = [_pair(a, b, level, scenarios.name) for a, b in combinations(all_records, 2)]
    return Comparison(level, scenarios, sim, all_records, [record.name for record in others], pairs, common)


def write(comparison: Comparison, folder: Path, command: str) -> None:
    """Writes results.json, episodes.jsonl, the pictures and report.md, as `navrl compare` does.

    Args:
        comparison: What came of it.
        folder: An existing folder.
        command: What was typed, or what you want to read there.
    """
    # Pillow is needed here only.
    from navrl.comparing import plots

    results = json.dumps(comparison.to_json(command), indent=2, allow_nan=False) + "\n"
    write_file(folder / "results.json", results.encode())
    lines = [
        json.dumps({"contender": record.name, "level": comparison.level} | episode.to_json(), allow_nan=False) + "\n"
        for record in comparison.records
        for episode in record.episodes
    ]
    write_file(folder / "episodes.jsonl", "".join(lines).encode())
    pictures = plots.write(comparison, folder)
    write_file(folder / "report.md", markdown(comparison, command, pictures).encode())


def _settings(
    scenarios: ScenarioList, sim: SimConfig, level: Level, controllers: ControllersConfig, planner: PlannerConfig
) -> dict[str, Any]:
    """Everything that results depend on besides the contender."""
    settings = {"navrl": version("navrl"), "level": level, "list": scenarios.name, "episodes": len(scenarios)}
    tables = json.loads(config_json(sim)) | asdict(controllers) | {"planner": asdict(planner)}
    flat = {f"{table}.{key}": value for table, keys in tables.items() for key, value in keys.items()}
    return settings | {"list_sha256": scenarios.sha256, "seed": EVALUATION_SEED} | flat


def _run(
    contender: Contender,
    scenarios: ScenarioList,
    sim: SimConfig,
    controllers: ControllersConfig,
    planner: PlannerConfig,
    num_threads: int,
    display: Display | None,
) -> Record:
    name, count = contender.name, len(scenarios)
    plans = shown_plans(contender.plans(scenarios.scenarios, sim, planner), name, count, display)
    drive = contender.driver(scenarios.scenarios, plans, sim, controllers, planner)
    evaluation = measure(shown_drive(drive, name, count, display), scenarios, sim, num_threads=num_threads)
    times = decision_times(contender, scenarios.scenarios, sim, controllers, planner)
    scores = evaluation.summary.to_json() | {"knows_map": contender.planner is not None}
    scores |= _percentiles("decision", times) | _planning(plans, scenarios)
    return Record(name, scores, evaluation.episodes, evaluation.tracks, made_with())


def _planning(plans: Sequence[Plan], scenarios: ScenarioList) -> dict[str, float]:
    if not plans:
        return {}
    lengths = zip(plans, scenarios.shortest.tolist(), strict=True)
    ratios = [plan.length / shortest for plan, shortest in lengths if plan.found]
    found = {"plans_found": len(ratios)} | ({"plan_ratio": float(np.mean(ratios))} if ratios else {})
    return found | _percentiles("planning", [plan.time for plan in plans])


def _percentiles(what: str, seconds: Sequence[float] | np.ndarray) -> dict[str, float]:
    p50, p99 = np.percentile(seconds, [50, 99]).tolist()
    return {f"{what}_p50_ms": 1e3 * p50, f"{what}_p99_ms": 1e3 * p99}


def _line(record: Record) -> str:
    scores = record.scores
    return f"{record.name}: success {100 * scores['success_rate']:.1f} %, SPL {scores['spl']:.3f}"


def _pair(a: Record, b: Record, level: Level, list_name: str) -> Pair:
    only_a, only_b = only_one(a.episodes, b.episodes)
    spl = differences([e.spl for e in a.episodes], [e.spl for e in b.episodes])
    spl_interval, spl_mean = bootstrap_interval(spl), mean_difference(spl)
    # Every scenario has an SPL.
    assert spl_interval is not None
    assert spl_mean is not None
    times = [[e.time_s if e.outcome == "goal" else None for e in record.episodes] for record in (a, b)]
    time = differences(*times)
    return Pair(
        a=a.name,
        b=b.name,
        level=level,
        list=list_name,
        only_a=only_a,
        only_b=only_b,
        mcnemar_p=mcnemar(only_a, only_b),
        spl_diff=spl_mean,
        spl_diff_ci95=spl_interval,
        time_diff_s=mean_difference(time),
        time_diff_s_ci95=bootstrap_interval(time),
    )
