"""What ends a run besides its end: signals and faults. Whatever it is, the last checkpoint is complete."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from navrl import cli
from navrl.batch import BatchSim
from navrl.errors import UserError
from navrl.replay import NonFiniteError
from navrl.running import interrupt
from navrl.running import run as run_module
from navrl.running.checkpoint import CheckpointError, Checkpoints, Chunk
from navrl.running.session import resume, train
from navrl.td3 import TD3, UpdateMetrics
from short_runs import assert_same, command, newest_arrays, options, outcome, small, wait_for

# The command line: signals, exit codes, a fresh process


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_one_signal_saves_and_says_how_to_resume(
    whole: dict[str, dict[str, Any]], tmp_path: Path, number: signal.Signals
) -> None:
    folder = tmp_path / "run"
    process = subprocess.Popen(
        command("train", *options("fast"), "--out", str(folder)), stderr=subprocess.PIPE, text=True
    )
    wait_for(folder / "metrics.csv", process)
    while len((folder / "metrics.csv").read_text().splitlines()) < 2:
        time.sleep(0.01)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == interrupt.EXIT_CODE
    assert f"navrl train --resume {folder}" in errors
    assert 200 <= Checkpoints(folder / "checkpoints").newest().record["counts"]["steps"] < 3000
    # It goes on in a fresh process as if it had never been stopped.
    subprocess.run(command("train", "--resume", str(folder)), check=True, capture_output=True)
    assert_same(outcome(folder), whole["fast"])


def test_two_signals_leave_at_once_with_the_last_checkpoint(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    process = subprocess.Popen(
        command("train", *options("fast", training__steps="10000000"), "--out", str(folder)),
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(folder / "checkpoints" / "00000000", process)
    # Both signals wait for it when it goes on.
    process.send_signal(signal.SIGSTOP)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGCONT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == interrupt.EXIT_CODE
    assert "training on" in errors
    assert "stopped after" not in errors
    assert Checkpoints(folder / "checkpoints").newest().record["counts"]["steps"] >= 0


def test_a_second_signal_ends_the_process_whatever_it_does(tmp_path: Path) -> None:
    """The handler itself, where the second signal finds the process in the middle of a save."""
    program = (
        "import os, signal, time\n"
        "from navrl.running.interrupt import Interruption\n"
        "with Interruption(lambda: os.write(1, b'left')):\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "    time.sleep(60)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=30)
    assert (done.returncode, done.stdout) == (interrupt.EXIT_CODE, b"left")


# Faults


class Faulty(BatchSim):
    """A simulator whose results turn bad after some steps."""

    what = "rewards"
    steps_left = 0

    def step(self, actions: NDArray[np.float32]) -> None:
        Faulty.steps_left -= 1
        super().step(actions)

    def _bad(self, name: str) -> NDArray[np.float32]:
        array: NDArray[np.float32] = getattr(super(), name)
        if self.what != name or Faulty.steps_left >= 0:
            return array
        array = array.copy()
        array[5] = np.nan
        return array

    @property
    def rewards(self) -> NDArray[np.float32]:
        return self._bad("rewards")

    @property
    def observations(self) -> NDArray[np.float32]:
        return self._bad("observations")

    @property
    def final_observations(self) -> NDArray[np.float32]:
        return self._bad("final_observations")


@pytest.mark.parametrize("what", ["rewards", "observations", "final_observations"])
def test_bad_numbers_stop_the_run_with_step_and_robot_named(
    whole: dict[str, dict[str, Any]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    what: str,
) -> None:
    monkeypatch.setattr(run_module, "BatchSim", Faulty)
    monkeypatch.setattr(Faulty, "what", what)
    monkeypatch.setattr(Faulty, "steps_left", 99)
    folder = tmp_path / "run"
    code = cli.main(["train", *options("fast", checkpoint__every_s="0.02"), "--out", str(folder)])
    errors = capsys.readouterr().err
    assert code == 3
    assert "training stopped after 800 steps" in errors
    assert "robot 5" in errors
    assert "Traceback" not in errors
    # What was saved before is sound, and goes on to the end with a simulator that works.
    monkeypatch.setattr(Faulty, "steps_left", 10**9)
    assert Checkpoints(folder / "checkpoints").newest().record["counts"]["steps"] < 800
    resume(folder)
    assert_same(outcome(folder), whole["fast"])


class Full(BatchSim):
    """A simulator whose world has no room for a new episode after some steps."""

    steps_left = 0

    def step(self, actions: NDArray[np.float32]) -> None:
        Full.steps_left -= 1
        if Full.steps_left < 0:
            raise ValueError("world 'td3' is too full: 1000 draws gave no start and reachable goal (narrow)")
        super().step(actions)


def test_a_world_that_turns_out_too_full_stops_the_run_in_one_line(
    whole: dict[str, dict[str, Any]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(run_module, "BatchSim", Full)
        patch.setattr(Full, "steps_left", 99)
        assert cli.main(["train", *options("fast", checkpoint__every_s="0.02"), "--out", str(folder)]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("navrl: training stopped after 792 steps: world 'td3' is too full: ")
    assert last.endswith(f"; the last checkpoint in {folder / 'checkpoints'} is complete")
    resume(folder)
    assert_same(outcome(folder), whole["fast"])


def test_actions_that_are_not_finite_are_no_mistake_of_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TD3, "act", lambda learner, encoded: np.full((len(encoded), 2), np.nan, np.float32))
    with pytest.raises(NonFiniteError, match=r"training stopped after 200 steps .* actions: .* robot 0"):
        train(small("fast"), tmp_path / "run", test=False)


def test_what_the_core_refuses_is_said_in_its_own_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "cores", lambda: 384)
    with pytest.raises(UserError, match=r"^num_threads = 383: expected"):
        train(small("fast"), tmp_path / "run", test=False)


def test_a_run_that_fails_to_start_leaves_the_arithmetic_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise UserError("refused")

    monkeypatch.setattr(run_module, "NStepAssembler", refuse)
    with pytest.raises(UserError, match="refused"):
        train(small("fast"), tmp_path / "run", test=False)
    assert (torch.full((64,), 2e-38) * 0.01).all()


def test_bad_parameters_stop_the_run_and_are_not_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = TD3.update

    def update(learner: TD3, count: int) -> UpdateMetrics:
        if learner.updates >= 50:
            with torch.no_grad():
                next(iter(learner.critic.parameters())).view(-1)[3] = float("inf")
        return original(learner, count)

    monkeypatch.setattr(TD3, "update", update)
    with pytest.raises(NonFiniteError, match=r"after \d+ steps and \d+ updates: .*is not finite"):
        train(small("fast", checkpoint__every_s="0.0"), tmp_path / "run", test=False)
    arrays, rows = newest_arrays(tmp_path / "run")
    assert arrays["learner/updates"] >= 40
    assert all(np.isfinite(array).all() for name, array in arrays.items() if name.startswith("learner/"))
    assert np.isfinite(rows).all()


def test_a_full_disk_stops_the_run_in_one_line(
    whole: dict[str, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saves = 0
    original = Checkpoints._write_chunk

    def write_chunk(checkpoints: Checkpoints, first: int, rows: NDArray[np.float32]) -> Chunk:
        nonlocal saves
        saves += 1
        if saves == 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(checkpoints, first, rows)

    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(Checkpoints, "_write_chunk", write_chunk)
        with pytest.raises(CheckpointError, match="No space left on device"):
            train(small("fast", checkpoint__every_s="0.02"), folder, test=False)
    resume(folder)
    assert_same(outcome(folder), whole["fast"])


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount a small disk")
@pytest.mark.parametrize("size_kb", [300, 400, 500])
def test_a_disk_that_fills_up_loses_nothing_but_time(
    whole: dict[str, dict[str, Any]], tmp_path: Path, size_kb: int
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("this system does not let root mount a small disk")
    try:
        with pytest.raises(UserError, match="No space left on device") as refusal:
            train(small("fast", checkpoint__every_s="0.02"), disk / "run", test=False)
        assert "\n" not in str(refusal.value)
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        resume(disk / "run")
        assert_same(outcome(disk / "run"), whole["fast"])
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_run_without_a_checkpoint_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("navrl.running.checkpoint.write_file", full)
        with pytest.raises(UserError, match="No space left on device; there is none before it"):
            train(small("fast"), tmp_path / "run", test=False)
    assert not any(tmp_path.iterdir())
    train(small("fast", training__steps="800"), tmp_path / "run", test=False)
