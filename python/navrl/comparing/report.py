"""A comparison to be read: two tables for the terminal, and all of them as report.md beside its pictures.

headline(scenarios, sim, level, count) -> what is compared, in a line
terminal(comparison, file, console) -> text
markdown(comparison, command, pictures) -> text
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from navrl.comparing.tables import ARRIVE, DECISION, DETOUR, DRIVE, detours, sheet, sheets
from navrl.scenarios import LIST_SIZES

if TYPE_CHECKING:
    from rich.console import Console

    from navrl.compare import Comparison
    from navrl.config import SimConfig
    from navrl.config.levels import Level
    from navrl.scenarios import ScenarioList


def headline(scenarios: ScenarioList, sim: SimConfig, level: Level, count: int) -> str:
    """What is compared, in a line.

    Args:
        scenarios: What all of them run.
        sim: With the world of a built-in list.
        level: Under which conditions.
        count: Contenders.
    """
    where = scenarios.name
    if where in LIST_SIZES:
        world = f"boxes ({sim.world.boxes})" if sim.world.name == "boxes" else sim.world.name
        where = f"{world}, list {where}"
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
    from rich.text import Text

    shown = (
        sheet(comparison, _headline(comparison), "", ARRIVE),
        sheet(comparison, f"{detours(comparison)}.\nTime and path over successes", "", (DETOUR, *DRIVE, DECISION)),
    )
    with console.capture() as capture:
        for one in shown:
            console.print(Text(one.title), soft_wrap=True)
            table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
            for index, column in enumerate(one.columns):
                table.add_column(column, justify="right" if index else "left", no_wrap=True, vertical="bottom")
            for row in one.rows:
                table.add_row(*(Text(cell) for cell in row))
            console.print(table)
            console.print()
        rest = "clearance, jerk, planning, where all arrive, each against each, names in full, pictures"
        console.print(Text(f"{file}: {rest}"), soft_wrap=True)
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
    for record, short in zip(comparison.records, comparison.short_names(), strict=True):
        if record.name != short:
            lines.append(f"- {_escaped(short)} is `{record.name}`.")
    return lines


def _made_with(made_with: dict[str, str | None]) -> str:
    commit = "" if made_with["commit"] is None else f", commit {made_with['commit']}"
    return f"navrl {made_with['navrl']}{commit}; numpy {made_with['numpy']}; {made_with['cpu']}; {made_with['isa']}"


def _markdown_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(_escaped(cell) for cell in cells) + " |"


def _escaped(cell: str) -> str:
    return " ".join(cell.replace("|", "\\|").split())
