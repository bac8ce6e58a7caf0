"""Names of contenders as tables and pictures show them: short, and still each of its own.

short_names(["dwa", "/data/2026/runs/night/seed0"]) -> ["dwa", ".../night/seed0"]
"""

from collections import Counter
from collections.abc import Sequence

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
    shorts = [name if len(name) <= longest else _end(name, longest) for name in names]
    counts, used = Counter(shorts), set(names)
    for place, short in enumerate(shorts):
        if counts[short] == 1:
            continue
        number = 1
        while short in used or shorts.count(short) > 1:
            mark = f" #{number}"
            short = _end(names[place], longest - len(mark)) + mark
            number += 1
        shorts[place] = short
    return shorts


def _end(name: str, longest: int) -> str:
    """The last folders that fit, or if not even the last one does, its end."""
    parts = name.split("/")
    for first in range(1, len(parts)):
        end = "/".join(["...", *parts[first:]])
        if len(end) <= longest:
            return end
    return "..." + name[len(name) - (longest - 3) :]
