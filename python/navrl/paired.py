"""Differences between two contenders that ran the same list, scenario by scenario.

only_one(a, b) -> 12, 3;  mcnemar(12, 3) -> p;  bootstrap_interval(differences, seed=0) -> (low, high)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navrl.metrics import Episode

RESAMPLES = 10_000
"""Lists that a bootstrap draws."""
CHUNK = 500
"""Lists that it draws at once."""


def only_one(a: Sequence[Episode], b: Sequence[Episode]) -> tuple[int, int]:
    """Scenarios that only one of two reached the goal of.

    Args:
        a: Episodes of one contender.
        b: Those of the other, of the same list.

    Returns:
        How many only `a` solved, and how many only `b`.
    """
    solved = [(x.outcome == "goal", y.outcome == "goal") for x, y in zip(a, b, strict=True)]
    return solved.count((True, False)), solved.count((False, True))


def mcnemar(only_a: int, only_b: int) -> float:
    """McNemar's exact test: whether two contenders of one list have the same success rate.

    Args:
        only_a: Scenarios that only the one solved.
        only_b: Scenarios that only the other solved.

    Returns:
        Two-sided p-value: how often a fair coin splits as many scenarios at least as unevenly; 1 without any.
    """
    differing = only_a + only_b
    # p = min(1, 2 sum_{k <= min(b, c)} C(b + c, k) / 2^(b + c))
    tail = sum(math.comb(differing, k) for k in range(min(only_a, only_b) + 1))
    p: float = 2 * tail / 2**differing
    return min(1.0, p)


def differences(a: Sequence[float | None], b: Sequence[float | None]) -> NDArray[np.float64]:
    """(scenarios,) a - b, NaN where one of them has no value."""
    pairs = zip(a, b, strict=True)
    return np.array([math.nan if x is None or y is None else x - y for x, y in pairs], np.float64)


def mean_difference(values: NDArray[np.float64]) -> float | None:
    """Mean of those that are not NaN; None if all are."""
    there = values[~np.isnan(values)]
    return math.fsum(there) / len(there) if len(there) else None


def bootstrap_interval(values: ArrayLike, *, seed: int = 0, resamples: int = RESAMPLES) -> tuple[float, float] | None:
    """95 % interval of the mean of paired differences: percentiles over lists drawn with replacement from the worlds.

    Args:
        values: (scenarios,) one difference for each world, NaN where there is none; lists are drawn from all worlds,
            means taken over those that have a difference.
        seed: Names the draws, which are the same for every pair of contenders of a list.
        resamples: Lists to draw.

    Returns:
        Lower and upper bound; None if no world has a difference.
    """
    given = np.asarray(values, np.float64)
    there = ~np.isnan(given)
    if not there.any():
        return None
    filled = np.where(there, given, 0.0)
    generator, means = np.random.Generator(np.random.PCG64(seed)), []
    for start in range(0, resamples, CHUNK):
        worlds = generator.integers(0, len(given), (min(CHUNK, resamples - start), len(given)))
        counts = there[worlds].sum(axis=1)
        sums = filled[worlds].sum(axis=1)
        means.append(sums[counts > 0] / counts[counts > 0])
    low, high = np.percentile(np.concatenate(means), [2.5, 97.5]).tolist()
    return low, high
