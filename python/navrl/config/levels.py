"""Levels of difficulty: the same worlds, another robot. presets/real.toml holds classical settings found for it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, TypeVar, get_args

from navrl.config.tree import Config, SimConfig

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


Configured = TypeVar("Configured", SimConfig, Config)


def at_level(config: Configured, level: Level) -> Configured:
    """The configuration of a level.

    Args:
        config: Robot, lidar, task and world, maybe among other settings.
        level: "ideal" leaves them as they are; "real" has REAL in their place.

    Returns:
        The configuration.
    """
    if level == "ideal":
        return config
    tables = {table: replace(getattr(config, table), **values) for table, values in REAL.items()}
    return replace(config, **tables)
