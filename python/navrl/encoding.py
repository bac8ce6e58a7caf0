"""What a network sees: the fixed encoding of an observation (numpy only, so that acting never imports torch).

An observation holds `bins` ranges (m), the goal's distance (m) and angle (rad), and the previous command divided by its
limits (equation 2). "raw" passes it on. "inverse" spreads out what matters: near obstacles by an inverse range, and the
goal's direction without the jump at +-pi.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Encoding = Literal["inverse", "raw"]

GOAL_AND_COMMAND = 4
"""Numbers that follow the bins in an observation: goal distance, goal angle, v / v_max, omega / omega_max."""


def encoded_size(bins: int, encoding: Encoding) -> int:
    """Number of inputs of a network.

    Args:
        bins: Bins of the lidar.
        encoding: "inverse" or "raw".

    Returns:
        `bins` + 6 for "inverse", `bins` + 4 for "raw".
    """
    return bins + (6 if encoding == "inverse" else GOAL_AND_COMMAND)


def encode_observations(observations: NDArray[np.float32], encoding: Encoding) -> NDArray[np.float32]:
    """Encodes observations for a network, row by row.

    Args:
        observations: (..., bins + 4) float32: ranges (m), goal distance (m), goal angle (rad), v / v_max,
            omega / omega_max.
        encoding: "inverse" or "raw".

    Returns:
        (..., encoded_size) float32. "inverse": 1 / (range + 0.3) - 1 | distance / 5 - 1, sin angle, cos angle,
        min(distance, 1) | v / v_max, omega / omega_max. "raw": the observations themselves.
    """
    if encoding == "raw":
        return observations
    bins = observations.shape[-1] - GOAL_AND_COMMAND
    distance, angle = observations[..., bins], np.ascontiguousarray(observations[..., bins + 1])
    encoded = np.empty((*observations.shape[:-1], bins + 6), np.float32)
    encoded[..., :bins] = np.float32(1.0) / (observations[..., :bins] + np.float32(0.3)) - np.float32(1.0)
    encoded[..., bins] = distance / np.float32(5.0) - np.float32(1.0)
    encoded[..., bins + 1] = np.sin(angle)
    encoded[..., bins + 2] = np.cos(angle)
    encoded[..., bins + 3] = np.minimum(distance, np.float32(1.0))
    encoded[..., bins + 4 :] = observations[..., bins + 2 :]
    return encoded
