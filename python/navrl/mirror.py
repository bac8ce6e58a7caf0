"""The left-right mirror of what networks see and do (numpy only, as `navrl.encoding`).

    mirror_encoded(bins, encoding) -> Mirror(permutation, signs);  mirror_actions() -> Mirror

Whatever a robot meets could lie the other way round, and then it should turn the other way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navrl.encoding import Encoding, encoded_size

ACTIONS = 2
"""Numbers in an action: a1 (forward) and a2 (turn), equation 1."""


class Mirror(NamedTuple):
    """A reflection left to right: column j of the mirrored row is `signs[j]` times column `permutation[j]`."""

    permutation: NDArray[np.intp]
    """(columns,) where each column comes from."""
    signs: NDArray[np.float32]
    """(columns,) +1 or -1."""


def mirror_encoded(bins: int, encoding: Encoding) -> Mirror:
    """The mirror of an encoded observation: bins reversed; goal angle and previous omega negated.

    Args:
        bins: Bins of the lidar, whose beams must lie symmetrically about the robot's x axis.
        encoding: "inverse" or "raw".

    Returns:
        The mirror of `encoded_size(bins, encoding)` columns.
    """
    columns = encoded_size(bins, encoding)
    permutation = np.arange(columns)
    permutation[:bins] = permutation[:bins][::-1]
    signs = np.ones(columns, np.float32)
    # The angle itself ("raw") or its sine ("inverse") follows the distance; the previous omega comes last.
    signs[[bins + 1, columns - 1]] = -1.0
    return Mirror(permutation, signs)


def mirror_actions() -> Mirror:
    """The mirror of an action: a2, the turn, negated."""
    return Mirror(np.arange(ACTIONS), np.array([1.0, -1.0], np.float32))
