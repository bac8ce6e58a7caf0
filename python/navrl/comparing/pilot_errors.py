"""What goes wrong in a pilot of the user's own, told in one line with its contender and scenario.

drive = naming(drive, "mine")       raises PilotError for what the pilot raises, and for commands that are no numbers
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navrl.errors import UserError

if TYPE_CHECKING:
    from navrl.batch import BatchSim
    from navrl.evaluate import Driver


class PilotError(UserError):
    """A pilot that the user gave has failed; the text names its contender and the scenario."""


def naming(drive: Driver, contender: str, *, first: int = 0) -> Driver:
    """The same, with the contender's name and the scenario's place in what goes wrong.

    Args:
        drive: How the pilot drives.
        contender: Its name.
        first: Place in its list of the scenario that the simulator's first robot runs.

    Returns:
        What the evaluator calls.
    """

    def named(simulator: BatchSim, running: NDArray[np.intp]) -> NDArray[np.float32]:
        try:
            actions = drive(simulator, running)
        except Exception as error:  # whatever a user's function may raise
            robot = _at_fault(drive, simulator, running)
            fault = " ".join(f"{type(error).__name__}: {error}".split())
            raise PilotError(f"{contender}: scenario {first + robot}: {fault}") from error
        wrong = running[~np.isfinite(actions).all(axis=1)]
        if wrong.size:
            raise PilotError(f"{contender}: scenario {first + int(wrong[0])}: its command is not of finite numbers")
        return actions

    return named


def _at_fault(drive: Driver, simulator: BatchSim, running: NDArray[np.intp]) -> int:
    """The first robot that fails alone, too; the first of all if none does."""
    for robot in running:
        try:
            drive(simulator, np.array([robot]))
        except Exception:  # the same as before
            return int(robot)
    return int(running[0])
