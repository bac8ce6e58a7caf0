"""Rates, intervals and SPL against numbers worked out by hand."""

import pytest

from navrl.metrics import EPISODE_KEYS, Episode, summarize, wilson_interval


def episode(
    index: int,
    outcome: str,
    *,
    path: float,
    shortest: float,
    steps: int = 100,
    clearance: float | None = 0.1,
    total_return: float = 0.0,
) -> Episode:
    return Episode(index, outcome, steps, steps * 0.1, path, shortest, total_return, clearance)  # type: ignore[arg-type]


def test_wilson_interval_by_hand() -> None:
    # p = 0.9, n = 10, z^2 = 3.841459: centre (0.9 + 0.192073) / 1.384146, half width
    # 1.959964 sqrt(0.009 + 0.009604) / 1.384146
    assert wilson_interval(9, 10) == pytest.approx((0.595850, 0.982124), abs=1e-6)
    # p = 0: upper bound z^2 / (n + z^2); p = 1: lower bound n / (n + z^2)
    assert wilson_interval(0, 100) == pytest.approx((0.0, 3.841459 / 103.841459), abs=1e-6)
    assert wilson_interval(10, 10) == pytest.approx((10 / 13.841459, 1.0), abs=1e-6)


def test_wilson_interval_of_381_successes_allows_the_claim_of_99_percent() -> None:
    assert wilson_interval(381, 381)[0] >= 0.99 > wilson_interval(380, 380)[0]


def test_wilson_interval_is_symmetric_and_ends_exactly_at_0_and_1() -> None:
    low, high = wilson_interval(3, 7)
    assert wilson_interval(4, 7) == pytest.approx((1 - high, 1 - low))
    assert wilson_interval(0, 5)[0] == 0.0
    assert wilson_interval(5, 5)[1] == 1.0


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (-1, 5), (6, 5)])
def test_wilson_interval_refuses_impossible_counts(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match="expected 0 <= successes <= trials"):
        wilson_interval(successes, trials)


def test_spl_by_hand() -> None:
    assert episode(0, "goal", path=5.0, shortest=4.0).spl == 0.8
    # Never above 1, although the shortest path is only known to 0.14 %.
    assert episode(0, "goal", path=3.99, shortest=4.0).spl == 1.0
    assert episode(0, "collision", path=4.0, shortest=4.0).spl == 0.0
    assert episode(0, "timeout", path=40.0, shortest=4.0).spl == 0.0


def test_scores_by_hand() -> None:
    scores = summarize(
        "test",
        "abc",
        [
            episode(0, "goal", path=5.0, shortest=4.0, steps=100, clearance=0.2, total_return=90.0),
            episode(1, "goal", path=4.0, shortest=4.0, steps=80, clearance=0.3, total_return=94.0),
            episode(2, "collision", path=1.0, shortest=4.0, steps=20, clearance=-0.0, total_return=-100.0),
            episode(3, "timeout", path=9.0, shortest=4.0, steps=500, clearance=0.1, total_return=-20.0),
        ],
    )
    assert (scores.list, scores.list_sha256, scores.episodes) == ("test", "abc", 4)
    assert (scores.success_rate, scores.collision_rate, scores.timeout_rate) == (0.5, 0.25, 0.25)
    assert scores.success_ci95 == wilson_interval(2, 4)
    assert scores.collision_ci95 == scores.timeout_ci95 == wilson_interval(1, 4)
    assert scores.average_return == pytest.approx(16.0)
    assert scores.spl == pytest.approx((0.8 + 1.0) / 4)
    # Time and path are means over the two successes, clearance over all four.
    assert scores.time_to_goal_s == pytest.approx(9.0)
    assert scores.path_length_m == pytest.approx(4.5)
    assert scores.min_clearance_m == pytest.approx(0.15)


def test_means_over_nothing_are_absent() -> None:
    scores = summarize("test", "", [episode(0, "timeout", path=1.0, shortest=4.0, clearance=None)])
    assert (scores.time_to_goal_s, scores.path_length_m, scores.min_clearance_m) == (None, None, None)


def test_keys_of_the_json_records() -> None:
    one = episode(7, "goal", path=5.0, shortest=4.0, total_return=90.0)
    assert list(summarize("test", "", [one]).to_json()) == [
        "list", "list_sha256", "episodes", "success_rate", "success_ci95", "collision_rate", "collision_ci95",
        "timeout_rate", "timeout_ci95", "average_return", "spl", "time_to_goal_s", "path_length_m", "min_clearance_m",
        "path_ratio", "p5_clearance_m", "jerk_m_s3", "omega_change_rad_s", "turning_share",
        "detour_episodes", "detour_success_rate", "detour_success_ci95", "detour_spl",
    ]  # fmt: skip
    assert tuple(one.to_json()) == EPISODE_KEYS
    assert one.to_json()["return"] == 90.0
