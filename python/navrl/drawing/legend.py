"""What the marks of a picture mean: symbols with words, in as many rows as they need.

legend([Item("goal", ring(GOAL)), Item("driven path", line(PATH))], width=560) -> RGB image
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw, ImageFont

Color = tuple[int, int, int]
Symbol = Callable[[ImageDraw.ImageDraw, float, float, float], None]
"""Draws a symbol: on what, from which column and around which row (pixels), and how many pixels a unit has."""

SMOOTH = 3
"""Drawn so many times larger and then reduced."""
ROW_PX, FOOT_PX, TEXT_PX = 18, 4, 11
SYMBOL_PX, WORD_GAP_PX, ITEM_GAP_PX = 18, 5, 16
PAPER: Color = (255, 255, 255)
INK: Color = (82, 89, 102)


@dataclass(frozen=True)
class Item:
    """A symbol and what it means."""

    label: str
    symbol: Symbol | None = None
    """None: words alone."""
    width: float = SYMBOL_PX
    """Width of the symbol (pixels)."""

    def wide(self) -> float:
        """Pixels that symbol and words take."""
        words = _font(TEXT_PX).getlength(self.label)
        return words if self.symbol is None else self.width + WORD_GAP_PX + words


def ring(edge: Color, fill: Color = PAPER) -> Symbol:
    """A disc with an edge."""

    def draw(on: ImageDraw.ImageDraw, x: float, y: float, unit: float) -> None:
        r, middle = 6 * unit, x + SYMBOL_PX * unit / 2
        on.ellipse((middle - r, y - r, middle + r, y + r), fill=fill, outline=edge, width=round(1.6 * unit))

    return draw


def line(color: Color, width: float = 2.5) -> Symbol:
    """A line of so many pixels."""

    def draw(on: ImageDraw.ImageDraw, x: float, y: float, unit: float) -> None:
        on.line((x, y, x + SYMBOL_PX * unit, y), fill=color, width=round(width * unit))

    return draw


def mark(color: Color) -> Symbol:
    """An upright line."""

    def draw(on: ImageDraw.ImageDraw, x: float, y: float, unit: float) -> None:
        middle = x + SYMBOL_PX * unit / 2
        on.line((middle, y - 7 * unit, middle, y + 7 * unit), fill=color, width=round(2 * unit))

    return draw


def box(color: Color) -> Symbol:
    """A filled rectangle."""

    def draw(on: ImageDraw.ImageDraw, x: float, y: float, unit: float) -> None:
        on.rectangle((x, y - 4 * unit, x + SYMBOL_PX * unit, y + 4 * unit), fill=color)

    return draw


def whisker(color: Color, middle: Color) -> Symbol:
    """A value with its interval."""

    def draw(on: ImageDraw.ImageDraw, x: float, y: float, unit: float) -> None:
        end = x + SYMBOL_PX * unit
        on.line((x, y, end, y), fill=color, width=round(2 * unit))
        for place in (x, end):
            on.line((place, y - 4 * unit, place, y + 4 * unit), fill=color, width=round(2 * unit))
        half = (x + end) / 2
        on.rectangle((half - 2 * unit, y - 4 * unit, half + 2 * unit, y + 4 * unit), fill=middle)

    return draw


def ramp(colors: Sequence[Color]) -> Symbol:
    """Colours side by side, a pixel each."""

    def draw(on: ImageDraw.ImageDraw, x: float, y: float, unit: float) -> None:
        for place, color in enumerate(colors):
            on.rectangle((x + place * unit, y - 4 * unit, x + (place + 1) * unit, y + 4 * unit), fill=color)

    return draw


def legend(items: Sequence[Item], *, width: int, indent: int = 14) -> Image.Image:
    """Items from left to right, and on in further rows.

    Args:
        items: What to explain.
        width: Of the picture, pixels.
        indent: Free at its left and right, pixels.

    Returns:
        RGB image of that width.
    """
    places, left, row = [], float(indent), 0
    for item in items:
        if left > indent and left + item.wide() > width - indent:
            left, row = float(indent), row + 1
        places.append((left, (row + 0.5) * ROW_PX))
        left += item.wide() + ITEM_GAP_PX
    height = (row + 1) * ROW_PX + FOOT_PX
    canvas = Image.new("RGB", (width * SMOOTH, height * SMOOTH), PAPER)
    draw = ImageDraw.Draw(canvas)
    for item, (x, y) in zip(items, places, strict=True):
        words = x
        if item.symbol is not None:
            item.symbol(draw, x * SMOOTH, y * SMOOTH, SMOOTH)
            words += item.width + WORD_GAP_PX
        place = (words * SMOOTH, y * SMOOTH)
        draw.text(place, item.label, fill=INK, font=_font(TEXT_PX * SMOOTH), anchor="lm")
    return canvas.reduce(SMOOTH)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
