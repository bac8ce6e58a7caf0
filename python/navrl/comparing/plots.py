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

from navrl.drawing.render import (
    CAPTION_PX,
    FAINT_INK,
    GRID,
    INK,
    OUTCOME_COLORS,
    OUTCOME_WORDS,
    PAPER,
    PATH,
    Moment,
    Room,
)
from navrl.durable import write_file

if TYPE_CHECKING:
    from navrl.compare import Comparison
    from navrl.comparing.folder import Record

SMOOTH = 2
"""Pictures are drawn so many times larger and then reduced."""
NAMES_PX, PLOT_PX, RIGHT_PX, ROW_PX, HEAD_PX, FOOT_PX = 190, 560, 90, 34, 44, 44
"""Widths of names, plot and what is right of it; heights of a row and of what is above and below, pixels."""
BARS = 60
"""Bars of a distribution."""
PER_CONTENDER = 4
"""Failures shown of each contender."""
ROOM_PX, LINE_PX, GAP_PX = 200, 15, 10
"""Longer side of a failure's room, height of a line above it, and space between rooms, pixels."""


class Chart:
    """Rows of contenders over an axis."""

    def __init__(self, title: str, names: Sequence[str], ticks: Sequence[float], unit: str) -> None:
        """Draws title, names and axis.

        Args:
            title: What is shown.
            names: One row each.
            ticks: Numbers of the axis, from its first to its last.
            unit: What they mean.
        """
        self._low, self._high = ticks[0], ticks[-1]
        self._size = (NAMES_PX + PLOT_PX + RIGHT_PX, HEAD_PX + ROW_PX * len(names) + FOOT_PX)
        self._canvas = Image.new("RGB", (self._size[0] * SMOOTH, self._size[1] * SMOOTH), PAPER)
        self.draw = ImageDraw.Draw(self._canvas)
        self.text(14, 12, title, INK, 16)
        bottom = self._size[1] - FOOT_PX
        for tick in ticks:
            self.line([(self.x(tick), HEAD_PX), (self.x(tick), bottom)], GRID, 1)
            self.text(self.x(tick), bottom + 6, f"{tick:g}", FAINT_INK, 12, anchor="ma")
        self.text(NAMES_PX + PLOT_PX / 2, bottom + 22, unit, FAINT_INK, 12, anchor="ma")
        for row, name in enumerate(names):
            self.text(14, self.y(row), _cut(name), INK, 13, anchor="lm")

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
        return self._canvas.reduce(SMOOTH)


def success(comparison: Comparison) -> Image.Image:
    """Success rates with their intervals, and beside them the shares of collisions and time-outs.

    Args:
        comparison: What came of it.

    Returns:
        RGB image.
    """
    names = [record.name for record in comparison.records]
    title = f"Success, level {comparison.level}: Wilson 95 % intervals; green goal, red collision, brown time-out"
    chart = Chart(title, names, [0, 20, 40, 60, 80, 100], "% of the scenarios")
    for row, record in enumerate(comparison.records):
        y, scores, left = chart.y(row), record.scores, 0.0
        for outcome, key in (("goal", "success"), ("collision", "collision"), ("timeout", "timeout")):
            right = left + 100 * scores[f"{key}_rate"]
            if right > left:
                chart.box(chart.x(left), y + 3, chart.x(right), y + 9, OUTCOME_COLORS[outcome])
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
    comparison: Comparison, title: str, values: Sequence[Sequence[float]], ticks: Sequence[float], unit: str
) -> Image.Image:
    """How a measure is distributed: bars as high as values are frequent, and the median.

    Args:
        comparison: Whose contenders.
        title: What is shown.
        values: Of each contender, maybe none.
        ticks: Numbers of the axis; values beyond count as its ends.
        unit: What they mean.

    Returns:
        RGB image.
    """
    chart = Chart(title, [record.name for record in comparison.records], ticks, unit)
    for row, given in enumerate(values):
        base = chart.y(row) + ROW_PX / 2 - 3
        if not len(given):
            continue
        clipped = np.clip(np.asarray(given, np.float64), ticks[0], ticks[-1])
        counts, edges = np.histogram(clipped, BARS, (ticks[0], ticks[-1]))
        # The same area for all: a bar of 10 % of the values is as high as the row, higher ones are cut.
        heights = np.minimum(counts / len(clipped) / 0.1, 1.0) * (ROW_PX - 6)
        for height, left, right in zip(heights.tolist(), edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if height > 0:
                chart.box(chart.x(left), base - height, chart.x(right) - 0.5, base, PATH)
        median = float(np.median(clipped))
        chart.line([(chart.x(median), base - ROW_PX + 6), (chart.x(median), base)], OUTCOME_COLORS["collision"], 2)
        chart.text(NAMES_PX + PLOT_PX + 12, chart.y(row), f"{median:.3g}", INK, 13, anchor="lm")
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
        [_room(comparison, record, index) for other, index in shown if other is record]
        for record in comparison.records
        if not all(record.solved())
    ]
    width = max(sum(room.width for room in row) for row in rows)
    picture = Image.new("RGB", (width, sum(max(room.height for room in row) for row in rows)), PAPER)
    top = 0
    for row in rows:
        left = 0
        for room in row:
            picture.paste(room, (left, top))
            left += room.width
        top += max(room.height for room in row)
    return picture


def _room(comparison: Comparison, record: Record, index: int) -> Image.Image:
    """The robot's path, its last pose, and a line that says whose it is and how it ended."""
    scenario, episode, track = comparison.scenarios.scenarios[index], record.episodes[index], record.tracks[index]
    path = np.concatenate([[scenario.start[:2]], track[:, :2].astype(np.float64)])
    room = Room(scenario, comparison.sim, size=ROOM_PX, supersample=4, path=path)
    # Its caption tells of one step, and needs more width than there is.
    moment = Moment(track[-1].astype(np.float64), None, path, episode.steps, 0.0, 0.0, episode.outcome)
    drawn = room.draw(moment).crop((0, 0, room.width, room.height - CAPTION_PX))
    picture = Image.new("RGB", (room.width + GAP_PX, drawn.height + 2 * LINE_PX + GAP_PX), PAPER)
    picture.paste(drawn, (0, 2 * LINE_PX))
    draw, small = ImageDraw.Draw(picture), ImageFont.load_default(11)
    draw.text((2, 2), _cut(record.name), fill=INK, font=small)
    words = f"{index}: {OUTCOME_WORDS[episode.outcome]}, {episode.time_s:g} s"
    draw.text((2, 2 + LINE_PX), words, fill=OUTCOME_COLORS[episode.outcome], font=small)
    return picture


def _cut(name: str) -> str:
    return name if len(name) <= 24 else "..." + name[-21:]


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
    bars = "bars of 1/60 of the axis, a tenth of the values as high as the row; red: the median"
    pictures = [
        ("success.png", "Success with Wilson 95 % intervals; goal, collision, time-out", success(comparison)),
        (
            "spl.png",
            f"SPL of all scenarios, failures at 0: {bars}",
            distribution(comparison, "SPL", spl, [0, 0.2, 0.4, 0.6, 0.8, 1.0], "SPL, failures at 0"),
        ),
        (
            "time.png",
            f"Time to the goal over successes: {bars}",
            distribution(comparison, "Time to the goal", times, [longest * i / 5 for i in range(6)], "s, successes"),
        ),
        ("failures.png", "Failures where most others arrive; the number is the scenario's", failures(comparison)),
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
