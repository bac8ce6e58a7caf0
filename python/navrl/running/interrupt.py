"""Ctrl+C, SIGTERM and a terminal that is closed: once to stop at the next good moment, twice to leave at once.

with Interruption(leave) as interruption:
    .requested                  whether to stop; looked at between two moves of the run
    .at_once()                  a context for work without consequences: a signal raises KeyboardInterrupt in it
Interrupted                     the run was stopped and saved
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

EXIT_CODE = 130
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(KeyboardInterrupt):
    """The run was stopped by the user and saved; the text says how to resume."""


class Interruption:
    """Takes the place of the signals' handlers while it is entered; in threads but the main one it does nothing."""

    def __init__(self, leave: Callable[[], None]) -> None:
        """Prepares.

        Args:
            leave: Called in the handler just before the process ends at a second signal; it must be quick.
        """
        self.requested = False
        """Whether a signal came."""
        self._leave = leave
        self._raising = False
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        """Sets the handlers."""
        if threading.current_thread() is threading.main_thread():
            # What is ignored stays so: `nohup` lets a run outlive its terminal.
            heeded = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
            self._previous = {number: signal.signal(number, self._handle) for number in heeded}
        return self

    def __exit__(self, *_: object) -> None:
        """Puts the former handlers back."""
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Marks work that can be thrown away.

        Raises:
            KeyboardInterrupt: A signal came, before or during the work.
        """
        self._raising = True
        try:
            if self.requested:
                raise KeyboardInterrupt
            yield
        finally:
            self._raising = False

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        if self.requested:
            self._leave()
            os._exit(EXIT_CODE)
        self.requested = True
        if self._raising:
            raise KeyboardInterrupt
