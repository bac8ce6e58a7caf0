"""Classical local controllers: from what a robot has (scan, goal, own speed) to a command. None knows the map.

    controller = Controller("dwa", sim)
    commands = controller.command(ranges, goal, velocity)        (N, beams), (N, 2), (N, 2) -> (N, 2)
    evaluate(controller, "test")

A callable of the same signature is a controller too: `navrl.evaluate` runs it as it runs these.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Literal, Protocol, get_args, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navrl import _navsim
from navrl.batch import config_json
from navrl.config import ControllersConfig, SimConfig

if TYPE_CHECKING:
    from typing import Self

Name = Literal["dwa", "dwa-1997", "apf", "gap", "mppi", "pursuit", "straight", "random"]
NAMES: tuple[Name, ...] = get_args(Name)
"""The built-in controllers."""


class Command(Protocol):
    """A controller without memory, as a function."""

    def __call__(
        self, ranges: NDArray[np.float32], goal: NDArray[np.float64], velocity: NDArray[np.float64], /
    ) -> ArrayLike:
        """Commands (N, 2): v (m/s) and omega (rad/s).

        Args:
            ranges: (N, beams) float32, metres; range_max where a beam meets nothing, NaN where it is lost.
            goal: (N, 2) float64, distance (m) and angle (rad, counter-clockwise from ahead) in the robot's frame.
            velocity: (N, 2) float64, v (m/s) and omega (rad/s) of the last period.
        """


class Commander(Protocol):
    """A controller as an object: its method is a `Command`."""

    command: Command


@runtime_checkable
class Remembering(Protocol):
    """A controller that remembers something of each robot, or draws random numbers for it."""

    def reset(self) -> None:
        """Forgets all robots."""

    def command(
        self,
        ranges: NDArray[np.float32],
        goal: NDArray[np.float64],
        velocity: NDArray[np.float64],
        robots: NDArray[np.intp],
        /,
    ) -> ArrayLike:
        """As `Command`; `robots` (N,) says which robot each row belongs to."""


class Controller(_navsim.Controller):
    """A built-in controller of many robots."""

    sim: SimConfig
    """Robot, lidar and period that it drives."""
    name: Name
    """Which one it is."""

    def __new__(
        cls,
        name: Name,
        sim: SimConfig | None = None,
        settings: ControllersConfig | None = None,
        *,
        seed: int = 0,
    ) -> Self:
        """Sets the controller up.

        Args:
            name: One of NAMES.
            sim: Robot, lidar and task; the defaults if None.
            settings: Settings of the controllers; the defaults if None.
            seed: Names the random numbers of "mppi" and "random", which depend on it, the robot and its decisions
                before, and on nothing else.

        Raises:
            ValueError: Another name, or a setting out of range.
        """
        sim = SimConfig() if sim is None else sim
        settings = ControllersConfig() if settings is None else settings
        self = super().__new__(cls, name, json.dumps(asdict(settings)), config_json(sim), seed)
        self.sim, self.name = sim, name
        return self

    def reset(self) -> None:
        """Forgets all robots: their next decision is the first."""
        self.forget()

    def command(
        self, ranges: ArrayLike, goal: ArrayLike, velocity: ArrayLike, robots: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """One command for each row.

        Args:
            ranges: (N, beams), metres; range_max or more: nothing met; NaN or negative: the beam is lost; minus
                infinity: too near to measure.
            goal: (N, 2), distance (m, >= 0) and angle (rad) in the robot's frame; a point ahead on a path
                does as well: ``navrl.planners.Lookahead.goal``.
            velocity: (N, 2), v (m/s) and omega (rad/s) of the last period.
            robots: (N,), which robot each row belongs to, for the memory of "mppi" and "random"; 0 to N - 1 if None.

        Returns:
            (N, 2) float64: v (m/s, in [0, v_max]) and omega (rad/s, in [-omega_max, omega_max]), which the
            acceleration limits allow.

        Raises:
            ValueError: Another shape, a goal or velocity that is no finite number, a negative distance.
        """
        return self.commands(
            np.asarray(ranges, np.float32),
            np.asarray(goal, np.float64),
            np.asarray(velocity, np.float64),
            None if robots is None else np.asarray(robots, np.uint32),
        )
