"""Paired statistics against scipy and by hand."""

import math

import numpy as np
import pytest
from scipy import stats

from navrl.metrics import Episode, wilson_interval
from navrl.paired import bootstrap_interval, differences, mcnemar, mean_difference, only_one


def episodes(outcomes: str) -> list[Episode]:
    """g: goal, c: collision, t: time-out."""
    names = {"g": "goal", "c": "collision", "t": "timeout"}
    return [
        Episode(i, names[o], 10, 1.0, 2.0, 1.0, 0.0, None)  # type: ignore[arg-type]
        for i, o in enumerate(outcomes)
    ]


def test_scenarios_that_only_one_solves() -> None:
    assert only_one(episodes("ggctg"), episodes("gctgc")) == (2, 1)
    with pytest.raises(ValueError, match="shorter"):
        only_one(episodes("gg"), episodes("g"))


def test_mcnemar_by_hand() -> None:
    # 1 and 5 of 6: 2 (1 + 6) / 64
    assert mcnemar(1, 5) == mcnemar(5, 1) == 14 / 64
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(3, 3) == 1.0


@pytest.mark.parametrize(("b", "c"), [(0, 1), (0, 9), (2, 11), (17, 4), (40, 61), (300, 380), (0, 990)])
def test_mcnemar_is_the_binomial_test(b: int, c: int) -> None:
    assert mcnemar(b, c) == pytest.approx(stats.binomtest(b, b + c, 0.5).pvalue, rel=1e-9, abs=1e-300)


@pytest.mark.parametrize(("hits", "of"), [(0, 7), (3, 10), (967, 1000), (1000, 1000)])
def test_wilson_is_that_of_scipy(hits: int, of: int) -> None:
    expected = stats.binomtest(hits, of).proportion_ci(0.95, method="wilson")
    assert wilson_interval(hits, of) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_the_bootstrap_is_that_of_scipy() -> None:
    table = np.round(np.random.Generator(np.random.PCG64(3)).normal(0.02, 0.3, 211), 3)
    expected = stats.bootstrap(
        (table,), np.mean, n_resamples=2000, batch=500, method="percentile", rng=np.random.Generator(np.random.PCG64(7))
    ).confidence_interval
    assert bootstrap_interval(table, seed=7, resamples=2000) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_worlds_without_a_difference_are_drawn_and_not_averaged() -> None:
    # Scenarios as pairs (difference, weight): the ratio of their sums.
    values = np.array([1.0, math.nan, 3.0, 2.5, math.nan, -1.0] * 10)
    there = ~np.isnan(values)
    filled = np.where(there, values, 0.0)

    def ratio(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return a.sum(axis=axis) / b.sum(axis=axis)

    expected = stats.bootstrap(
        (filled, there.astype(float)),
        ratio,
        paired=True,
        vectorized=True,
        n_resamples=3000,
        batch=500,
        method="percentile",
        rng=np.random.Generator(np.random.PCG64(1)),
    ).confidence_interval
    found = bootstrap_interval(values, seed=1, resamples=3000)
    assert found == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert mean_difference(values) == 55 / 40


def test_nothing_to_compare() -> None:
    none = differences([1.0, None], [None, 2.0])
    assert np.isnan(none).all()
    assert bootstrap_interval(none) is None
    assert mean_difference(none) is None


def test_an_interval_depends_on_its_seed_alone() -> None:
    values = differences([1.0, 2.0, 5.0, 1.0], [0.5, 2.5, 1.0, 4.0])
    assert values.tolist() == [0.5, -0.5, 4.0, -3.0]
    assert bootstrap_interval(values, seed=2) == bootstrap_interval(values, seed=2)
    assert bootstrap_interval(values, seed=2, resamples=50) != bootstrap_interval(values, seed=3, resamples=50)
