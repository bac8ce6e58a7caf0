"""Pictures of a comparison, drawn with Pillow as episodes are: success, distributions, and failures to look at.

write(comparison, folder) -> [(file, caption), ...]
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from navrl.drawing.legend import Item, box, legend, line, mark, ring, whisker
from navrl.drawing.render import (
    FAINT_INK,
    GOAL,
    GOAL_AREA,
    GRID,
    INK,
    OUTCOME_COLORS,
    OUTCOME_WORDS,
    PAPER,
    PATH,
    ROBOT,
    Moment,
    Room,
)
from navrl.durable import write_file

if TYPE_CHECKING:
    from navrl.compare import Comparison
    from navrl.comparing.folder import Record

SMOOTH = 2
"""Pictures are drawn so many times larger and then reduced."""
NAMES_PX, PLOT_PX, RIGHT_PX, ROW_PX, HEAD_PX, FOOT_PX = 160, 560, 90, 34, 76, 44
"""Widths of names, plot and what is right of it; heights of a row and of what is above and below, pixels."""
OUTCOME_FILLS = {"goal": GOAL, "collision": (170, 20, 50), "timeout": (244, 190, 80)}
"""Colours of outcomes as areas: as light or dark as can be told apart without seeing red and green."""
BARS = 50
"""Bars of a distribution."""
FULL_BAR = 0.1
"""Share of the values that makes a bar as high as the row."""
PER_CONTENDER = 4
"""Failures shown of each contender."""
ROOM_PX, LINE_PX, GAP_PX, TITLE_PX = 200, 15, 12, 40
"""Longer side of a failure's room, height of a line above it, space between rooms, and height of the title, pixels."""


class Chart:
    """Rows of contenders over an axis."""

    def __init__(
        self,
        title: str,
        comparison: Comparison,
        ticks: Sequence[float],
        *,
        unit: str,
        figures: str,
        explained: Sequence[Item],
    ) -> None:
        """Draws title, legend, names and axis.

        Args:
            title: What is shown.
            comparison: One row for each of its contenders.
            ticks: Numbers of the axis, from its first to its last.
            unit: What they mean.
            figures: What the numbers right of the plot are.
            explained: Items of the legend.
        """
        self._low, self._high = ticks[0], ticks[-1]
        names = comparison.short_names()
        self._size = (NAMES_PX + PLOT_PX + RIGHT_PX, HEAD_PX + ROW_PX * len(names) + FOOT_PX)
        self._legend = legend(explained, width=self._size[0])
        self._canvas = Image.new("RGB", (self._size[0] * SMOOTH, self._size[1] * SMOOTH), PAPER)
        self.draw = ImageDraw.Draw(self._canvas)
        self.text(14, 12, title, INK, 16)
        bottom = self._size[1] - FOOT_PX
        for tick in ticks:
            self.line([(self.x(tick), HEAD_PX), (self.x(tick), bottom)], GRID, 1)
            self.text(self.x(tick), bottom + 6, f"{tick:g}", FAINT_INK, 12, anchor="ma")
        self.text(NAMES_PX + PLOT_PX / 2, bottom + 22, unit, FAINT_INK, 12, anchor="ma")
        self.text(NAMES_PX + PLOT_PX + 12, HEAD_PX - 4, figures, FAINT_INK, 12, anchor="ls")
        for row, name in enumerate(names):
            self.text(14, self.y(row), name, INK, 13, anchor="lm")

    def x(self, value: float) -> float:
        """Column of a value; those beyond the axis lie at its end."""
        share = (min(max(value, self._low), self._high) - self._low) / (self._high - self._low)
        return NAMES_PX + share * PLOT_PX

    def y(self, row: int) -> float:
        """Middle of a row."""
        return HEAD_PX + (row + 0.5) * ROW_PX

    def text(
        self, x: float, y: float, text: str, color: tuple[int, int, int], size: int, *, anchor: str = "la"
    ) -> None:
        """Writes a line."""
        font = ImageFont.load_default(size * SMOOTH)
        self.draw.text((x * SMOOTH, y * SMOOTH), text, fill=color, font=font, anchor=anchor)

    def line(self, points: Sequence[tuple[float, float]], color: tuple[int, int, int], width: float) -> None:
        """Draws a line."""
        self.draw.line([(x * SMOOTH, y * SMOOTH) for x, y in points], fill=color, width=round(width * SMOOTH))

    def box(self, x0: float, y0: float, x1: float, y1: float, color: tuple[int, int, int]) -> None:
        """Fills a rectangle."""
        self.draw.rectangle([value * SMOOTH for value in (x0, y0, x1, y1)], fill=color)

    def image(self) -> Image.Image:
        """The picture."""
        picture = self._canvas.reduce(SMOOTH)
        picture.paste(self._legend, (0, 36))
        return picture


def success(comparison: Comparison) -> Image.Image:
    """Success rates with their intervals, and beside them the shares of collisions and time-outs.

    Args:
        comparison: What came of it.

    Returns:
        RGB image.
    """
    explained = [
        Item("success with its Wilson 95 % interval", whisker(INK, PATH)),
        *(Item(words, box(OUTCOME_FILLS[outcome])) for outcome, words in OUTCOME_WORDS.items() if outcome != "running"),
    ]
    title = f"Success, level {comparison.level}, {len(comparison.scenarios):,} scenarios"
    ticks = [0, 20, 40, 60, 80, 100]
    chart = Chart(title, comparison, ticks, unit="% of the scenarios", figures="success", explained=explained)
    for row, record in enumerate(comparison.records):
        y, scores, left = chart.y(row), record.scores, 0.0
        for outcome, key in (("goal", "success"), ("collision", "collision"), ("timeout", "timeout")):
            right = left + 100 * scores[f"{key}_rate"]
            if right > left:
                chart.box(chart.x(left), y + 3, chart.x(right), y + 9, OUTCOME_FILLS[outcome])
            left = right
        low, high = (chart.x(100 * bound) for bound in scores["success_ci95"])
        chart.line([(low, y - 4), (high, y - 4)], INK, 2)
        for end in (low, high):
            chart.line([(end, y - 8), (end, y)], INK, 2)
        middle = chart.x(100 * scores["success_rate"])
        chart.box(middle - 2, y - 8, middle + 2, y, PATH)
        chart.text(NAMES_PX + PLOT_PX + 12, y, f"{100 * scores['success_rate']:.1f} %", INK, 13, anchor="lm")
    return chart.image()


def distribution(
    comparison: Comparison,
    title: str,
    values: Sequence[Sequence[float]],
    ticks: Sequence[float],
    *,
    unit: str,
    digits: int,
) -> Image.Image:
    """How a measure is distributed: bars as high as values are frequent, and the median.

    Args:
        comparison: Whose contenders.
        title: What is shown.
        values: Of each contender, maybe none.
        ticks: Numbers of the axis; values beyond count as its ends.
        unit: Their unit, if they have one.
        digits: Of the median, behind the point.

    Returns:
        RGB image.
    """
    bar = (ticks[-1] - ticks[0]) / BARS
    explained = [
        Item(f"share of the values in steps of {bar:g} {unit}".rstrip(), box(PATH)),
        Item(f"a full row: {FULL_BAR:.0%} or more".replace("%", " %")),
        Item("median", mark(OUTCOME_COLORS["collision"])),
    ]
    chart = Chart(title, comparison, ticks, unit=unit, figures="median", explained=explained)
    for row, given in enumerate(values):
        base = chart.y(row) + ROW_PX / 2 - 3
        if not len(given):
            continue
        clipped = np.clip(np.asarray(given, np.float64), ticks[0], ticks[-1])
        counts, edges = np.histogram(clipped, BARS, (ticks[0], ticks[-1]))
        # The same area for all; higher bars are cut.
        heights = np.minimum(counts / len(clipped) / FULL_BAR, 1.0) * (ROW_PX - 6)
        for height, left, right in zip(heights.tolist(), edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if height > 0:
                chart.box(chart.x(left), base - height, chart.x(right) - 0.5, base, PATH)
        median = float(np.median(clipped))
        chart.line([(chart.x(median), base - ROW_PX + 6), (chart.x(median), base)], OUTCOME_COLORS["collision"], 2)
        figure = f"{median:.{digits}f} {unit}".rstrip()
        chart.text(NAMES_PX + PLOT_PX + 12, chart.y(row), figure, INK, 13, anchor="lm")
    return chart.image()


def worst_failures(comparison: Comparison) -> list[tuple[Record, int]]:
    """Failures of each contender on the scenarios that most of the others solve; the first of equals, four at most.

    Args:
        comparison: What came of it.

    Returns:
        Contender and scenario.
    """
    solvers = np.sum([record.solved() for record in comparison.records], axis=0)
    shown = []
    for record in comparison.records:
        failed = np.flatnonzero(~np.array(record.solved()))
        worst = failed[np.argsort(-solvers[failed], kind="stable")][:PER_CONTENDER]
        shown += [(record, int(index)) for index in worst]
    return shown


def failures(comparison: Comparison) -> Image.Image | None:
    """Where robots went that failed where others did not: a row of rooms for each contender.

    Args:
        comparison: What came of it.

    Returns:
        RGB image; None if nobody failed.
    """
    shown = worst_failures(comparison)
    if not shown:
        return None
    rows = [
        [_room(comparison, record, index, name) for other, index in shown if other is record]
        for record, name in zip(comparison.records, comparison.short_names(), strict=True)
        if not all(record.solved())
    ]
    explained = [
        Item("start", ring(PATH)),
        Item("goal", ring(GOAL, GOAL_AREA)),
        Item("driven", line(PATH)),
        Item("where it ended", ring(PAPER, ROBOT)),
    ]
    # At least as wide as title and legend.
    width = max(360, *(GAP_PX + sum(room.width for room in row) for row in rows))
    head = legend(explained, width=width, indent=GAP_PX)
    top = TITLE_PX + head.height + GAP_PX
    picture = Image.new("RGB", (width, top + sum(max(room.height for room in row) for row in rows)), PAPER)
    title = f"Failures where most others arrive, level {comparison.level}"
    ImageDraw.Draw(picture).text((GAP_PX, TITLE_PX / 2 + 2), title, fill=INK, font=_font(16), anchor="lm")
    picture.paste(head, (0, TITLE_PX))
    for row in rows:
        left = GAP_PX
        for room in row:
            picture.paste(room, (left, top))
            left += room.width
        top += max(room.height for room in row)
    return picture


def _room(comparison: Comparison, record: Record, index: int, name: str) -> Image.Image:
    """The robot's path, its last pose, and lines that say whose it is and how it ended."""
    scenario, episode, track = comparison.scenarios.scenarios[index], record.episodes[index], record.tracks[index]
    path = np.concatenate([[scenario.start[:2]], track[:, :2].astype(np.float64)])
    room = Room(scenario, comparison.sim, size=ROOM_PX, supersample=4, path=path)
    # Its caption tells of one step, and needs more width than there is.
    moment = Moment(track[-1].astype(np.float64), None, path, episode.steps, 0.0, 0.0, episode.outcome)
    drawn = room.draw(moment).crop((0, 0, room.width, room.height - room.caption_height))
    picture = Image.new("RGB", (ROOM_PX + GAP_PX, drawn.height + 2 * LINE_PX + GAP_PX), PAPER)
    picture.paste(drawn, (0, 2 * LINE_PX))
    draw = ImageDraw.Draw(picture)
    draw.text((0, 0), f"{name}, scenario {index}", fill=INK, font=_font(12))
    words = f"{OUTCOME_WORDS[episode.outcome]} after {episode.time_s:g} s"
    draw.text((0, LINE_PX - 2), words, fill=OUTCOME_COLORS[episode.outcome], font=_font(11))
    return picture


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def write(comparison: Comparison, folder: Path) -> list[tuple[str, str]]:
    """Writes all pictures.

    Args:
        comparison: What came of it.
        folder: An existing folder.

    Returns:
        File and caption of each.
    """
    records = comparison.records
    longest = max(scenario.time_limit for scenario in comparison.scenarios.scenarios)
    times = [[e.time_s for e in record.episodes if e.outcome == "goal"] for record in records]
    spl = [[e.spl for e in record.episodes] for record in records]
    seconds, shares = [longest * i / 5 for i in range(6)], [0, 0.2, 0.4, 0.6, 0.8, 1.0]
    title = f"level {comparison.level}, {len(comparison.scenarios):,} scenarios"
    pictures = [
        ("success.png", "Success, collisions and time-outs", success(comparison)),
        (
            "spl.png",
            "SPL, failures at 0",
            distribution(comparison, f"SPL, {title}; failures at 0", spl, shares, unit="", digits=3),
        ),
        (
            "time.png",
            "Time to the goal, over successes",
            distribution(comparison, f"Time to the goal, {title}; successes", times, seconds, unit="s", digits=1),
        ),
        ("failures.png", "Failures where most others arrive", failures(comparison)),
    ]
    (folder / "failures.png").unlink(missing_ok=True)
    written = []
    for file, caption, picture in pictures:
        if picture is not None:
            content = io.BytesIO()
            picture.save(content, "PNG", optimize=True)
            write_file(folder / file, content.getvalue())
            written.append((file, caption))
    return written
