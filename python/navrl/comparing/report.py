"""A comparison as tables: for the terminal, and as report.md beside its pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from navrl.compare import Comparison, Pair


@dataclass(frozen=True)
class Sheet:
    """A table of texts."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]


def number(value: float | None, digits: int) -> str:
    """A number, or "-" where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """A share in percent, or "-"."""
    return "-" if value is None else f"{100 * value:.1f}"


def interval(bounds: Sequence[float] | None, show: Callable[[float], str]) -> str:
    """An interval, or "-"."""
    return "-" if bounds is None else f"{show(bounds[0])}..{show(bounds[1])}"


def sheets(comparison: Comparison) -> list[Sheet]:
    """All tables: who arrives, how they drive, how long they think, and each against each.

    Args:
        comparison: What came of it.
    """
    rows = [(entry["name"], entry) for entry in comparison.contenders()]
    arrive = [(name, *_arrives(scores)) for name, scores in rows]
    drive = [(name, *_drives(scores)) for name, scores in rows]
    think = [(name, *_thinks(scores)) for name, scores in rows]
    detours, common = rows[0][1]["detour_episodes"], len(comparison.common)
    return [
        Sheet(
            f"Who arrives: %, 95 % intervals, SPL; success also where a detour is needed, in {detours}",
            ("contender", "success", "95 %", "coll.", "time-out", "SPL", "detour", "95 %"),
            arrive,
        ),
        Sheet(
            "How they drive: s, m, path / shortest; clearance: least, 5th percentile; m/s^3, rad/s, %",
            ("contender", "time", "path", "ratio", "least", "5th", "jerk", "turning", "in place"),
            drive,
        ),
        Sheet(
            f"Over the {common} scenarios that all solve: time (s), path (m)",
            ("contender", "time", "path"),
            [
                (name, number(scores["common_time_to_goal_s"], 2), number(scores["common_path_length_m"], 2))
                for name, scores in rows
            ],
        ),
        Sheet(
            "How long they think (ms): one robot, one call, one thread",
            ("contender", "decision p50", "p99", "knows the map", "plan p50", "p99", "found", "plan/shortest"),
            think,
        ),
        Sheet(
            "Each against each: solved by one alone, exact McNemar, differences with paired bootstrap 95 % intervals",
            ("a", "b", "a only", "b only", "p", "SPL a - b", "interval", "time a - b s", "interval"),
            [_against(pair) for pair in comparison.pairs],
        ),
    ]


def _arrives(scores: dict[str, Any]) -> tuple[str, ...]:
    return (
        percent(scores["success_rate"]),
        interval(scores["success_ci95"], percent),
        percent(scores["collision_rate"]),
        percent(scores["timeout_rate"]),
        number(scores["spl"], 3),
        percent(scores["detour_success_rate"]),
        interval(scores["detour_success_ci95"], percent),
    )


def _drives(scores: dict[str, Any]) -> tuple[str, ...]:
    return (
        number(scores["time_to_goal_s"], 2),
        number(scores["path_length_m"], 2),
        number(scores["path_ratio"], 3),
        number(scores["min_clearance_m"], 3),
        number(scores["p5_clearance_m"], 3),
        number(scores["jerk_m_s3"], 2),
        number(scores["omega_change_rad_s"], 1),
        percent(scores["turning_share"]),
    )


def _thinks(scores: dict[str, Any]) -> tuple[str, ...]:
    found = scores.get("plans_found")
    return (
        number(scores["decision_p50_ms"], 3),
        number(scores["decision_p99_ms"], 3),
        "yes" if scores["knows_map"] else "no",
        number(scores.get("planning_p50_ms"), 1),
        number(scores.get("planning_p99_ms"), 1),
        "-" if found is None else str(found),
        number(scores.get("plan_ratio"), 3),
    )


def _against(pair: Pair) -> tuple[str, ...]:
    return (
        pair.a,
        pair.b,
        str(pair.only_a),
        str(pair.only_b),
        f"{pair.mcnemar_p:.2g}",
        f"{pair.spl_diff:+.3f}",
        interval(pair.spl_diff_ci95, lambda value: f"{value:+.3f}"),
        "-" if pair.time_diff_s is None else f"{pair.time_diff_s:+.2f}",
        interval(pair.time_diff_s_ci95, lambda value: f"{value:+.2f}"),
    )


def contenders(count: int) -> str:
    """A number of contenders in words."""
    return f"{count} contender{'' if count == 1 else 's'}"


def headline(comparison: Comparison, world: str) -> str:
    """What was compared, in a line."""
    scenarios = comparison.scenarios
    which = "" if scenarios.name == world else f", list {scenarios.name}"
    count = contenders(len(comparison.records))
    return f"{count} on {world}{which}, level {comparison.level}: {len(scenarios):,} scenarios"


def terminal(comparison: Comparison, world: str, console: Console) -> str:
    """The first two tables, to be printed.

    Args:
        comparison: What came of it.
        world: Name of the world or file.
        console: Whose width and colours they have.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    with console.capture() as capture:
        console.print(headline(comparison, world), soft_wrap=True, highlight=False)
        for sheet in sheets(comparison)[:2]:
            console.print(f"\n{sheet.title}", soft_wrap=True, highlight=False)
            table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
            for index, column in enumerate(sheet.columns):
                table.add_column(column, justify="right" if index else "left", no_wrap=index > 0)
            for row in sheet.rows:
                table.add_row(*row)
            console.print(table)
    return capture.get()


def markdown(comparison: Comparison, world: str, command: str, pictures: Sequence[tuple[str, str]]) -> str:
    """The content of report.md.

    Args:
        comparison: What came of it.
        world: Name of the world or file.
        command: What was typed.
        pictures: File and caption of each.
    """
    lines = [f"# {headline(comparison, world)}", "", f"    {command}", ""]
    lines += [f"List `{comparison.scenarios.name}`, sha256 `{comparison.scenarios.sha256}`.", ""]
    for sheet in sheets(comparison):
        lines += [f"## {sheet.title}", ""]
        lines += [_markdown_row(sheet.columns), _markdown_row(["---"] * len(sheet.columns))]
        lines += [_markdown_row(row) for row in sheet.rows] + [""]
    for file, caption in pictures:
        lines += [f"![{caption}]({file})", "", caption, ""]
    return "\n".join(lines[:-1]) + "\n"


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
