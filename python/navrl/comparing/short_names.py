"""Names of contenders as tables and pictures show them: short, and still each of its own.

short_names(["dwa", "/data/2026/runs/night/seed0"]) -> ["dwa", ".../night/seed0"]
"""

from collections import Counter
from collections.abc import Sequence
from itertools import count

LONGEST = 19
"""Characters of a name: so that the terminal's tables fit into 80 columns."""


def short_names(names: Sequence[str], longest: int = LONGEST) -> list[str]:
    """Names of at most so many characters: of a long path its end, as much of it as fits.

    Two that would look alike get a number: "...seed0 #2".

    Args:
        names: Different from each other.
        longest: Characters, at least 8.

    Returns:
        One for each name, different from each other; those that are short enough as they are.
    """
    ends = Counter(_end(name, longest) for name in names if len(name) > longest)
    shorts, used = [], set(names)
    for name in names:
        short = name if len(name) <= longest else _end(name, longest)
        if short != name and (ends[short] > 1 or short in used):
            marks = (f" #{number}" for number in count(1))
            short = next(s for s in (_end(name, longest - len(mark)) + mark for mark in marks) if s not in used)
        used.add(short)
        shorts.append(short)
    return shorts


def _end(name: str, longest: int) -> str:
    """The last folders that fit, or if not even the last one does, its end."""
    parts = name.split("/")
    for first in range(1, len(parts)):
        end = "/".join(["...", *parts[first:]])
        if len(end) <= longest:
            return end
    return "..." + name[3 - longest :]
