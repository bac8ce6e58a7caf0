"""Two pieces of work beside each other, in two threads where the machine has room for both.

    with Beside(say, free) as beside: result = beside.do(aside, own)

Neither may read what the other one writes: then whether they run at the same time or one after the other makes no
difference to any bit.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Self, TypeVar

T = TypeVar("T")

WINDOW = 200
"""Pairs after which it is decided whether two threads were of use."""
PAUSE = 2_000
"""Pairs that are then done in one thread, before two are tried again."""


class Beside:
    """A second thread, which is left alone while waiting for it costs more than doing its work oneself."""

    def __init__(self, say: Callable[[str], None], free: Callable[[bool], None]) -> None:
        """Starts no thread yet.

        Args:
            say: Takes a line when one thread has to do.
            free: Is told when the other thread begins (False) and when it has ended (True), there.
        """
        self._say, self._free = say, free
        self._said = False
        self._thread = ThreadPoolExecutor(1, "beside")
        self._alone = 0
        """Pairs to do in one thread."""
        self._forget()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Ends the thread."""
        self._thread.shutdown()

    def do(self, aside: Callable[[], T], own: Callable[[], None]) -> T:
        """Does both, and returns when both have ended.

        Args:
            aside: For the other thread.
            own: For this one.

        Returns:
            What `aside` returned.
        """
        if self._alone > 0:
            self._alone -= 1
            result = aside()
            own()
            return result
        self._free(False)
        future = self._thread.submit(self._timed, aside)
        try:
            own()
        finally:
            self._wait(future)
        if self._pairs >= WINDOW:
            self._decide()
        return future.result()

    def _timed(self, aside: Callable[[], T]) -> T:
        start = time.thread_time()
        try:
            return aside()
        finally:
            self._needed += time.thread_time() - start
            self._free(True)

    def _wait(self, future: Future[T]) -> None:
        start = time.monotonic()
        wait([future])
        self._waited += time.monotonic() - start
        self._pairs += 1

    def _decide(self) -> None:
        """Falls back to one thread if the waits were longer than the work that was waited for."""
        if self._waited > self._needed:
            self._alone = PAUSE
            if not self._said:
                self._say("the machine is busy: robots and updates take turns for a while, with the same results")
            self._said = True
        self._forget()

    def _forget(self) -> None:
        """Begins to count anew: pairs, seconds waited, and seconds of work that was waited for."""
        self._pairs, self._waited, self._needed = 0, 0.0, 0.0
