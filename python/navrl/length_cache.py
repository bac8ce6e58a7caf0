"""Lengths of shortest paths that were computed before, in the user's cache folder.

One SQLite file, because it keeps its content whole when several commands write at once or one is killed. A cache that
cannot be used costs time and nothing else.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path

LOCK_WAIT_S = 2.0
"""Seconds to wait for another command's write."""

FAILURES = (OSError, RuntimeError, sqlite3.Error)
"""No folder, no home, no space, another's lock, a damaged file."""


def cache_file() -> Path:
    """The file: navrl/lengths.sqlite3 in $XDG_CACHE_HOME, or in ~/.cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "navrl" / "lengths.sqlite3"


def read(keys: Iterable[str]) -> dict[str, float]:
    """Looks lengths up.

    Args:
        keys: Names of what was measured.

    Returns:
        Lengths (m) of the keys that are known.
    """
    found: dict[str, float] = {}
    with suppress(*FAILURES), _open() as database:
        for key in keys:
            row = database.execute("SELECT length FROM lengths WHERE key = ?", (key,)).fetchone()
            if row is not None and isinstance(row[0], float) and row[0] >= 0:
                found[key] = row[0]
    return found


def write(lengths: Mapping[str, float]) -> None:
    """Keeps lengths for later.

    Args:
        lengths: Lengths (m) by key.
    """
    if not lengths:
        return
    with suppress(*FAILURES), _open() as database, database:
        database.executemany("INSERT OR REPLACE INTO lengths VALUES (?, ?)", lengths.items())


@contextmanager
def _open() -> Iterator[sqlite3.Connection]:
    file = cache_file()
    file.parent.mkdir(parents=True, exist_ok=True)
    with closing(sqlite3.connect(file, timeout=LOCK_WAIT_S)) as database:
        database.execute("CREATE TABLE IF NOT EXISTS lengths (key TEXT PRIMARY KEY, length REAL NOT NULL)")
        yield database
