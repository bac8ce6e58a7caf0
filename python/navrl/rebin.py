"""From the scan of a real lidar to the bins of an observation (equation 2), with the faults that real scans have.

| reading | taken as |
|---|---|
| +inf, or beyond the policy's range | the policy's largest range: nothing is in range |
| -inf or 0 | 0 m: something is too close to be measured |
| nearer than the policy's smallest range | that smallest range |
| NaN, negative | invalid: the beam counts for nothing, never for "clear" |
| a bin without a valid beam | 0 m: what is not seen is not clear |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

GEOMETRY_TOLERANCE = 0.1
"""Share of the angle between two beams by which a scan may miss the policy's own beams."""


@dataclass(frozen=True)
class LidarLayout:
    """The lidar that a policy was trained with: beam i points at -fov/2 + (i + 1/2) fov/beams."""

    beams: int
    """Number of beams."""
    bins: int
    """Groups into which the beams are pooled by minimum."""
    fov: float
    """Field of view, radians, centred on the lidar's x axis."""
    range_min: float
    """Smallest range that it reports, metres."""
    range_max: float
    """Range that it reports for a beam that meets nothing, metres."""

    @property
    def step(self) -> float:
        """Angle from one beam to the next, radians."""
        return self.fov / self.beams

    @property
    def first_angle(self) -> float:
        """Direction of the first beam, radians."""
        return -0.5 * self.fov + 0.5 * self.step


def matches(layout: LidarLayout, beams: int, angle_min: float, angle_increment: float) -> bool:
    """Whether a scan has the beams of the layout, in either direction of rotation.

    Args:
        layout: The policy's lidar.
        beams: Number of beams of the scan.
        angle_min: Direction of its first beam, radians, counter-clockwise from the lidar's x axis.
        angle_increment: Angle from one beam to the next, radians, negative for a clockwise scan.

    Returns:
        True if every beam lies within a tenth of a beam's width of the layout's.
    """
    first = layout.first_angle
    last_angle = angle_min + (beams - 1) * angle_increment
    low, high = min(angle_min, last_angle), max(angle_min, last_angle)
    tolerance = GEOMETRY_TOLERANCE * layout.step
    return beams == layout.beams and abs(low - first) <= tolerance and abs(high + first) <= tolerance


def pool_scan(
    layout: LidarLayout, ranges: ArrayLike, angle_min: float, angle_increment: float
) -> NDArray[np.float32] | None:
    """Pools a scan by angle into the bins of a policy.

    Args:
        layout: The policy's lidar.
        ranges: (beams,) float, metres: any number of beams at any angles, also clockwise or over more than its view.
        angle_min: Direction of the first beam, radians, counter-clockwise from the lidar's x axis.
        angle_increment: Angle from one beam to the next, radians, negative for a clockwise scan.

    Returns:
        (bins,) float32, metres, right to left; None if no beam in the field of view is valid.

    Raises:
        ValueError: The ranges are not one row of numbers, or the angles are not finite.
    """
    readings = np.asarray(ranges)
    if readings.ndim != 1 or readings.size == 0 or readings.dtype.kind not in "fiu":
        raise ValueError(f"ranges: expected one row of numbers, got {readings.dtype} of shape {readings.shape}")
    if not (math.isfinite(angle_min) and math.isfinite(angle_increment)) or angle_increment == 0:
        raise ValueError(f"angle_min = {angle_min}, angle_increment = {angle_increment}: expected numbers, not 0 apart")
    readings = readings.astype(np.float32)
    nearer = np.where(readings == 0, np.float32(0), np.maximum(readings, np.float32(layout.range_min)))
    cleaned = np.where(readings == -np.inf, np.float32(0), np.minimum(nearer, np.float32(layout.range_max)))
    valid = (readings >= 0) | (readings == -np.inf)

    angles = angle_min + angle_increment * np.arange(readings.size)
    # A beam within rounding of the view's border belongs to it; one between two bins belongs to the left one.
    slack = 1e-6
    from_right = np.mod(angles + 0.5 * layout.fov + slack, 2 * np.pi) - slack
    seen = valid & (from_right <= layout.fov + slack)
    if not seen.any():
        return None
    bins = np.floor(from_right[seen] * (layout.bins / layout.fov) + slack).astype(np.int64)
    pooled = np.full(layout.bins, np.inf, np.float32)
    np.minimum.at(pooled, np.clip(bins, 0, layout.bins - 1), cleaned[seen])
    return np.where(np.isinf(pooled), np.float32(0), pooled)
