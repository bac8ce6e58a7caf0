"""How far a contender is, for those that take minutes: plans, then scenarios that have ended."""

from __future__ import annotations

from collections.abc import Iterator
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from navrl.batch import BatchSim
    from navrl.display import Display
    from navrl.evaluate import Driver
    from navrl.planners import Plan


def shown_plans(plans: Iterator[Plan], name: str, count: int, display: Display | None) -> list[Plan]:
    """All plans, with a line now and then of how many there are.

    Args:
        plans: As they are made.
        name: The contender.
        count: How many there will be.
        display: Where to; None shows nothing.
    """
    made: list[Plan] = []
    for plan in plans:
        made.append(plan)
        if display is not None and display.due:
            display.show(f"navrl: {name}: {len(made):,} of {count:,} paths planned")
    return made


def shown_drive(drive: Driver, name: str, count: int, display: Display | None) -> Driver:
    """The same driver, with a line now and then of how many scenarios have ended.

    Args:
        drive: What the evaluator calls.
        name: The contender.
        count: Scenarios of the list.
        display: Where to; None shows nothing.
    """
    if display is None:
        return drive
    begin, periods = monotonic(), 0

    def watched(simulator: BatchSim, running: NDArray[np.intp]) -> NDArray[np.float32]:
        nonlocal periods
        if display.due:
            ended, seconds = count - running.size, monotonic() - begin
            display.show(f"navrl: {name}: {ended:,} of {count:,} scenarios ended, {periods:,} steps, {seconds:.0f} s")
        periods += 1
        return drive(simulator, running)

    return watched
