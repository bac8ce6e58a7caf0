"""How long a contender takes to decide: one robot, one call, one thread."""

from __future__ import annotations

from itertools import cycle
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navrl.batch import BatchSim
from navrl.evaluate import EVALUATION_SEED, steps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from navrl.batch import Scenario
    from navrl.comparing.contenders import Contender
    from navrl.config import ControllersConfig, PlannerConfig, SimConfig

CALLS = 1000
"""Decisions that are timed."""
WARM_UP = 100
"""Decisions before them, whose times are dropped."""


def decision_times(
    contender: Contender,
    scenarios: Sequence[Scenario],
    sim: SimConfig,
    controllers: ControllersConfig,
    planner: PlannerConfig,
) -> NDArray[np.float64]:
    """Times of single decisions on the way through the first scenarios; planning, done once before, is not counted.

    Args:
        contender: Who decides.
        scenarios: Driven one after the other until there are enough calls, from the first again if need be.
        sim: Robot, lidar and task.
        controllers: Settings of controllers.
        planner: Settings of planners.

    Returns:
        (CALLS,) seconds.
    """
    times: list[float] = []

    def timed(simulator: BatchSim, running: NDArray[np.intp]) -> NDArray[np.float32]:
        begin = perf_counter()
        actions = drive(simulator, running)
        times.append(perf_counter() - begin)
        return actions

    for place, scenario in cycle(enumerate(scenarios)):
        plans = list(contender.plans([scenario], sim, planner))
        drive = contender.driver([scenario], plans, sim, controllers, planner, first=place)
        simulator = BatchSim(sim, num_envs=1, seed=EVALUATION_SEED, autoreset=False, scenarios=[scenario])
        for _ in steps(timed, simulator, np.arange(1)):
            if len(times) >= WARM_UP + CALLS:
                return np.array(times[WARM_UP:])
    raise AssertionError("cycle never ends")
