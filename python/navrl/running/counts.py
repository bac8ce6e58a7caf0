"""Where a run is and what ends it.

Counts                      steps, owed updates, and when reports are due
Limits(steps, episodes, until)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass
class Counts:
    """Where a run is. With the arrays of its parts, it determines every later move."""

    next_row: int
    """Steps at which the next row of metrics is due."""
    next_validation: int
    """Steps at which the next validation is due."""
    steps: int = 0
    """Environment steps of all robots together."""
    owed: float = 0.0
    """Updates that the steps so far call for and that have not been made."""
    last_row: int = 0
    """Steps of the newest row."""
    last_validation: int = 0
    """Steps of the newest validation."""
    passed: int = 0
    """Validations in a row at or above training.until."""


class Limits(NamedTuple):
    """What ends a run; 0 is no limit."""

    steps: int
    episodes: int
    until: float

    def share(self, steps: int, episodes: int) -> float:
        """Share of the run that is over, in [0, 1]."""
        shares = [count / limit for count, limit in ((steps, self.steps), (episodes, self.episodes)) if limit]
        return min(1.0, max(shares))
