"""The figures of a comparison as tables of texts, for terminal and report alike.

sheet(comparison, title, note, ARRIVE) -> Sheet          some measures of every contender
sheets(comparison) -> [Sheet, ...]                       all of them, and each against each
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from navrl.comparing.timing import CALLS

if TYPE_CHECKING:
    from navrl.compare import Comparison, Pair

Scores = dict[str, Any]
"""What `Comparison.contenders` says of one."""


@dataclass(frozen=True)
class Column:
    """A measure of a contender."""

    measure: str
    """Its name; a new line where a narrow table breaks it."""
    unit: str
    """Empty if it has none."""
    cell: Callable[[Scores], str]
    """Its text."""


def number(key: str, digits: int, *, scale: float = 1.0) -> Callable[[Scores], str]:
    """A score, or "-" where there is none."""

    def cell(scores: Scores) -> str:
        value = scores.get(key)
        return "-" if value is None else f"{scale * value:.{digits}f}"

    return cell


def share(key: str) -> Callable[[Scores], str]:
    """A rate with its interval in percent: 98.3 (91.1-99.7)."""

    def cell(scores: Scores) -> str:
        rate, bounds = scores[f"{key}_rate"], scores[f"{key}_ci95"]
        return "-" if rate is None else f"{percent(rate)} ({percent(bounds[0])}-{percent(bounds[1])})"

    return cell


def percent(value: float) -> str:
    """A share in percent: 98.3, and exactly none or all as 0 or 100."""
    return f"{100 * value:.0f}" if value in (0.0, 1.0) else f"{100 * value:.1f}"


ARRIVE = (
    Column("success", "%, 95 % CI", share("success")),
    Column("collision", "%, 95 % CI", share("collision")),
    Column("time-out", "%, 95 % CI", share("timeout")),
    Column("SPL", "", number("spl", 3)),
)
DETOUR = Column("detour solved", "%, 95 % CI", share("detour_success"))
DRIVE = (
    Column("time", "s", number("time_to_goal_s", 2)),
    Column("path", "m", number("path_length_m", 2)),
    Column("path /\nshortest", "", number("path_ratio", 3)),
)
KEEP_CLEAR = (
    Column("least clearance", "m", number("min_clearance_m", 3)),
    Column("5th percentile of clearance", "m", number("p5_clearance_m", 3)),
    Column("jerk", "m/s^3", number("jerk_m_s3", 2)),
    Column("change of omega", "rad/s", number("omega_change_rad_s", 1)),
    Column("turning in place", "% of the time", number("turning_share", 1, scale=100)),
)
COMMON = (
    Column("time", "s", number("common_time_to_goal_s", 2)),
    Column("path", "m", number("common_path_length_m", 2)),
)
DECISION = Column("decision p50", "ms", number("decision_p50_ms", 3))
THINK = (
    DECISION,
    Column("decision p99", "ms", number("decision_p99_ms", 3)),
    Column("knows the map", "", lambda scores: "yes" if scores["knows_map"] else "no"),
    Column("plan p50", "ms", number("planning_p50_ms", 2)),
    Column("plan p99", "ms", number("planning_p99_ms", 2)),
    Column("plans found", "", number("plans_found", 0)),
    Column("plan / shortest", "", number("plan_ratio", 3)),
)


@dataclass(frozen=True)
class Sheet:
    """A table of texts."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]


def sheet(comparison: Comparison, title: str, note: str, columns: Sequence[Column]) -> Sheet:
    """A table with a row for each contender.

    Args:
        comparison: Whose contenders.
        title: What it shows.
        note: What one has to know to read it.
        columns: Measures.
    """
    entries = comparison.contenders()
    named = zip(comparison.short_names(), entries, strict=True)
    rows = [(name, *(column.cell(entry) for column in columns)) for name, entry in named]
    headers = (f"{column.measure}\n({column.unit})" if column.unit else column.measure for column in columns)
    return Sheet(title, note, ("contender", *headers), rows)


def sheets(comparison: Comparison) -> list[Sheet]:
    """All tables: who arrives, how they drive, how long they think, and each against each.

    Args:
        comparison: What came of it.
    """
    common, scenarios = len(comparison.common), len(comparison.scenarios)
    spl_detour = Column("SPL with detour", "", number("detour_spl", 3))
    return [
        sheet(
            comparison,
            "Who arrives",
            f"Shares of {scenarios:,} scenarios with Wilson 95 % intervals (CI). {detours(comparison)}.",
            (*ARRIVE, DETOUR, spl_detour),
        ),
        sheet(
            comparison,
            "How they drive",
            "Means: time, path and path / shortest over the scenarios that the contender solves, the rest over all.",
            (*DRIVE, *KEEP_CLEAR),
        ),
        sheet(
            comparison,
            "Where all arrive",
            f"Means over the {common:,} scenarios that every contender solves.",
            COMMON if common else (),
        ),
        sheet(
            comparison,
            "How long they think",
            f"One robot, one call, one thread: {CALLS:,} decisions, and one plan for each scenario.",
            THINK,
        ),
        Sheet(
            "Each against each",
            "Scenarios that only the one solves, exact McNemar test, differences with paired bootstrap intervals.",
            ("a", "b", "only a", "only b", "p", "SPL a - b (95 % CI)", "time a - b (s, 95 % CI)"),
            [_against(pair, comparison) for pair in comparison.pairs],
        ),
    ]


def detours(comparison: Comparison) -> str:
    """How many scenarios need one."""
    count = comparison.records[0].scores["detour_episodes"]
    return f"{count:,} scenarios need a detour: an obstacle stands on the straight line"


def _against(pair: Pair, comparison: Comparison) -> tuple[str, ...]:
    shorts = dict(zip((record.name for record in comparison.records), comparison.short_names(), strict=True))
    return (
        shorts[pair.a],
        shorts[pair.b],
        str(pair.only_a),
        str(pair.only_b),
        f"{pair.mcnemar_p:.2g}",
        _difference(pair.spl_diff, pair.spl_diff_ci95, 3),
        _difference(pair.time_diff_s, pair.time_diff_s_ci95, 2),
    )


def _difference(value: float | None, bounds: tuple[float, float] | None, digits: int) -> str:
    if value is None or bounds is None:
        return "-"
    return f"{value:+.{digits}f} ({bounds[0]:+.{digits}f} to {bounds[1]:+.{digits}f})"
