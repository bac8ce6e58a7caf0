"""What is measured of a drive step by step, by hand."""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from navrl.batch import Scenario
from navrl.config import SimConfig
from navrl.evaluate import evaluate
from navrl.metrics import Episode, summarize
from navrl.motion import Motion

SIM = SimConfig()


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def scenario(**changes: object) -> Scenario:
    values = {"start": (0.0, 0.0, 0.0), "goal": (3.0, 0.0), "goal_radius": 0.3, "time_limit": 30.0} | changes
    return Scenario(**values)  # type: ignore[arg-type]


class Drive:
    """A simulator whose robots move as given, step by step."""

    def __init__(self, velocities: ArrayLike, clearances: ArrayLike) -> None:
        self._velocities, self._clearances = np.asarray(velocities, np.float64), np.asarray(clearances, np.float32)
        self.step = 0

    @property
    def velocities(self) -> NDArray[np.float64]:
        return self._velocities[self.step]

    @property
    def clearances(self) -> NDArray[np.float32]:
        return self._clearances[self.step]

    @property
    def poses(self) -> NDArray[np.float64]:
        return np.full((self._velocities.shape[1], 3), float(self.step))


def test_measures_of_motion_by_hand() -> None:
    # Robot 0 makes five steps, robot 1 two and robot 2 one.
    v = [[0.5, 0.0, 0.1], [0.5, 0.04, 0], [0.0, 0, 0], [0.5, 0, 0], [0.5, 0, 0]]
    omega = [[0.0, 0.5, 1.0], [1.0, -0.5, 0], [1.0, 0, 0], [-1.0, 0, 0], [-0.5, 0, 0]]
    clearance = [[0.5, 0.3, 0.7], [0.4, 0.2, 0], [0.1, 0, 0], [0.2, 0, 0], [0.9, 0, 0]]
    drive = Drive(np.stack([v, omega], axis=2), clearance)
    motion = Motion(3, period=0.1)
    for step, running in enumerate([[0, 1, 2], [0, 1], [0], [0], [0]]):
        drive.step = step
        motion.observe(drive, np.array(running))  # type: ignore[arg-type]
    # |0 - 2 0.5 + 0.5|, |0.5 - 2 0 + 0.5|, |0.5 - 2 0.5 + 0|: a mean of 2/3 m/s by (0.1 s)^2
    assert motion.jerk() == pytest.approx([200 / 3, 0, 0])
    assert motion.omega_change() == pytest.approx([1 + 0 + 2 + 0.5, 1.0, 0])
    # Step 3 of robot 0 alone stands and turns; both steps of robot 1 do.
    assert motion.turning_share() == pytest.approx([0.2, 1.0, 0.0])
    # Ranks 0.05 x 4 and 0.05 x 1: 0.1 + 0.2 x 0.1, 0.2 + 0.05 x 0.1
    assert motion.clearance(5) == pytest.approx([0.12, 0.205, 0.7])
    assert motion.clearance(5)[0] == pytest.approx(np.percentile([0.5, 0.4, 0.1, 0.2, 0.9], 5))
    assert [track[:, 0].tolist() for track in motion.tracks()] == [[0, 1, 2, 3, 4], [0, 1], [0]]


def test_an_evaluation_measures_motion_and_detours() -> None:
    ahead = SimpleNamespace(act=lambda observations: np.tile(np.array([1, 0], np.float32), (len(observations), 1)))
    beside, across = (1.0, 0.6, 0.0, 0.4, 0.2), (2.0, 0.0, 0.0, 0.2, 1.0)
    evaluation = evaluate(
        ahead, [scenario(boxes=[beside]), scenario(boxes=[across]), scenario()], sim=SIM, num_threads=1
    )
    passed, blocked, free = evaluation.episodes
    assert (passed.needs_detour, blocked.needs_detour, free.needs_detour) == (False, True, False)
    assert (passed.jerk_m_s3, passed.omega_change_rad_s, passed.turning_share) == (0, 0, 0)
    # 0.5 m to the box's side less the radius; seen at x = 0.05, 0.1, ... 2.75 m, of which eight lie beside it.
    assert passed.min_clearance_m == pytest.approx(0.25, abs=1e-6)
    way = [math.hypot(max(0.0, abs(0.05 * k - 1.0) - 0.2), 0.5) - 0.25 for k in range(1, passed.steps + 1)]
    assert passed.p5_clearance_m == pytest.approx(np.percentile(way, 5), abs=1e-5)
    assert free.p5_clearance_m is None
    scores = evaluation.summary
    assert (scores.detour_episodes, scores.detour_success_rate, scores.detour_spl) == (1, 0.0, 0.0)
    assert scores.path_ratio == pytest.approx(np.mean([e.path_m / e.shortest_m for e in (passed, free)]))
    assert len(evaluation.tracks[0]) == passed.steps
    assert evaluation.tracks[0][:, 0] == pytest.approx(0.05 * np.arange(1, passed.steps + 1))


def test_an_episode_reads_back_from_its_record() -> None:
    one = Episode(3, "goal", 10, 1.0, 2.0, 1.5, 90.0, 0.1, 7, 0.2, 1.5, 2.5, 0.25, True)
    assert Episode.from_json(json.loads(json.dumps(one.to_json()))) == one
    assert summarize("x", "", [one, replace(one, outcome="timeout")]).detour_success_rate == 0.5
