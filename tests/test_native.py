"""The native kernel against torch: the same draws and tensors, the same numbers but for rounding."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from math import isnan, nan

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from navrl import _navsim
from navrl.config import Config, LearnerConfig, LidarConfig, NetworksConfig, ThreadsConfig
from navrl.config.files import load_config
from navrl.machine import Machine, cores
from navrl.native import kernel_of, learn_threads
from navrl.replay import NonFiniteError
from navrl.td3 import TD3, UpdateMetrics, flushed_denormals
from plain_td3 import BINS, small_config, small_learner

FULL = os.environ.get("NAVRL_FULL") == "1"
CASES: list[tuple[dict[str, object], dict[str, object]]] = [
    ({}, {}),
    ({"hidden_sizes": (9, 8, 5)}, {"policy_delay": 2}),
    ({"hidden_sizes": (5, 6, 7, 8)}, {"policy_delay": 1, "batch_size": 1}),
    ({"hidden_sizes": (1, 1)}, {"batch_size": 3}),
    ({"hidden_sizes": (33, 17)}, {"batch_size": 40, "policy_delay": 1}),
    ({"hidden_sizes": (128, 128)}, {"batch_size": 96}),
    ({"hidden_sizes": (31, 65)}, {"batch_size": 128, "mirror": False}),
    ({"hidden_sizes": (64, 48)}, {"batch_size": 256}),
    ({"encoding": "raw", "initialization": "torch"}, {"mirror": False, "policy_noise": 0.2}),
    ({"initialization": "torch", "frozen_combined": True}, {"tau": 0.3}),
    ({"hidden_sizes": (7, 6, 5), "frozen_combined": True}, {}),
    ({}, {"pretanh_penalty": 0.0, "policy_noise": 0.0}),
    ({}, {"pretanh_penalty": 2.0, "noise_clip": 0.02, "tau": 1.0}),
    ({}, {"clip_targets": True, "reward_scale": 1e-3}),
]
IDENTICAL = ("streams.", "updates", "actor_updates", "progress", "averaged_actor")


def _learner(kernel: str, dtype: torch.dtype = torch.float32, networks: object = None, **learner: object) -> TD3:
    sizes = {"hidden_sizes": (12, 10), **(networks or {})}  # type: ignore[dict-item]
    return small_learner(small_config(NetworksConfig(**sizes), kernel=kernel, **learner), dtype)


def _pair(dtype: torch.dtype = torch.float32, networks: object = None, **learner: object) -> tuple[TD3, TD3]:
    return _learner("native", dtype, networks, **learner), _learner("torch", dtype, networks, **learner)


def _bits(td3: TD3) -> dict[str, bytes]:
    return {name: array.tobytes() for name, array in td3.state().items()}


def _assert_close(a: UpdateMetrics, b: UpdateMetrics, tolerance: float) -> None:
    for name, value in vars(a).items():
        assert value == pytest.approx(vars(b)[name], rel=tolerance, abs=tolerance, nan_ok=True), name


@pytest.mark.parametrize("algorithm", ["td3", "ddpg"])
@pytest.mark.parametrize(("networks", "learner"), CASES)
def test_update_in_double_precision_is_torchs(
    algorithm: str, networks: dict[str, object], learner: dict[str, object]
) -> None:
    """Each of some updates from the same state: parameters, targets and moments to 1e-10 of the largest entry."""
    native, plain = _pair(torch.float64, networks, algorithm=algorithm, **learner)
    for td3 in (native, plain):
        td3.set_progress(0.4)
    for _ in range(7):
        native.restore(plain.state())
        ours, theirs = native.update(1), plain.update(1)
        _assert_close(ours, theirs, 1e-9)
        assert ours.actor_updates == theirs.actor_updates
        state = plain.state()
        assert native.state().keys() == state.keys()
        for name, array in native.state().items():
            if name.startswith(IDENTICAL) or name.endswith("adam.step"):
                assert array.tobytes() == state[name].tobytes(), name
            else:
                error = np.abs(array - state[name]).max()
                assert error <= 1e-10 * np.abs(state[name]).max(), name


def _error(state: dict[str, NDArray[np.generic]], exact: dict[str, NDArray[np.generic]], name: str) -> float:
    return float(np.abs(state[name].astype(np.float64) - exact[name]).max())


@pytest.mark.parametrize("algorithm", ["td3", "ddpg"])
def test_rounding_in_single_precision_is_like_torchs(algorithm: str) -> None:
    """Gradients (from the first moments) and steps: at most 4 times torch's own error against double precision."""
    options = {"batch_size": 96, "policy_delay": 1, "algorithm": algorithm}
    networks = {"hidden_sizes": (64, 48)}
    native, plain = _pair(torch.float32, networks, **options)
    exact = _learner("torch", torch.float64, networks, **options)
    ours: dict[str, list[float]] = {}
    theirs: dict[str, list[float]] = {}
    for _ in range(100 if FULL else 20):
        before = plain.state()
        for td3 in (native, exact):
            td3.restore(before)
        for td3 in (native, plain, exact):
            td3.update(1)
        truth = exact.state()
        for state, errors in ((native.state(), ours), (plain.state(), theirs)):
            for name in truth:
                if name.startswith(("actor.", "critic.", "actor_adam.exp", "critic_adam.exp")):
                    errors.setdefault(name, []).append(_error(state, truth, name))
    for name, errors in ours.items():
        assert np.mean(errors) <= 4.0 * np.mean(theirs[name]), name
        assert np.max(errors) <= 4.0 * np.max(theirs[name]), name


@pytest.mark.parametrize("algorithm", ["td3", "ddpg"])
def test_same_bits_again_regrouped_and_restored(algorithm: str) -> None:
    one, again, parts = (_learner("native", algorithm=algorithm, batch_size=40) for _ in range(3))
    assert one.update(77) == again.update(77)
    assert _bits(one) == _bits(again)
    for count in (1, 2, 30, 7):
        parts.update(count)
    restored = _learner("native", algorithm=algorithm, batch_size=40)
    restored.update(3)
    restored.restore(parts.state())
    for td3 in (parts, restored):
        td3.update(37)
        assert _bits(td3) == _bits(one)


def test_calls_that_are_cut_into_smaller_ones_change_nothing() -> None:
    one, many = _learner("native"), _learner("native")
    assert many._native is not None
    many._native.updates_per_call = 3
    assert one.update(20) == many.update(20)
    assert _bits(one) == _bits(many)


DIGEST = """
import hashlib, sys
sys.path.insert(0, sys.argv[1])
from test_native import _bits, _learner
for dtype in ("float32", "float64"):
    import torch
    td3 = _learner("native", getattr(torch, dtype), {"hidden_sizes": (33, 18)}, batch_size=45)
    td3.update(20)
    print(hashlib.sha256(b"".join(_bits(td3).values())).hexdigest())
"""


def _digest(isa: str) -> str:
    """Of learners of both types after some updates in another process."""
    command = [sys.executable, "-c", DIGEST, os.path.dirname(__file__)]
    environment = os.environ | {"NAVRL_ISA": isa}
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout


def test_same_bits_with_avx2_and_avx512() -> None:
    """Without either the products come from elsewhere: the same numbers but for rounding."""
    digests = {isa: _digest(isa) for isa in ("baseline", "avx2", "avx512")}
    assert all(len(digest.split()) == 2 for digest in digests.values())
    assert digests["baseline"] == _digest("baseline")
    if _navsim.isa() == "avx512":
        assert digests["avx2"] == digests["avx512"]


@pytest.mark.parametrize("isa", ["baseline", "avx2"])
def test_lower_instruction_sets_are_torchs_too(isa: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAVRL_ISA", isa)
    for sizes, batch_size in (((33, 18), 45), ((5, 6, 7), 1), ((64, 32), 96)):
        native, plain = _pair(torch.float64, {"hidden_sizes": sizes}, batch_size=batch_size, policy_delay=1)
        for td3 in (native, plain):
            td3.update(1)
        expected = plain.state()
        for name, array in native.state().items():
            if not name.startswith(IDENTICAL):
                assert np.abs(array - expected[name]).max() <= 1e-10 * np.abs(expected[name]).max(), name


def test_flushing_denormal_numbers_changes_nothing() -> None:
    """Dead units and moments that decay below the smallest normal number included."""
    learners = [_dying_learner() for _ in range(2)]
    for flushed, td3 in zip((False, True), learners, strict=True):
        with flushed_denormals(flushed):
            td3.update(400)
    assert _bits(learners[0]) == _bits(learners[1])


def _dying_learner() -> TD3:
    """Units that no input wakes any more, with moments that are about to become subnormal."""
    td3 = _learner("native", policy_delay=1)
    for network in (td3.actor, td3.critic):
        for name, parameter in network.named_parameters():
            if name in ("hidden.0.bias", "biases.0"):
                with torch.no_grad():
                    parameter.view(-1)[::2] = -1e3
    for optimizer in (td3.actor_optimizer, td3.critic_optimizer):
        for moments in optimizer.state.values():
            moments["exp_avg"].fill_(1e-34)
            moments["exp_avg_sq"].fill_(1e-37)
    return td3


def test_no_subnormal_number_is_left() -> None:
    td3 = _dying_learner()
    td3.update(100_000 if FULL else 3000)
    zeros = 0
    for name, array in td3.state().items():
        if array.dtype == np.float32:
            sizes = np.abs(array)
            assert not ((sizes > 0.0) & (sizes < np.finfo(np.float32).tiny)).any(), name
            zeros += int((sizes == 0.0).sum()) if "exp_avg" in name else 0
    # The moments of half of the first layers have died.
    assert zeros > 100


@pytest.mark.parametrize("value", [nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    "name", ["actor", "critic", "actor_target", "critic_target", "actor_adam.exp_avg", "critic_adam.exp_avg_sq"]
)
def test_parameter_that_is_not_finite_stops_before_a_change(name: str, value: float) -> None:
    td3 = _learner("native")
    td3.update(4)
    tensors = td3._tensors()
    key = next(key for key in reversed(tensors) if key.startswith(f"{name}."))
    tensors[key].view(-1)[-1] = value
    before = _bits(td3)
    with pytest.raises(NonFiniteError, match=rf"the {name.split('_')[0]}'s \w+( \w+)? is not finite"):
        td3.update(5)
    _assert_only_streams_moved(td3, before)


def _assert_only_streams_moved(td3: TD3, before: dict[str, bytes]) -> None:
    after = _bits(td3)
    assert [name for name in before if before[name] != after[name] and not name.startswith("streams.")] == []


@pytest.mark.parametrize("column", [0, 11, -2, -1])
def test_row_that_is_not_finite_stops_before_a_change(column: int) -> None:
    td3 = _learner("native")
    td3.replay.rows[17, column] = nan
    before = _bits(td3)
    with pytest.raises(NonFiniteError, match=f"place 17 of replay is not finite in column {column % td3.replay.width}"):
        td3.update(50)
    _assert_only_streams_moved(td3, before)


def test_overflow_stops_before_the_critics_change() -> None:
    td3 = _learner("native")
    td3.replay.rows[:, -2] = 3e38
    before = _bits(td3)
    with pytest.raises(NonFiniteError, match="the critics' error in update 1 is not finite"):
        td3.update(2)
    _assert_only_streams_moved(td3, before)


def test_rates_fall_and_metrics_agree_over_many_updates() -> None:
    native, plain = _pair(torch.float64, batch_size=40)
    for share in (0.0, 0.5, 1.0):
        for td3 in (native, plain):
            td3.set_progress(share)
        _assert_close(native.update(10), plain.update(10), 1e-6)
    assert isnan(_learner("native").update(1).actor_loss)


def test_who_computes() -> None:
    config = Config()
    assert kernel_of(config) == "native"
    two, one = (replace(config, threads=ThreadsConfig(learn=threads)) for threads in (2, 1))
    assert [learn_threads(c) for c in (two, one)] == [2, 1]
    assert learn_threads(replace(config, threads=ThreadsConfig(learn=7))) == 2
    assert learn_threads(config) == min(cores(), 2)
    assert Machine.here(one) == Machine.here(two)
    torch_one = replace(one, learner=LearnerConfig(kernel="torch"))
    torch_two = replace(two, learner=LearnerConfig(kernel="torch"))
    assert kernel_of(torch_one) == "torch"
    assert learn_threads(replace(torch_one, threads=ThreadsConfig())) == 1
    assert Machine.here(torch_two).differences(Machine.here(torch_one)) == ["learn_threads: 2, 1"]
    differences = Machine.here(one).differences(Machine.here(torch_one))
    assert differences == ["kernel: native, torch", "learn_threads: 0, 1"]


HALVES: list[tuple[dict[str, object], dict[str, object]]] = [
    ({"hidden_sizes": (128, 128)}, {"batch_size": 96}),
    ({"hidden_sizes": (33, 17)}, {"batch_size": 45, "policy_delay": 1}),
    ({"hidden_sizes": (9, 18, 5)}, {"batch_size": 17}),
    ({"hidden_sizes": (12, 10)}, {"batch_size": 9, "pretanh_penalty": 2.0}),
    ({"hidden_sizes": (40, 30), "initialization": "torch", "frozen_combined": True}, {"batch_size": 40}),
    ({}, {"batch_size": 1}),
    ({}, {"batch_size": 8}),
]
"""Sizes of which the second half is as large as the first, smaller, one row, or empty."""


def _in_threads(threads: int, dtype: torch.dtype, networks: object = None, **learner: object) -> TD3:
    sizes = {"hidden_sizes": (12, 10), **(networks or {})}  # type: ignore[dict-item]
    config = small_config(NetworksConfig(**sizes), kernel="native", **learner)
    return small_learner(replace(config, threads=ThreadsConfig(learn=threads)), dtype)


@pytest.mark.parametrize("algorithm", ["td3", "ddpg"])
@pytest.mark.parametrize(("networks", "learner"), HALVES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_same_bits_in_one_thread_and_two(
    dtype: torch.dtype, networks: dict[str, object], learner: dict[str, object], algorithm: str
) -> None:
    """Regrouped, continued in the other number of threads, and with a second thread that is never given room."""
    one, two = (_in_threads(threads, dtype, networks, algorithm=algorithm, **learner) for threads in (1, 2))
    for count in (40, 1, 60):
        assert one.update(count) == two.update(count)
        assert _bits(one) == _bits(two)
    alone = _in_threads(2, dtype, networks, algorithm=algorithm, **learner)
    alone.set_room(False)
    alone.restore(two.state())
    one, two = _restored(two, one), _restored(one, two)
    for td3 in (one, two, alone):
        td3.update(50)
        assert _bits(td3) == _bits(one)


def _restored(td3: TD3, state: TD3) -> TD3:
    td3.restore(state.state())
    return td3


@pytest.mark.parametrize(("preset", "batch_size"), [("fast", None), ("paper", None), ("paper", 37)])
def test_presets_have_the_same_bits_in_one_thread_and_two(preset: str, batch_size: int | None) -> None:
    config = load_config(preset=preset)
    learner = replace(config.learner, kernel="native", batch_size=batch_size or config.learner.batch_size)
    config = replace(config, learner=learner, lidar=LidarConfig(bins=BINS))
    states = []
    for threads in (1, 2):
        td3 = small_learner(replace(config, threads=ThreadsConfig(learn=threads)))
        td3.update(30)
        states.append(_bits(td3))
    assert states[0] == states[1]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_actions_are_torchs_and_each_its_own(dtype: torch.dtype) -> None:
    """The same to rounding, and the same bits of a row in whatever company."""
    native, plain = _pair(dtype, {"hidden_sizes": (33, 20, 7)})
    rows = np.random.default_rng(0).normal(size=(200, native.inputs)).astype(np.float32)
    actions = native.act(rows)
    assert actions.dtype == np.float32
    np.testing.assert_allclose(actions, plain.act(rows), rtol=0.0, atol=1e-6)
    for first, last in ((0, 1), (63, 66), (5, 200)):
        assert native.act(rows[first:last].copy()).tobytes() == actions[first:last].tobytes()
    assert native.act(np.asfortranarray(rows)).tobytes() == actions.tobytes()


def _arguments(td3: TD3) -> dict[str, object]:
    """Of a call of the binding."""
    assert td3._native is not None
    batch = td3.config.batch_size
    return {
        **td3._native._vectors,
        "rates": (1e-3, 1e-3),
        "steps": (0, 0),
        "replay": td3.replay.rows,
        "indices": np.zeros(batch, np.int64),
        "mirrored": np.zeros(batch, np.bool_),
        "noise": np.zeros(2 * batch, np.float32),
    }


def test_binding_refuses_arrays_that_do_not_fit() -> None:
    td3 = _learner("native")
    assert td3._native is not None
    kernel, good = td3._native._kernel, _arguments(td3)
    vectors = td3._native._vectors["actor"]
    before = _bits(td3)
    shared = np.frombuffer(vectors[0].data, np.float32)[:14]
    bad: list[tuple[type[Exception], str | None, dict[str, object]]] = [
        (ValueError, "index: expected less than 64, got 64", {"indices": np.full(7, 64, np.int64)}),
        (ValueError, "index: expected at least 0, got -1", {"indices": np.full(7, -1, np.int64)}),
        (ValueError, "indices", {"indices": np.zeros(6, np.int64), "mirrored": np.zeros(6, np.bool_)}),
        (ValueError, "mirrored", {"mirrored": np.zeros(6, np.bool_)}),
        (TypeError, "mirrored", {"mirrored": np.zeros(7, np.uint8)}),
        (ValueError, "noise", {"noise": np.zeros(7, np.float32)}),
        (ValueError, "noise: expected a C-contiguous", {"noise": np.zeros(28, np.float32)[::2]}),
        (ValueError, "columns of replay", {"replay": td3.replay.rows[:, :-1].copy()}),
        (ValueError, "replay: expected a C-contiguous", {"replay": td3.replay.rows[:, ::2]}),
        (ValueError, "replay: expected a C-contiguous", {"replay": np.asfortranarray(td3.replay.rows)}),
        (TypeError, "indices", {"indices": np.zeros(7, np.int32)}),
        (TypeError, "replay", {"replay": td3.replay.rows.astype(np.float64)}),
        (TypeError, None, {"actor": [vector.astype(np.float64) for vector in vectors]}),
        (ValueError, None, {"actor": vectors[:3]}),
        (ValueError, "apart from each other", {"actor": [vectors[0], vectors[0].view(), *vectors[2:]]}),
        (ValueError, "apart from each other", {"noise": shared}),
        (ValueError, "actor", {"actor": [vector[:-1].copy() for vector in vectors]}),
        (ValueError, "actor's rate", {"rates": (nan, 0.1)}),
        (ArithmeticError, "noise", {"noise": np.full(14, nan, np.float32)}),
    ]
    for error, named, changed in bad:
        with pytest.raises(error, match=named):
            kernel.update(**{**good, **changed})
        assert _bits(td3) == before
    records, busy = kernel.update(**good)
    assert len(records) == 1
    assert not busy
    rows = np.zeros((3, td3.inputs), np.float32)
    for error, named, actor, observations in (
        (ValueError, "observations: expected", vectors[0], rows[:, :-1].copy()),
        (ValueError, "actor", vectors[0][:-1].copy(), rows),
        (TypeError, "observations", vectors[0], rows.astype(np.float64)),
        (TypeError, None, vectors[0].astype(np.float64), rows),
        (ValueError, "observations: expected a C-contiguous", vectors[0], rows[:, ::2]),
    ):
        with pytest.raises(error, match=named):
            kernel.act(actor=actor, observations=observations)


def test_every_byte_of_mirrored_but_0_is_true() -> None:
    """numpy's truth values may hold any byte."""
    learners = [_learner("native", mirror=True) for _ in range(2)]
    for td3, value in zip(learners, (1, 2), strict=True):
        assert td3._native is not None
        mask = np.full(td3.config.batch_size, value, np.uint8).view(np.bool_)
        td3._native._kernel.update(**{**_arguments(td3), "mirrored": mask})
    assert _bits(learners[0]) == _bits(learners[1])


def test_binding_refuses_sizes_that_do_not_follow_each_other() -> None:
    good = {
        "double": False,
        "actor": [(3, 4, 0, 16), (4, 2, 32, 48)],
        "critic": [(3, 4, 16, 32), (4, 5, 48, 80), (5, 1, 96, 112)],
        "action_weight": 0,
        "critics": 1,
        "batch": 2,
        "sizes": (64, 128),
        "policy_delay": 1,
        "tau": 0.1,
        "pretanh_penalty": 0.0,
        "bounds": (-1.0, 1.0),
        "frozen_combined": False,
        "mirror": None,
        "threads": 1,
    }
    _navsim.Learner(**good)  # type: ignore[arg-type]
    for changed in (
        {"actor": [(3, 4, 0, 16), (5, 2, 32, 48)]},
        {"actor": []},
        {"critic": good["critic"][:2]},  # type: ignore[index]
        {"critics": 3},
        {"sizes": (63, 100)},
        {"sizes": (49, 128)},
        {"batch": 0},
        {"batch": 2**40},
        {"actor": [(3, 4, 0, 16), (4, 2, 2**64 - 6, 48)]},
        {"actor": [(3, 4, 0, 16), (4, 2**63, 32, 48)]},
        {"action_weight": 2**64 - 2},
        {"tau": nan},
        {"bounds": (1.0, -1.0)},
        {"bounds": (nan, 1.0)},
        {"pretanh_penalty": -1.0},
        {"policy_delay": 0},
        {"action_weight": 125},
        {"mirror": ([0] * 9, [1.0] * 10)},
        {"mirror": ([0] * 9 + [10], [1.0] * 10)},
        {"threads": 0},
        {"threads": 3},
    ):
        with pytest.raises(ValueError, match="expected"):
            _navsim.Learner(**{**good, **changed})  # type: ignore[arg-type]


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs Linux's account of memory")
def test_memory_is_flat() -> None:
    def resident() -> int:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    td3 = _learner("native", batch_size=40)
    td3.update(2000)
    before = resident()
    for _ in range(10_000 if FULL else 200):
        td3.update(100)
    assert resident() - before < 2_000_000
