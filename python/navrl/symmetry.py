"""Whether a lidar's scans have a mirror image (no numpy: configurations are checked without it)."""

from __future__ import annotations


def why_asymmetric(beams: int, bins: int, mount: tuple[float, float, float]) -> str | None:
    """Why a lidar's scans have no mirror image, in words; None where they have.

    Args:
        beams: Its beams.
        bins: Groups of neighbouring ones.
        mount: Its pose [x, y, yaw] in the robot's frame (m, m, rad).
    """
    _, y, yaw = mount
    if y != 0.0 or yaw != 0.0:
        return f"the lidar is mounted at y = {y}, yaw = {yaw}"
    # A beam exactly between two bins counts for the left one only, so its mirror image would differ.
    if any((2 * beam + 1) * bins % (2 * beams) == 0 for beam in range(beams)):
        return f"of {beams} beams one lies exactly between two of {bins} bins"
    return None
