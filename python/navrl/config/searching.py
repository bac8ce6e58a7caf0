"""Which part of a setting's range `navrl tune` searches: declared beside the setting."""

from dataclasses import dataclass
from typing import get_type_hints


@dataclass(frozen=True)
class Search:
    """The part of a setting's range that `navrl tune` searches."""

    low: float
    """Smallest value tried."""
    high: float
    """Largest value tried."""
    log: bool = False
    """Whether values are drawn uniformly by their logarithm."""


def searched(table: type) -> dict[str, Search]:
    """What `navrl tune` varies of a table of settings, by key."""
    hints = get_type_hints(table, include_extras=True)
    parts = {key: getattr(hint, "__metadata__", ()) for key, hint in hints.items()}
    return {key: part for key, extras in parts.items() for part in extras if isinstance(part, Search)}
