"""What is reported about episodes: rates with Wilson intervals, SPL, and the scores of a list (equation 13)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, Self

Outcome = Literal["goal", "collision", "timeout"]

RUNNING = 0
"""The simulator's outcome of an episode that goes on."""
OUTCOMES: dict[int, Outcome] = {1: "goal", 2: "collision", 3: "timeout"}
"""Meaning of the simulator's outcomes of episodes that have ended."""

NORMAL_QUANTILE_975 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""


@dataclass(frozen=True)
class Episode:
    """How one scenario of a list went."""

    index: int
    """Place of the scenario in its list, from 0."""
    outcome: Outcome
    """How the episode ended."""
    steps: int
    """Control periods driven."""
    time_s: float
    """Steps times the control period, seconds."""
    path_m: float
    """Arc length driven by the robot's centre, metres."""
    shortest_m: float
    """Length of the shortest path from the start to the goal circle, metres."""
    total_return: float
    """Undiscounted return: equations 3 and 5 in the paper's form, unscaled."""
    min_clearance_m: float | None
    """Smallest distance of the footprint from an obstacle at step ends, metres; None in a world without obstacles."""
    line: int | None = None
    """Line of the scenario in its file, from 1; None where the list comes from no file."""
    p5_clearance_m: float | None = None
    """5th percentile of the clearances at step ends, metres; None in a world without obstacles."""
    jerk_m_s3: float | None = None
    """Mean of |second difference of the executed v| / period^2, m/s^3."""
    omega_change_rad_s: float | None = None
    """Sum over the steps of |change of the executed omega|, rad/s."""
    turning_share: float | None = None
    """Share of the steps in which the robot turned in place: v < 0.05 m/s and |omega| > 0.1 rad/s."""
    needs_detour: bool | None = None
    """Whether the robot's disc touches an obstacle on the straight line from start to goal."""

    @property
    def spl(self) -> float:
        """Success weighted by path length, in [0, 1]."""
        # SPL of one episode: S l / max(p, l)
        return self.shortest_m / max(self.path_m, self.shortest_m) if self.outcome == "goal" else 0.0

    def to_json(self) -> dict[str, Any]:
        """The record of `navrl eval --json`; only scenarios of a file have a line."""
        record = asdict(self)
        record["return"] = record.pop("total_return")
        line = {} if self.line is None else {"line": self.line}
        return {key: record[key] for key in EPISODE_KEYS} | line

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> Self:
        """The episode that `to_json` made this record of."""
        return cls(**{"total_return" if key == "return" else key: value for key, value in record.items()})


EPISODE_KEYS = (
    *("index", "outcome", "steps", "time_s", "path_m", "shortest_m", "return", "min_clearance_m"),
    *("p5_clearance_m", "jerk_m_s3", "omega_change_rad_s", "turning_share", "needs_detour"),
)
"""Keys of an episode's JSON record, in order."""


@dataclass(frozen=True)
class Scores:
    """Summary of a list of episodes. The field names are those of every JSON file that reports scores."""

    list: str
    """Name of the scenario list."""
    list_sha256: str
    """Hash of the scenarios as JSON Lines."""
    episodes: int
    """Scenarios, each run exactly once."""
    success_rate: float
    """Share of episodes that reached the goal."""
    success_ci95: tuple[float, float]
    """Wilson 95 % interval of the success rate."""
    collision_rate: float
    """Share of episodes that ended in a collision."""
    collision_ci95: tuple[float, float]
    """Wilson 95 % interval of the collision rate."""
    timeout_rate: float
    """Share of episodes that ran out of time."""
    timeout_ci95: tuple[float, float]
    """Wilson 95 % interval of the time-out rate."""
    average_return: float
    """Mean return over all episodes (paper's form, undiscounted)."""
    spl: float
    """Success weighted by path length: mean of S l / max(p, l)."""
    time_to_goal_s: float | None
    """Mean time over successes, seconds; None without a success."""
    path_length_m: float | None
    """Mean arc length driven over successes, metres; None without a success."""
    min_clearance_m: float | None
    """Mean over episodes of the smallest clearance, metres; None in worlds without obstacles."""
    path_ratio: float | None = None
    """Mean over successes of the arc length driven over the shortest path; None without a success."""
    p5_clearance_m: float | None = None
    """Mean over episodes of the 5th percentile of the clearance, metres; None in worlds without obstacles."""
    jerk_m_s3: float | None = None
    """Mean over episodes of their jerk, m/s^3."""
    omega_change_rad_s: float | None = None
    """Mean over episodes of the sum of |change of omega|, rad/s."""
    turning_share: float | None = None
    """Mean over episodes of the share of steps spent turning in place."""
    detour_episodes: int = 0
    """Scenarios whose straight line is blocked for the robot."""
    detour_success_rate: float | None = None
    """Share of them that reached the goal; None if there is none."""
    detour_success_ci95: tuple[float, float] | None = None
    """Wilson 95 % interval of that share."""
    detour_spl: float | None = None
    """SPL over them."""

    def to_json(self) -> dict[str, Any]:
        """The record that every JSON file holds: intervals as lists."""
        return {key: [*value] if isinstance(value, tuple) else value for key, value in asdict(self).items()}


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a proportion.

    Args:
        successes: Number of hits, 0 to `trials`.
        trials: Number of trials, at least 1.

    Returns:
        Lower and upper bound, in [0, 1].
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} successes of {trials} trials: expected 0 <= successes <= trials, trials >= 1")
    # Wilson: (p + z^2/2n +- z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n)
    z, share = NORMAL_QUANTILE_975, successes / trials
    centre = share + z * z / (2 * trials)
    half_width = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    low = 0.0 if successes == 0 else (centre - half_width) / scale
    high = 1.0 if successes == trials else (centre + half_width) / scale
    return low, high


def summarize(list_name: str, list_sha256: str, episodes: Sequence[Episode]) -> Scores:
    """Scores of a list of episodes.

    Args:
        list_name: Name of the scenario list.
        list_sha256: Hash of its scenarios.
        episodes: One record per scenario, at least one.

    Returns:
        Rates with intervals, and means.
    """
    count = len(episodes)
    hits = {outcome: sum(e.outcome == outcome for e in episodes) for outcome in OUTCOMES.values()}
    reached = [e for e in episodes if e.outcome == "goal"]
    detours = [e for e in episodes if e.needs_detour]
    around = sum(e.outcome == "goal" for e in detours)
    return Scores(
        list=list_name,
        list_sha256=list_sha256,
        episodes=count,
        success_rate=hits["goal"] / count,
        success_ci95=wilson_interval(hits["goal"], count),
        collision_rate=hits["collision"] / count,
        collision_ci95=wilson_interval(hits["collision"], count),
        timeout_rate=hits["timeout"] / count,
        timeout_ci95=wilson_interval(hits["timeout"], count),
        # Eq. 13: average return over the evaluation episodes, without noise
        average_return=math.fsum(e.total_return for e in episodes) / count,
        spl=math.fsum(e.spl for e in episodes) / count,
        time_to_goal_s=_mean([e.time_s for e in reached]),
        path_length_m=_mean([e.path_m for e in reached]),
        min_clearance_m=_mean([e.min_clearance_m for e in episodes]),
        path_ratio=_mean([e.path_m / e.shortest_m for e in reached]),
        p5_clearance_m=_mean([e.p5_clearance_m for e in episodes]),
        jerk_m_s3=_mean([e.jerk_m_s3 for e in episodes]),
        omega_change_rad_s=_mean([e.omega_change_rad_s for e in episodes]),
        turning_share=_mean([e.turning_share for e in episodes]),
        detour_episodes=len(detours),
        detour_success_rate=around / len(detours) if detours else None,
        detour_success_ci95=wilson_interval(around, len(detours)) if detours else None,
        detour_spl=_mean([e.spl for e in detours]),
    )


def _mean(values: Sequence[float | None]) -> float | None:
    """Mean of those that there are."""
    given = [value for value in values if value is not None]
    return math.fsum(given) / len(given) if given else None
