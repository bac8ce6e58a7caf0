"""Compares contenders on one list: policies, classical controllers, and either of them led by a planner.

    compare(["default", "dwa", "default+astar"], scenarios, sim, folder, level="real") -> Comparison
    compare(["dwa", enter("mine", my_controller)], scenarios, sim, folder)

The one evaluator runs all of them, over the same scenarios with the same noise, so that `navrl eval` gives a policy the
same numbers. What a contender did is kept in the folder: the same call continues a comparison that was cut short.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from itertools import combinations
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from navrl.batch import config_json
from navrl.comparing.contenders import LOOKAHEAD, Entry, enter
from navrl.comparing.folder import ComparisonFolder, Record
from navrl.comparing.timing import decision_times
from navrl.config import ControllersConfig, PlannerConfig, SimConfig
from navrl.config.files import load_config
from navrl.config.levels import Level, at_level
from navrl.durable import write_file
from navrl.errors import UserError
from navrl.evaluate import EVALUATION_SEED, measure
from navrl.paired import bootstrap_interval, differences, mcnemar, mean_difference, only_one
from navrl.planners import Plan
from navrl.scenarios import ScenarioList

__all__ = ["Comparison", "Entry", "Pair", "compare", "enter", "write"]

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
    """In the order of their names as given."""
    pairs: list[Pair]
    """Each with each."""
    common: list[int]
    """Scenarios that all of them solved."""

    def to_json(self, command: str) -> dict[str, Any]:
        """The content of results.json.

        Args:
            command: What was typed.

        Returns:
            Schema, command, list, contenders and pairs.
        """
        head = {"schema": SCHEMA, "navrl": version("navrl"), "command": command, "solved_by_all": len(self.common)}
        return head | {"contenders": self.contenders(), "pairs": [asdict(pair) for pair in self.pairs]}

    def contenders(self) -> list[dict[str, Any]]:
        """Name, level and all scores of each contender."""
        return [
            {"name": record.name, "level": self.level} | record.scores | self._over_common(record)
            for record in self.records
        ]

    def _over_common(self, record: Record) -> dict[str, float | None]:
        solved = [record.episodes[index] for index in self.common]
        return {
            "common_time_to_goal_s": float(np.mean([e.time_s for e in solved])) if solved else None,
            "common_path_length_m": float(np.mean([e.path_m for e in solved])) if solved else None,
        }


def compare(
    names: Sequence[str | Entry],
    scenarios: ScenarioList,
    sim: SimConfig,
    folder: Path,
    *,
    level: Level = "ideal",
    controllers: ControllersConfig | None = None,
    planner: PlannerConfig | None = None,
    num_threads: int = 1,
    report: Callable[[str], None] = lambda line: None,
) -> Comparison:
    """Runs every contender over a list, or reads what it did before, and compares each with each.

    Args:
        names: Contenders: run folders, policy folders, "default", controllers, or one of these, "+" and a planner; or
            what `enter` made of such a name, or of a function of yours, which is driven anew each time.
        scenarios: The list.
        sim: Robot, lidar and task before the level changes them.
        folder: Where results are kept: new, empty, or of a comparison with the same settings.
        level: Under which conditions they drive.
        controllers: Settings of the classical controllers; those that ship for the level if None.
        planner: Settings of the planners; those that ship for the level if None.
        num_threads: Threads that step robots and plan; they do not change results.
        report: Takes one line for each contender.

    Returns:
        All results.

    Raises:
        UserError: A name twice or unknown, a policy for another robot, or a folder of another comparison.
    """
    typed = [name if isinstance(name, str) else name.name for name in names]
    if len(set(typed)) < len(typed):
        twice = next(name for name in typed if typed.count(name) > 1)
        raise UserError(f"{twice}: named twice")
    entries = [enter(name) if isinstance(name, str) else name for name in names]
    for entry in entries:
        entry.check(sim, level)
    shipped = load_config(level=level)
    sim, controllers, planner = at_level(sim, level), controllers or shipped.controllers, planner or shipped.planner
    kept = ComparisonFolder(folder, _settings(scenarios, sim, level, controllers, planner))
    records = []
    for entry in entries:
        record = kept.read(entry.name, entry.policy_sha256) if entry.is_known else None
        if record is None:
            begin = perf_counter()
            record = _run(entry, scenarios, sim, controllers, planner, num_threads)
            if entry.is_known:
                kept.keep(record, entry.policy_sha256)
            report(f"{_line(record)}, in {perf_counter() - begin:.1f} s")
        else:
            report(f"{_line(record)}, kept")
        records.append(record)
    solved = np.all([record.solved() for record in records], axis=0)
    pairs = [_pair(a, b, level, scenarios.name) for a, b in combinations(records, 2)]
    return Comparison(level, scenarios, sim, records, pairs, np.flatnonzero(solved).tolist())


def write(comparison: Comparison, folder: Path, command: str) -> None:
    """Writes results.json and episodes.jsonl.

    Args:
        comparison: What came of it.
        folder: An existing folder.
        command: What was typed.
    """
    results = json.dumps(comparison.to_json(command), indent=2, allow_nan=False) + "\n"
    write_file(folder / "results.json", results.encode())
    lines = [
        json.dumps({"contender": record.name, "level": comparison.level} | episode.to_json(), allow_nan=False) + "\n"
        for record in comparison.records
        for episode in record.episodes
    ]
    write_file(folder / "episodes.jsonl", "".join(lines).encode())


def _settings(
    scenarios: ScenarioList, sim: SimConfig, level: Level, controllers: ControllersConfig, planner: PlannerConfig
) -> dict[str, Any]:
    """Everything that results depend on besides the contender."""
    settings = {"navrl": version("navrl"), "level": level, "list": scenarios.name, "list_sha256": scenarios.sha256}
    led = {"planner": asdict(planner) | {"lookahead": LOOKAHEAD}}
    tables = json.loads(config_json(sim)) | asdict(controllers) | led
    flat = {f"{table}.{key}": value for table, keys in tables.items() for key, value in keys.items()}
    return settings | {"seed": EVALUATION_SEED} | flat


def _run(
    entry: Entry,
    scenarios: ScenarioList,
    sim: SimConfig,
    controllers: ControllersConfig,
    planner: PlannerConfig,
    num_threads: int,
) -> Record:
    plans = entry.plans(scenarios.scenarios, sim, planner, num_threads=num_threads)
    drive = entry.driver(scenarios.scenarios, plans, sim, controllers)
    evaluation = measure(drive, scenarios, sim, num_threads=num_threads)
    times = decision_times(entry, scenarios.scenarios, sim, controllers, planner)
    scores = evaluation.summary.to_json() | {"knows_map": entry.planner is not None}
    scores |= _percentiles("decision", times) | _planning(plans, scenarios)
    return Record(entry.name, scores, evaluation.episodes, evaluation.tracks)


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
