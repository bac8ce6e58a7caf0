"""The binding: arrays in, arrays out, refusals that name the argument, and determinism."""

import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from navrl.batch import BatchSim, Scenario, draw_list
from navrl.config import LidarConfig, RobotConfig, SimConfig, WorldConfig

SHAPES = {
    "observations": ((3, 24), np.float32),
    "rewards": ((3,), np.float32),
    "terminated": ((3,), np.bool_),
    "truncated": ((3,), np.bool_),
    "final_observations": ((3, 24), np.float32),
    "outcome": ((3,), np.uint8),
    "ranges": ((3, 180), np.float32),
    "poses": ((3, 3), np.float64),
    "goals": ((3, 2), np.float64),
    "velocities": ((3, 2), np.float64),
    "episode_returns": ((3,), np.float64),
    "episode_steps": ((3,), np.uint32),
    "episode_path": ((3,), np.float64),
    "episode_clearance": ((3,), np.float64),
    "episodes": ((3,), np.uint64),
}


def actions(robots: int, step: int) -> np.ndarray:
    """Actions (robots, 2) float32 of which row k depends on k and the step only."""
    rows = [np.random.default_rng([step, k]).uniform((-0.2, -1), (1, 1)) for k in range(robots)]
    return np.array(rows, dtype=np.float32)


def test_results_are_read_only_arrays_in_place() -> None:
    sim = BatchSim(num_envs=3)
    assert (sim.num_envs, sim.observation_size) == (3, 24)
    for name, (shape, dtype) in SHAPES.items():
        array = getattr(sim, name)
        assert array.shape == shape, name
        assert array.dtype == dtype, name
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True
    before = sim.observations
    old = before.copy()
    sim.step(actions(3, 0))
    assert np.shares_memory(before, sim.observations)
    assert (before != old).any()


def test_arrays_outlive_the_simulator() -> None:
    sim = BatchSim(num_envs=3)
    observations = sim.observations
    copy = observations.copy()
    del sim
    BatchSim(num_envs=3, seed=1)
    np.testing.assert_array_equal(observations, copy)


BAD_ACTIONS = [
    (np.zeros((3, 2)), TypeError, "actions: expected dtype float32, got float64"),
    (np.zeros((2, 2), np.float32), ValueError, r"actions: expected shape \[3, 2\], got \[2, 2\]"),
    (np.zeros(6, np.float32), ValueError, r"actions: expected shape \[3, 2\], got \[6\]"),
    (np.zeros((3, 2), [("pad", "u1"), ("a", "f4")])["a"], ValueError, "actions: expected aligned elements"),
    (np.zeros((3, 2), ">f4"), TypeError, "actions: expected dtype float32, got >f4"),
    ([[0.0, 0.0]] * 3, TypeError, "actions: expected a numpy array, got list"),
    (None, TypeError, "actions: expected a numpy array, got NoneType"),
    (
        np.array([[0, 0], [0, np.nan], [0, 0]], np.float32),
        ValueError,
        "actions: expected finite numbers, got NaN for robot 1",
    ),
    (
        np.array([[0, 0], [0, 0], [np.inf, 0]], np.float32),
        ValueError,
        "actions: expected finite numbers, got inf for robot 2",
    ),
]


@pytest.mark.parametrize(("bad", "error", "message"), BAD_ACTIONS)
def test_bad_actions_are_refused_and_change_nothing(bad: object, error: type[Exception], message: str) -> None:
    sim = BatchSim(num_envs=3)
    before = sim.state()
    with pytest.raises(error, match=message):
        sim.step(bad)  # type: ignore[arg-type]
    assert sim.state() == before


ANY_NUMBER = st.floats(width=32) | st.sampled_from([0.0, -0.0, 1e-40, -1.0, 1.0, 3e38])


@st.composite
def any_actions(draw: st.DrawFn) -> np.ndarray:
    """Arrays that are, or nearly are, the actions of three robots: any layout, flags and numbers."""
    dtype = draw(st.sampled_from(["<f4", "<f4", "<f4", ">f4", "f8", "f2", "i4", "?", "O", "S4", "c8"]))
    shape = draw(st.sampled_from([(3, 2), (3, 2), (3, 2), (2, 3), (6,), (), (3, 2, 1), (0, 2), (4, 2)]))
    wide = np.zeros([2 * side + 1 for side in shape], dtype)
    if dtype[1:] == "f4":
        wide = draw(hnp.arrays(np.dtype(dtype), wide.shape, elements=ANY_NUMBER))
    steps = [draw(st.sampled_from([1, 2, -1, -2])) for _ in shape]
    ends = [(slice(None, None, step), slice(side)) for step, side in zip(steps, shape, strict=True)]
    # The dots keep an array of no dimensions an array.
    array = wide[(..., *(step for step, _ in ends))][(..., *(side for _, side in ends))]
    if draw(st.booleans()):
        array = np.asarray(array, order=draw(st.sampled_from(["C", "F"])))
    if array.ndim and draw(st.integers(0, 9)) == 0:
        array = np.broadcast_to(array[:1], array.shape)
    array.flags.writeable = draw(st.booleans()) and array.flags.writeable
    return array


@settings(max_examples=300, deadline=None, derandomize=True)
@given(any_actions())
def test_any_array_steps_as_its_copy_or_is_refused_and_changes_nothing(array: np.ndarray) -> None:
    sim, twin = BatchSim(num_envs=3), BatchSim(num_envs=3)
    before = sim.state()
    if array.dtype == np.float32 and array.dtype.isnative and array.shape == (3, 2) and np.isfinite(array).all():
        sim.step(array)
        twin.step(np.ascontiguousarray(array))
        assert sim.state() == twin.state() != before
    else:
        with pytest.raises((TypeError, ValueError), match="actions: expected"):
            sim.step(array)
        assert sim.state() == before


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.sampled_from(["num_envs", "seed", "num_threads"]),
    st.integers(max_value=-1) | st.integers(min_value=2**64) | st.sampled_from([np.int8(-3), True, 1.0, "3", None]),
)
def test_numbers_that_cannot_be_are_refused_in_one_line(name: str, value: object) -> None:
    error = ValueError if isinstance(value, int | np.integer) and value is not True else TypeError
    with pytest.raises(error, match=f"^{name}.*: expected .+$") as raised:
        BatchSim(**({"num_envs": 1} | {name: value}))  # type: ignore[arg-type]
    assert "\n" not in str(raised.value)


def test_strided_read_only_and_overlapping_actions_give_the_same_result() -> None:
    expected = BatchSim(num_envs=3)
    plain = np.ascontiguousarray(expected.observations[:, 21:23])
    expected.step(plain)
    wide = np.zeros((3, 4), np.float32)
    wide[:, ::2] = plain
    read_only = plain.copy()
    read_only.flags.writeable = False
    for variant in (wide[:, ::2], np.asfortranarray(plain), read_only, plain[::-1].copy()[::-1]):
        sim = BatchSim(num_envs=3)
        sim.step(variant)
        np.testing.assert_array_equal(sim.observations, expected.observations)
    overlapping = BatchSim(num_envs=3)
    overlapping.step(overlapping.observations[:, 21:23])
    np.testing.assert_array_equal(overlapping.observations, expected.observations)


def test_actions_that_overlap_each_other_or_a_result_count_as_they_were_before_the_step() -> None:
    sim, twin = BatchSim(num_envs=3), BatchSim(num_envs=3)
    overlapping = np.lib.stride_tricks.as_strided(np.array([0.5, -0.25, 0.75, 1.0], np.float32), (3, 2), (4, 4))
    sim.step(overlapping)
    twin.step(np.array([[0.5, -0.25], [-0.25, 0.75], [0.75, 1.0]], np.float32))
    assert sim.state() == twin.state()
    result = sim.final_observations[:, 22:24]
    twin.step(result.copy())
    sim.step(result)
    assert sim.state() == twin.state()


def test_masks_are_checked() -> None:
    sim = BatchSim(num_envs=3)
    with pytest.raises(TypeError, match="mask: expected dtype bool, got uint8"):
        sim.reset(np.zeros(3, np.uint8))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"mask: expected shape \[3\], got \[2\]"):
        sim.reset(np.zeros(2, np.bool_))
    sim.reset(np.array([True, False, True]))
    np.testing.assert_array_equal(sim.episodes, [1, 0, 1])


def test_every_byte_of_a_mask_but_0_is_true() -> None:
    sim = BatchSim(num_envs=6, autoreset=False)
    sim.reset(np.array([0, 1, 2, 127, 128, 255], np.uint8).view(bool))
    assert sim.episodes.tolist() == [0, 1, 1, 1, 1, 1]
    sim.reset(np.array([2, 0, 2, 0, 2, 0, 2, 0, 2, 0, 2, 0], np.uint8).view(bool)[::2])
    assert sim.episodes.tolist() == [1, 2, 2, 2, 2, 2]


@pytest.mark.parametrize(
    ("place", "number", "named"),
    [
        ('"pose":{"x":', "1e308", "pose"),
        ('"pose":{"x":', "-1e13", "pose"),
        ('"pose":{"x":', "1e400", "number out of range"),
        ('"start":{"x":', "1e13", "start"),
        ('"velocity":[', "1e13", "velocity"),
        ('"goal":[', "-1e13", "goal"),
        ('"goal_radius":', "-1.0", "goal_radius"),
        ('"goal_distance":', "-1.0", "goal_distance"),
        ('"measured":', "-0.1", "clearance"),
        ('"driven":', "-1e9", "clearance"),
        ('"path":', "1e13", "statistics"),
        ('"paper_return":', "1e13", "paper_return"),
        ('"waiting":[[', "1e13", "waiting"),
        ('"waiting":[', "[0.0,0.0],[0.0", "waiting"),
        ('"scales":[', "1e300", "odometry"),
        ('"odometry":', "null", "odometry"),
    ],
)
def test_a_state_with_impossible_numbers_is_refused(place: str, number: str, named: str) -> None:
    sim = BatchSim(SimConfig(robot=RobotConfig(delay_steps=1, odometry_noise=0.1)), num_envs=2)
    state = sim.state()
    old = r"\{.*?\]\}" if number == "null" else r"[^\],}]*"
    edited = re.sub((re.escape(place) + old).encode(), (place + number).encode(), state, count=1)
    assert edited != state
    with pytest.raises(ValueError, match=rf"simulator state: .*{named}"):
        sim.restore(edited)
    assert sim.state() == state


def test_robots_do_not_depend_on_batch_or_threads() -> None:
    sims = [BatchSim(num_envs=n, seed=2, num_threads=t) for n, t in ((1, 1), (64, 1), (64, 2))]
    for step in range(400):
        for sim in sims:
            sim.step(actions(sim.num_envs, step))
        for name in SHAPES:
            rows = [getattr(sim, name)[:1] for sim in sims]
            np.testing.assert_array_equal(rows[0], rows[1], err_msg=name)
            np.testing.assert_array_equal(rows[0], rows[2], err_msg=name)
    np.testing.assert_array_equal(sims[1].observations, sims[2].observations)
    assert sims[0].episodes[0] > 0


def test_a_state_is_restored_bit_for_bit() -> None:
    sim = BatchSim(num_envs=5, seed=4)
    for step in range(100):
        sim.step(actions(5, step))
    other = BatchSim(num_envs=5, seed=4)
    view = other.observations
    other.restore(sim.state())
    np.testing.assert_array_equal(view, sim.observations)
    for step in range(100, 200):
        sim.step(actions(5, step))
        other.step(actions(5, step))
    assert sim.state() == other.state()
    with pytest.raises(ValueError, match="simulator state"):
        sim.restore(b"nonsense")


def test_late_commands_and_odometry_are_configured_seen_and_restored() -> None:
    sim = SimConfig(robot=RobotConfig(delay_steps=1, odometry_noise=0.1))
    first, second = (BatchSim(sim, num_envs=5, num_threads=threads) for threads in (1, 2))
    forward = np.tile(np.array([1, 0.3], np.float32), (5, 1))
    first.step(forward)
    assert not first.velocities.any()
    assert np.array_equal(first.odometry, first.poses)
    for _ in range(10):
        first.step(forward)
    assert first.velocities[0].tolist() == pytest.approx([0.5, 0.3])
    believed, goals = first.odometry, first.goals
    assert (believed != first.poses).any(axis=1).all()
    seen = np.hypot(goals[:, 0] - believed[:, 0], goals[:, 1] - believed[:, 1])
    assert first.observations[:, -4] == pytest.approx(seen, rel=1e-6)
    assert (first.clearances >= first.episode_clearance).all()
    # Copies: a step leaves them as they were.
    before = believed.copy()
    second.restore(first.state())
    for _ in range(30):
        first.step(forward)
        second.step(forward)
    assert np.array_equal(believed, before)
    assert np.array_equal(first.odometry, second.odometry)
    assert np.array_equal(first.observations, second.observations)


def test_seeds_share_no_world() -> None:
    starts = [BatchSim(num_envs=50, seed=seed).poses.copy() for seed in (0, 1)]
    assert not np.isin(starts[0][:, 0], starts[1][:, 0]).any()


def test_scenarios_run_and_survive_pickling_and_json() -> None:
    drawn = draw_list(SimConfig(), "test", 4)
    assert [Scenario.from_json(s.to_json()) for s in drawn] == drawn
    assert pickle.loads(pickle.dumps(drawn)) == drawn
    assert len({hash(s) for s in drawn}) == 4
    assert drawn != draw_list(SimConfig(), "validation", 4)
    sim = BatchSim(num_envs=4, scenarios=drawn)
    np.testing.assert_array_equal(sim.poses, [s.start for s in drawn])
    np.testing.assert_array_equal(sim.goals, [s.goal for s in drawn])
    assert [sim.scenario(k) for k in range(4)] == drawn
    with pytest.raises(IndexError, match="robot: expected 0 to 3, got 4"):
        sim.scenario(4)


def test_a_running_episode_is_a_scenario() -> None:
    sim = BatchSim(num_envs=2, seed=9)
    scenario = sim.scenario(1)
    assert scenario.start == tuple(sim.poses[1])
    replay = BatchSim(SimConfig(lidar=LidarConfig(noise=0.0)), num_envs=1, scenarios=[scenario])
    quiet = BatchSim(SimConfig(lidar=LidarConfig(noise=0.0)), num_envs=2, seed=9)
    np.testing.assert_array_equal(replay.ranges[0], quiet.ranges[1])


@pytest.mark.parametrize(
    "arguments",
    [
        {"start": (0, 0, 0), "goal": (1, 0), "goal_radius": 0.3, "time_limit": float("nan")},
        {"start": (0, 0, 0), "goal": (1, 0), "goal_radius": -0.3, "time_limit": 10},
        {"start": (0, 0, 0), "goal": (1, 0), "goal_radius": 0.3, "time_limit": 10, "circles": [(0, 0, 0)]},
        {"start": (0, 0, 0), "goal": (1, 0), "goal_radius": 0.3, "time_limit": 10, "polygons": [[(0, 0), (1, 1)]]},
    ],
)
def test_bad_scenarios_are_refused(arguments: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"\S"):
        Scenario(**arguments)  # type: ignore[arg-type]


def test_a_full_world_is_said_so(tmp_path: Path) -> None:
    crowded = tmp_path / "crowded.json"
    crowded.write_text(
        '{"area": [0, 0, 4, 4], "segments": [[-1, -1, 5, -1], [5, -1, 5, 5], [5, 5, -1, 5], [-1, 5, -1, -1]], '
        '"random_boxes": {"count": 60, "sides": [1, 1], "clearance": 0.3}}'
    )
    with pytest.raises(ValueError, match=r"crowded.json.* is too full: 1000 draws .*clearance"):
        BatchSim(SimConfig(world=WorldConfig(name=str(crowded))), num_envs=1)


FORK = """
import os, numpy as np
from navrl.batch import BatchSim
sim = BatchSim(num_envs=8, num_threads=2)
child = os.fork()
if child == 0:
    try:
        sim.step(np.zeros((8, 2), np.float32))
    except RuntimeError as error:
        os._exit(0 if "fork" in str(error) else 1)
    os._exit(2)
raise SystemExit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_fork_is_an_error_and_no_hang() -> None:
    assert subprocess.run([sys.executable, "-c", FORK], timeout=60, check=False).returncode == 0


DIGEST = """
import hashlib, sys
import numpy as np
from navrl import _navsim
from navrl.batch import BatchSim
num_envs, threads, flush = map(int, sys.argv[1:])
if flush:
    import torch
    assert torch.set_flush_denormal(True)
sim = BatchSim(num_envs=num_envs, seed=3, num_threads=threads)
digest = hashlib.sha256()
for step in range(300):
    actions = np.zeros((num_envs, 2), np.float32)
    actions[:8] = np.random.default_rng(step).uniform(-1, 1, (8, 2))
    actions.view(np.uint32)[0, 1] = 71362  # 1e-40: a denormal number
    sim.step(actions)
    for result in (sim.final_observations, sim.ranges, sim.poses, sim.velocities, sim.rewards):
        digest.update(result[:8].tobytes())
print(_navsim.isa(), digest.hexdigest())
"""


def test_one_digest_for_every_instruction_set_thread_count_batch_and_floating_point_mode() -> None:
    def run(num_envs: int, threads: int, flush: int, isa: str | None = None) -> list[str]:
        env = {key: value for key, value in os.environ.items() if key != "NAVRL_ISA"}
        command = [sys.executable, "-c", DIGEST, str(num_envs), str(threads), str(flush)]
        env |= {"NAVRL_ISA": isa} if isa else {}
        return subprocess.run(command, env=env, capture_output=True, check=True, text=True).stdout.split()

    names = ["baseline", "avx2", "avx512"]
    best, digest = run(8, 1, 0)
    assert digest == "00bf2b6eaec3f7e69e098967ff09180f38d053cff5e23a1abb7d89ed0c6f9284"
    for isa in names:
        used = names[min(names.index(isa), names.index(best))]
        assert run(8, 1, 0, isa) == [used, digest]
    for num_envs, threads, flush in ((8, 1, 1), (65, 3, 0), (40, 16, 1)):
        assert run(num_envs, threads, flush) == [best, digest]


def test_an_unknown_instruction_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAVRL_ISA", "sse9")
    with pytest.raises(ValueError, match="NAVRL_ISA = sse9: expected baseline, avx2 or avx512"):
        BatchSim(num_envs=1)
