"""What long work shows of itself on stderr: a live display on a terminal, plain lines elsewhere.

with Display() as display:
    .line(text)                              stays
    if .due: .show(plain, live)              is replaced by the next one on a terminal
"""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.live import Live
from rich.text import Text

if TYPE_CHECKING:
    from rich.console import RenderableType

LIVE_PERIOD_S = 0.25
PLAIN_PERIOD_S = 5.0


class Display:
    """Lines that stay, and how far the work is."""

    def __init__(self, *, at_once: bool = True) -> None:
        """Begins, on stderr.

        Args:
            at_once: Whether the first `show` is due at once, and not after a period.
        """
        self._console = Console(stderr=True, highlight=False)
        live = self._console.is_terminal and not self._console.is_dumb_terminal
        self._live = Live(console=self._console, auto_refresh=False, transient=True) if live else None
        self._period = LIVE_PERIOD_S if live else PLAIN_PERIOD_S
        self._next = 0.0 if at_once else time.monotonic() + self._period
        if self._live is not None:
            self._live.start()

    def line(self, text: str, style: str = "") -> None:
        """Prints a line that stays."""
        self._console.print(Text(text, style=style), soft_wrap=True)

    @property
    def due(self) -> bool:
        """Whether it is time for `show`."""
        return time.monotonic() >= self._next

    def show(self, plain: str, live: RenderableType | None = None) -> None:
        """Shows how far the work is.

        Args:
            plain: The line of this moment.
            live: What a terminal shows instead; the line if None.
        """
        self._next = time.monotonic() + self._period
        if self._live is None:
            self._console.print(Text(plain), soft_wrap=True)
        else:
            self._live.update(Text(plain) if live is None else live, refresh=True)

    def leave(self) -> None:
        """Puts the terminal in order from within a signal's handler, where the process ends next."""
        if self._live is not None:
            os.write(sys.stderr.fileno(), b"\x1b[?25h\n")

    def close(self) -> None:
        """Ends the live display."""
        if self._live is not None:
            self._live.stop()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the live display."""
        self.close()
