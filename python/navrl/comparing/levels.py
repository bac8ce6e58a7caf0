"""Levels of difficulty under which contenders are compared: the same worlds, another robot."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any, Literal, get_args

from navrl.config import SimConfig

Level = Literal["ideal", "real"]
LEVELS: tuple[Level, ...] = get_args(Level)

REAL: dict[str, dict[str, Any]] = {
    "robot": {
        "acceleration_max": 1.0,
        "angular_acceleration_max": 2.5,
        "delay_steps": 1,
        "odometry_noise": 0.02,
    },
    "lidar": {"noise": 0.02, "drop_probability": 0.01},
}
"""What the level "real" sets: commands act one period late within acceleration limits (m/s^2, rad/s^2), the lidar errs
by 2 cm and loses a beam in a hundred, and the goal is seen from a pose whose distance and rotation drift."""


def at_level(sim: SimConfig, level: Level) -> SimConfig:
    """The simulator of a level.

    Args:
        sim: Robot, lidar, task and world.
        level: "ideal" leaves them as they are; "real" has REAL in their place.

    Returns:
        The configuration.
    """
    if level == "ideal":
        return sim
    return replace(sim, **{table: replace(getattr(sim, table), **values) for table, values in REAL.items()})


def settings_of(sim: SimConfig) -> dict[str, Any]:
    """All settings of a simulator, as JSON has them."""
    return {
        table: {key: list(value) if isinstance(value, tuple) else value for key, value in keys.items()}
        for table, keys in asdict(sim).items()
    }
