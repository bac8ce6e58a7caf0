"""What a person sees of a run: a live display on a terminal, plain lines elsewhere; all on stderr.

Monitor(steps, episodes)                    where the run ends
    .line(text)
    .due -> bool;  .show(progress, rates, fraction)
    .validation(steps, scores, best)
    .check_saturation(share)
    .leave();  .close()
result_lines(summary, folder) -> list of lines
"""

from __future__ import annotations

import shlex
import time
from collections import deque
from math import isnan
from pathlib import Path
from typing import Any

from rich.console import Group
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from navrl.display import Display
from navrl.metrics import Scores
from navrl.running.training_metrics import Progress, Rates

BAR_WIDTH = 56
SPEED_WINDOW_S = 30.0
"""Speeds and the time left are taken from so much of the recent past."""

SATURATED_BOUND = 0.9
"""Share of the actor's outputs beyond 0.99 in size that is a fault when it lasts."""
SATURATED_ROWS = 5
"""Rows of metrics in a row above that bound which make it last."""

VALIDATION_HEADER = "validation at    success  collision   time-out      SPL  return"


class Monitor:
    """Shows how a run goes."""

    def __init__(self, steps: int, episodes: int) -> None:
        """Begins, on stderr.

        Args:
            steps: Environment steps at which the run ends, 0 if not by steps.
            episodes: Episodes at which it ends, 0 if not by episodes.
        """
        self._display = Display()
        self._steps, self._episodes = steps, episodes
        # (seconds, fraction, progress) of the recent past
        self._past: deque[tuple[float, float, Progress]] = deque()
        self._validations = 0
        self._saturated_rows = 0

    def line(self, text: str, style: str = "") -> None:
        """Prints a line that stays."""
        self._display.line(text, style)

    @property
    def due(self) -> bool:
        """Whether it is time for `show`."""
        return self._display.due

    def show(self, progress: Progress, rates: Rates, fraction: float) -> None:
        """Shows how far the run is.

        Args:
            progress: Counts and seconds.
            rates: Means over the newest training episodes.
            fraction: Share of the run that is over, in [0, 1].
        """
        now = time.monotonic()
        self._past.append((now, fraction, progress))
        while now - self._past[0][0] > SPEED_WINDOW_S and len(self._past) > 2:
            self._past.popleft()
        ahead, counts, training = self._describe(progress, rates, fraction)
        bar = Table.grid(padding=(0, 1))
        bar.add_row(ProgressBar(total=1.0, completed=fraction, width=BAR_WIDTH), ahead)
        lines = Text(f"{counts}\n{training}", style="dim", no_wrap=True, overflow="ellipsis")
        self._display.show(f"{ahead}  {counts}  {training}", Group(bar, lines))

    def _describe(self, progress: Progress, rates: Rates, fraction: float) -> tuple[str, str, str]:
        """How far the run is, how fast it goes, and how the newest training episodes went."""
        (then, fraction_then, before), (now, _, _) = self._past[0], self._past[-1]
        ahead = f"{100 * fraction:3.0f} %"
        if fraction > fraction_then:
            ahead += f"  {_duration((1 - fraction) * (now - then) / (fraction - fraction_then))} left"
        counts = f"{progress.steps:,}{_of(self._steps)} steps"
        seconds = progress.train_s - before.train_s
        if seconds > 0:
            sps, ups = (progress.steps - before.steps) / seconds, (progress.updates - before.updates) / seconds
            counts += f"  {sps:,.0f} steps/s  {ups:,.0f} updates/s"
        training = f"{progress.episodes:,}{_of(self._episodes)} episodes"
        if not isnan(rates.success):
            training += (
                f"  success {100 * rates.success:.1f} %  collision {100 * rates.collision:.1f} %  "
                f"time-out {100 * rates.timeout:.1f} %  return {rates.total_return:.1f}"
            )
        return ahead, counts, training

    def validation(self, steps: int, scores: Scores, *, best: bool) -> None:
        """Prints the scores of a validation.

        Args:
            steps: Environment steps so far.
            scores: On the validation list.
            best: Whether no earlier one was better.
        """
        if self._validations == 0:
            self.line(VALIDATION_HEADER, "bold")
        self._validations += 1
        success, collision, timeout = (
            f"{100 * rate:8.1f} %" for rate in (scores.success_rate, scores.collision_rate, scores.timeout_rate)
        )
        mark = "  best" if best else ""
        means = f"{scores.spl:8.3f} {scores.average_return:7.1f}"
        self.line(f"{steps:13,} {success} {collision} {timeout} {means}{mark}", "green" if best else "")

    def check_saturation(self, share: float | None) -> None:
        """Names the fault of a saturated actor, once.

        Args:
            share: Share of the actor's outputs beyond 0.99 in size since the last row; None without an actor step.
        """
        self._saturated_rows = self._saturated_rows + 1 if share is not None and share > SATURATED_BOUND else 0
        if self._saturated_rows == SATURATED_ROWS:
            self.line(
                f"the actor saturates: {100 * (share or 0):.0f} % of its outputs are at their limits, where it hardly "
                "learns any more; raise learner.pretanh_penalty or lower learner.actor_lr",
                "bold red",
            )

    def leave(self) -> None:
        """Puts the terminal in order from within a signal's handler, where the process ends next."""
        self._display.leave()

    def close(self) -> None:
        """Ends the live display."""
        self._display.close()


def _of(limit: int) -> str:
    return f" of {limit:,}" if limit else ""


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def result_lines(summary: dict[str, Any], folder: Path) -> list[str]:
    """What a finished run says in the end.

    Args:
        summary: The content of summary.json.
        folder: The run folder.

    Returns:
        Lines: the test's result, where the policy is, and a command to try next.
    """
    lines = [
        f"trained {summary['env_steps']:,} steps and {summary['updates']:,} updates in {summary['train_s']:.1f} s "
        f"(whole run {summary['wall_s']:.1f} s)"
    ]
    if summary["scores"] is not None:
        tested, low, high = summary["scores"]["episodes"], *(100 * bound for bound in summary["success_ci95"])
        lines += [
            f"test, {tested:,} unseen scenarios: success {100 * summary['success_rate']:.1f} % "
            f"(95 % interval {low:.1f} to {high:.1f} %)",
            f"collisions {100 * summary['collision_rate']:.1f} %, time-outs {100 * summary['timeout_rate']:.1f} %, "
            f"SPL {summary['spl']:.3f}",
        ]
    lines.append(f"policy: {folder / 'policy'}, best in validation, after {summary['best_steps']:,} steps")
    lines.append(f"watch it drive: navrl play {shlex.quote(str(folder))} --out drive.gif")
    return lines
