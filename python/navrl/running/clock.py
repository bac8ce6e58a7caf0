"""The seconds that a run reports, added up over all processes that worked on it.

RunClock()
    .resume(saved)               with what .state() returned in the process before
    .start()                     before the first move of this process
    with .updating(): ...        counts as update_s;  with .evaluating(): ...  as eval_s
    .train_s, .update_s, .eval_s, .wall_s;  .state() -> dict
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

_claimed = False
"""Whether a run of this process has taken the time since its start; a second run counts from its own beginning."""


class RunClock:
    """Stopwatches of one run. train_s runs from the first environment step and stands still during evaluation."""

    def __init__(self) -> None:
        """Starts wall_s, at the start of the process for its first run."""
        global _claimed
        self._process_start = time.monotonic() - (0.0 if _claimed else _process_age())
        _claimed = True
        self.update_s = 0.0
        """Seconds in updates."""
        self.eval_s = 0.0
        """Seconds in validations and the test."""
        self.trained_s = 0.0
        """train_s at the end of the last update; what a run reports."""
        self._train_before = self._wall_before = self._eval_before = 0.0
        self._started: float | None = None

    def resume(self, saved: Mapping[str, float]) -> None:
        """Adds the seconds of the processes before, before `start`.

        Args:
            saved: What `state` returned there.
        """
        self.update_s, self.eval_s, self.trained_s = saved["update_s"], saved["eval_s"], saved["trained_s"]
        self._train_before, self._wall_before = saved["train_s"], saved["wall_s"]

    def start(self) -> None:
        """Starts train_s."""
        self._started = time.monotonic()
        self._eval_before = self.eval_s

    @property
    def train_s(self) -> float:
        """Seconds of training, with logs and checkpoints, without evaluation."""
        if self._started is None:
            return self._train_before
        return self._train_before + time.monotonic() - self._started - (self.eval_s - self._eval_before)

    @property
    def wall_s(self) -> float:
        """Seconds from the start of the process, and of the processes before it up to their last checkpoints."""
        return self._wall_before + time.monotonic() - self._process_start

    @contextmanager
    def updating(self) -> Iterator[None]:
        """Counts the time within as update_s."""
        start = time.monotonic()
        yield
        self.update_s += time.monotonic() - start
        self.trained_s = self.train_s

    @contextmanager
    def evaluating(self) -> Iterator[None]:
        """Counts the time within as eval_s, also when it is interrupted."""
        start = time.monotonic()
        try:
            yield
        finally:
            self.eval_s += time.monotonic() - start

    def state(self) -> dict[str, float]:
        """All clocks, for the next process."""
        names = ("train_s", "trained_s", "update_s", "eval_s", "wall_s")
        return {name: getattr(self, name) for name in names}


def _process_age() -> float:
    """Seconds since this process started, to 0.01 s; 0 where the system does not tell."""
    try:
        # The name in brackets may hold blanks; the start, in clock ticks since boot, is the 22nd field.
        fields = Path("/proc/self/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        started = int(fields[19]) / os.sysconf("SC_CLK_TCK")
        return max(0.0, time.clock_gettime(time.CLOCK_BOOTTIME) - started)
    except (OSError, ValueError, IndexError, AttributeError):
        return 0.0
