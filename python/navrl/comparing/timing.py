"""How long a contender takes to decide: one robot, one call, one thread."""

from __future__ import annotations

from itertools import cycle
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from navrl.batch import BatchSim
from navrl.evaluate import EVALUATION_SEED
from navrl.metrics import RUNNING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from navrl.batch import Scenario
    from navrl.comparing.contenders import Entry
    from navrl.config import ControllersConfig, PlannerConfig, SimConfig

CALLS = 1000
"""Decisions that are timed."""
WARM_UP = 100
"""Decisions before them, whose times are dropped."""


def decision_times(
    entry: Entry, scenarios: Sequence[Scenario], sim: SimConfig, controllers: ControllersConfig, planner: PlannerConfig
) -> NDArray[np.float64]:
    """Times of single decisions on the way through the first scenarios; planning, done once before, is not counted.

    Args:
        entry: The contender.
        scenarios: Driven one after the other until there are enough calls, from the first again if need be.
        sim: Robot, lidar and task.
        controllers: Settings of controllers.
        planner: Settings of planners.

    Returns:
        (CALLS,) seconds.
    """
    times: list[float] = []
    one = np.zeros(1, np.intp)
    with threadpool_limits(1, user_api="blas"):
        for scenario in cycle(scenarios):
            plans = entry.plans([scenario], sim, planner, num_threads=1)
            drive = entry.driver([scenario], plans, sim, controllers)
            simulator = BatchSim(sim, num_envs=1, seed=EVALUATION_SEED, autoreset=False, scenarios=[scenario])
            while simulator.outcome[0] == RUNNING:
                begin = perf_counter()
                action = drive(simulator, one)
                times.append(perf_counter() - begin)
                if len(times) == WARM_UP + CALLS:
                    return np.array(times[WARM_UP:])
                simulator.step(action)
    raise AssertionError("cycle never ends")
