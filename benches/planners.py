"""Measures every planner on scenarios of the test list: lengths over the true shortest, and times.

    python benches/planners.py [--scenarios N] [--rounds K] [--timed M]

Lengths have no margin, raw (without the shortcut) and pulled tight. Times are those of calls with the same settings,
pulled tight: processor time, which other programs disturb less. The planners take turns at each scenario, so that
whatever else the machine does meets all of them; of K rounds the best counts. The last two rows are rooms with 16 boxes
on cells of 0.01 m, about 1,000 x 1,000 of them.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from navrl.batch import Scenario, draw_list
from navrl.config import PlannerConfig, SimConfig, WorldConfig
from navrl.planners import PLANNERS, Planner, plan, plan_all
from navrl.scenarios import ScenarioList, load_list

TIGHT = PlannerConfig(margin=0.0)
RAW = replace(TIGHT, shortcut=False)
FINE = replace(TIGHT, resolution=0.01)
FINE_PLANNERS: tuple[Planner, ...] = ("astar", "fmm")


def lengths(planner: Planner, tests: ScenarioList, settings: PlannerConfig) -> str:
    """Mean ratio to the shortest of the paths found, and how many were not."""
    routes = plan_all(tests.scenarios, planner, config=settings)
    ratios = [route.length / least for route, least in zip(routes, tests.shortest, strict=True) if route.found]
    missed = len(routes) - len(ratios)
    return f"{np.mean(ratios):.4f}" + (f" ({missed} not found)" if missed else "")


def times(
    planners: Sequence[Planner], scenarios: Sequence[Scenario], settings: PlannerConfig, rounds: int
) -> np.ndarray:
    """Best time (ms) of each planner (row) at each scenario (column)."""
    best = np.full((len(planners), len(scenarios)), np.inf)
    for _ in range(rounds):
        for column, scenario in enumerate(scenarios):
            for row, planner in enumerate(planners):
                start = time.thread_time()
                plan(scenario, planner, config=settings, index=column)
                best[row, column] = min(best[row, column], 1e3 * (time.thread_time() - start))
    return best


def spread(row: np.ndarray) -> str:
    """Median and 99th percentile of times."""
    return f"{np.median(row):8.2f} {np.percentile(row, 99):8.2f}"


def main() -> int:
    """One line for each planner."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenarios", type=int, default=200, help="scenarios whose lengths count")
    parser.add_argument("--timed", type=int, default=100, help="scenarios that are timed")
    parser.add_argument("--rounds", type=int, default=5, help="rounds, of which the best time counts")
    options = parser.parse_args()
    tests = load_list(SimConfig(), "test", count=options.scenarios)
    machine = platform.processor() or platform.machine()
    print(f'first {options.scenarios} test scenarios of "td3", {machine}, one thread')
    print(f"{'planner':20s}{'raw':>8s}{'tight':>8s}{'ms, median':>12s}{'p99':>7s}")
    timed = times(PLANNERS, tests.scenarios[: options.timed], TIGHT, options.rounds)
    for planner, row in zip(PLANNERS, timed, strict=True):
        raw, tight = (lengths(planner, tests, settings) for settings in (RAW, TIGHT))
        print(f"{planner:20s}{raw:>8s}{tight:>8s}   {spread(row)}", flush=True)
    rooms = draw_list(SimConfig(world=WorldConfig(name="boxes", boxes=16)), "test", options.timed)
    for planner, row in zip(FINE_PLANNERS, times(FINE_PLANNERS, rooms, FINE, options.rounds), strict=True):
        print(f"{planner + ', 0.01 m':36s}   {spread(row)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
