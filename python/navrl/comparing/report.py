"""A comparison as tables: two for the terminal, and all of them as report.md beside its pictures.

headline(scenarios, sim, level, count) -> what is compared, in a line
terminal(comparison, file, console);  markdown(comparison, command, pictures)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from navrl.comparing.short_names import short_names
from navrl.scenarios import LIST_SIZES

if TYPE_CHECKING:
    from rich.console import Console

    from navrl.compare import Comparison, Pair
    from navrl.config import SimConfig
    from navrl.config.levels import Level
    from navrl.scenarios import ScenarioList

Scores = dict[str, Any]
"""What `Comparison.contenders` says of one."""


@dataclass(frozen=True)
class Column:
    """A measure of a contender."""

    header: str
    """With its unit; a new line where a narrow table may break it."""
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
    Column("success\n% (95 %)", share("success")),
    Column("collision\n% (95 %)", share("collision")),
    Column("time-out\n% (95 %)", share("timeout")),
    Column("SPL\n", number("spl", 3)),
)
DETOUR = Column("success with\ndetour % (95 %)", share("detour_success"))
DRIVE = (
    Column("time\ns", number("time_to_goal_s", 2)),
    Column("path\nm", number("path_length_m", 2)),
    Column("path /\nshortest", number("path_ratio", 3)),
)
KEEP_CLEAR = (
    Column("least clearance\nm", number("min_clearance_m", 3)),
    Column("5th percentile of clearance\nm", number("p5_clearance_m", 3)),
    Column("jerk\nm/s^3", number("jerk_m_s3", 2)),
    Column("change of omega\nrad/s", number("omega_change_rad_s", 1)),
    Column("turning in place\n% of the time", number("turning_share", 1, scale=100)),
)
COMMON = (
    Column("time\ns", number("common_time_to_goal_s", 2)),
    Column("path\nm", number("common_path_length_m", 2)),
)
DECISION = Column("decision\np50 ms", number("decision_p50_ms", 3))
THINK = (
    DECISION,
    Column("decision\np99 ms", number("decision_p99_ms", 3)),
    Column("knows the map", lambda scores: "yes" if scores["knows_map"] else "no"),
    Column("plan\np50 ms", number("planning_p50_ms", 2)),
    Column("plan\np99 ms", number("planning_p99_ms", 2)),
    Column("plans found", number("plans_found", 0)),
    Column("plan /\nshortest", number("plan_ratio", 3)),
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
    names = short_names([entry["name"] for entry in entries])
    rows = [(name, *(column.cell(entry) for column in columns)) for name, entry in zip(names, entries, strict=True)]
    return Sheet(title, note, ("contender", *(column.header for column in columns)), rows)


def sheets(comparison: Comparison) -> list[Sheet]:
    """All tables: who arrives, how they drive, how long they think, and each against each.

    Args:
        comparison: What came of it.
    """
    common, scenarios = len(comparison.common), len(comparison.scenarios)
    spl_detour = Column("SPL with detour", number("detour_spl", 3))
    return [
        sheet(
            comparison,
            "Who arrives",
            f"Shares of {scenarios:,} scenarios, in brackets Wilson 95 % intervals. {_detours(comparison)}.",
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
            "One robot, one call, one thread: 1,000 decisions, and one plan for each scenario.",
            THINK,
        ),
        Sheet(
            "Each against each",
            "Scenarios that only the one solves, exact McNemar test, differences with paired bootstrap 95 % intervals.",
            ("a", "b", "only a", "only b", "p", "SPL a - b (95 %)", "time a - b, s (95 %)"),
            [_against(pair, comparison) for pair in comparison.pairs],
        ),
    ]


def _detours(comparison: Comparison) -> str:
    count = comparison.records[0].scores["detour_episodes"]
    return f"{count:,} scenarios need a detour: an obstacle stands on the straight line"


def _against(pair: Pair, comparison: Comparison) -> tuple[str, ...]:
    names = [record.name for record in comparison.records]
    shorts = dict(zip(names, short_names(names), strict=True))
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


def headline(scenarios: ScenarioList, sim: SimConfig, level: Level, count: int) -> str:
    """What is compared, in a line.

    Args:
        scenarios: What all of them run.
        sim: With the world of a built-in list.
        level: Under which conditions.
        count: Contenders.
    """
    world = f"boxes ({sim.world.boxes})" if sim.world.name == "boxes" else sim.world.name
    where = f"{world}, list {scenarios.name}" if scenarios.name in LIST_SIZES else f"{scenarios.name} scenarios"
    if scenarios.lines is not None:
        where = scenarios.name
    many = f"{count} contender{'' if count == 1 else 's'}"
    return f"{many} on {where}, level {level}: {len(scenarios):,} scenario{'' if len(scenarios) == 1 else 's'}"


def _headline(comparison: Comparison) -> str:
    return headline(comparison.scenarios, comparison.sim, comparison.level, len(comparison.records))


def terminal(comparison: Comparison, file: str, console: Console) -> str:
    """Two tables of at most 80 columns, to be printed.

    Args:
        comparison: What came of it.
        file: Where the report is.
        console: Whose width and colours they have.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    shown = (
        sheet(comparison, _headline(comparison), "", ARRIVE),
        sheet(comparison, f"{_detours(comparison)}.\nTime and path over successes", "", (DETOUR, *DRIVE, DECISION)),
    )
    with console.capture() as capture:
        for one in shown:
            console.print(one.title, soft_wrap=True, highlight=False)
            table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
            for index, column in enumerate(one.columns):
                table.add_column(column, justify="right" if index else "left", no_wrap=True, vertical="bottom")
            for row in one.rows:
                table.add_row(*row)
            console.print(table)
            console.print()
        rest = "clearance, jerk, planning, where all arrive, each against each, names in full, pictures"
        console.print(f"{file}: {rest}", soft_wrap=True, highlight=False)
    return capture.get()


def markdown(comparison: Comparison, command: str, pictures: Sequence[tuple[str, str]]) -> str:
    """The content of report.md.

    Args:
        comparison: What came of it.
        command: What was typed.
        pictures: File and caption of each.
    """
    lines = [f"# {_headline(comparison)}", "", f"    {command}", "", *_circumstances(comparison), ""]
    for one in sheets(comparison):
        lines += [f"## {one.title}", "", one.note, ""]
        if len(one.columns) > 1 and one.rows:
            lines += [_markdown_row(one.columns), _markdown_row(["---"] * len(one.columns))]
            lines += [_markdown_row(row) for row in one.rows] + [""]
    for file, caption in pictures:
        lines += [f"![{caption}]({file})", "", caption, ""]
    return "\n".join(lines[:-1]) + "\n"


def _circumstances(comparison: Comparison) -> list[str]:
    """Who was compared before, what by, the list, and names in full."""
    lines = [f"- List `{comparison.scenarios.name}`, sha256 `{comparison.scenarios.sha256}`."]
    if comparison.earlier:
        earlier = ", ".join(f"`{name}`" for name in comparison.earlier)
        lines.append(f"- Compared before, by commands with the same settings: {earlier}.")
    by: dict[str, list[str]] = {}
    for record in comparison.records:
        by.setdefault(_made_with(record.made_with), []).append(f"`{record.name}`")
    for made_with, names in by.items():
        lines.append(f"- {made_with}{'' if len(by) == 1 else ': ' + ', '.join(names)}.")
    names = [record.name for record in comparison.records]
    for name, short in zip(names, short_names(names), strict=True):
        if name != short:
            lines.append(f"- {_escaped(short)} is `{name}`.")
    return lines


def _made_with(made_with: dict[str, str | None]) -> str:
    commit = "" if made_with["commit"] is None else f", commit {made_with['commit']}"
    return f"navrl {made_with['navrl']}{commit}; numpy {made_with['numpy']}; {made_with['cpu']}; {made_with['isa']}"


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(_escaped(cell) for cell in cells) + " |"


def _escaped(cell: str) -> str:
    return " ".join(cell.replace("|", "\\|").split())
