"""Resuming: bitwise wherever a run is cut, and what is refused."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from navrl.config.files import load_config
from navrl.errors import UserError
from navrl.machine import Machine
from navrl.running import run as run_module
from navrl.running.checkpoint import CheckpointError, Checkpoints
from navrl.running.folder import RunFolder
from navrl.running.session import Interrupted, resume, train
from short_runs import PRESETS, Cut, assert_same, newest_arrays, outcome, run_with_cuts, small

# Bitwise resume


@pytest.mark.parametrize("preset", PRESETS)
def test_checkpoints_do_not_change_results(whole: dict[str, dict[str, Any]], tmp_path: Path, preset: str) -> None:
    train(small(preset, checkpoint__every_s="0.02"), tmp_path / "run", preset=preset, test=False)
    assert Checkpoints(tmp_path / "run" / "checkpoints").numbers()[-1] > 5
    assert_same(outcome(tmp_path / "run"), whole[preset])


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("seed", range(3))
def test_a_run_that_is_cut_anywhere_continues_bitwise(
    whole: dict[str, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, preset: str, seed: int
) -> None:
    moves = random.Random(seed)
    cuts = [0, 1, 2] if seed == 0 else [moves.randrange(3, 180) for _ in range(4)]
    made = run_with_cuts(small(preset), tmp_path / "run", preset, iter(cuts), monkeypatch)
    assert made == len(cuts)
    assert_same(outcome(tmp_path / "run"), whole[preset])


def newest_number(folder: Path) -> int:
    """Number of the newest checkpoint, -1 without one; the run may be writing."""
    return max((int(path.name) for path in folder.glob("checkpoints/0*")), default=-1)


def work_and_kill(work: Callable[[], object], folder: Path, moves: random.Random) -> bool:
    """Works in a child process and kills it a little after some checkpoints; returns whether it had ended before."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            sys.stderr = sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - the child ends here
            work()
            code = 0
        finally:
            os._exit(code)
    goal = newest_number(folder) + moves.randrange(1, 8)
    ended = False
    while newest_number(folder) < goal and not ended:
        ended = os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    time.sleep(moves.uniform(0.0, 0.03))
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return False
    assert os.waitstatus_to_exitcode(status) == 0
    return True


@pytest.mark.parametrize("preset", PRESETS)
def test_a_run_that_is_killed_at_any_moment_continues_bitwise(
    whole: dict[str, dict[str, Any]], tmp_path: Path, preset: str
) -> None:
    folder, moves = tmp_path / "run", random.Random(preset)
    config = small(preset, checkpoint__every_s="0.01")
    kills = 0
    ended = work_and_kill(lambda: train(config, folder, preset=preset, test=False), folder, moves)
    while not ended and kills < 6:
        kills += 1
        ended = work_and_kill(lambda: resume(folder), folder, moves)
    assert kills >= 2
    resume(folder)
    assert_same(outcome(folder), whole[preset])


def test_the_comparisons_above_see_every_part(whole: dict[str, dict[str, Any]], tmp_path: Path) -> None:
    """Another seed changes the arrays of every part: none of the comparisons is of constants."""
    train(small("paper", training__seed="1"), tmp_path / "run", preset="paper", test=False)
    one, other = whole["paper"]["arrays"], outcome(tmp_path / "run")["arrays"]
    differing = {name for name in one if one[name] != other[name]}
    assert {name.partition("/")[0] for name in differing} == {name.partition("/")[0] for name in one}
    assert {name for name in one if name.startswith("learner/streams.")} <= differing
    assert {"exploration/generator", "exploration/forced_actions", "assembler/returns"} <= differing
    assert whole["paper"]["replay"] != outcome(tmp_path / "run")["replay"]


# Resuming: what is refused and what is not


@pytest.fixture
def stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run that was stopped in the middle."""
    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr("navrl.running.session.Interruption", Cut)
        Cut.moves_left = 300
        with pytest.raises(Interrupted, match=f"navrl train --resume {folder}"):
            train(small("fast"), folder, test=False)
    return folder


@pytest.mark.parametrize("key", ["torch", "cpu", "navrl", "numpy", "isa"])
def test_another_environment_is_refused_unless_inexact(
    stopped: Path, monkeypatch: pytest.MonkeyPatch, key: str
) -> None:
    here = Machine.here(small("fast"))
    other = replace(here, **{key: "another"})
    monkeypatch.setattr(run_module.Machine, "here", lambda _: other)
    with pytest.raises(CheckpointError, match=rf"{key}: .*, another; --inexact") as refusal:
        resume(stopped)
    assert getattr(here, key) in str(refusal.value)
    resume(stopped, inexact=True)
    assert json.loads((stopped / "summary.json").read_text())["inexact"] is True


def test_edited_settings_are_refused_but_those_that_change_no_result(stopped: Path) -> None:
    file = stopped / "config.toml"
    text = file.read_text()
    file.write_text(text.replace("hidden_sizes = [16, 16]", "hidden_sizes = [16, 24]"))
    with pytest.raises(UserError, match=r"networks\.hidden_sizes = \[16, 24\], .* made with \[16, 16\]"):
        resume(stopped)
    file.write_text(text.replace("every_s = 1000000.0", "every_s = 3.0").replace("simulate = 0", "simulate = 2"))
    resume(stopped)
    assert json.loads((stopped / "summary.json").read_text())["threads"]["sim"] == 2


def test_a_missing_configuration_is_written_again(stopped: Path) -> None:
    text = (stopped / "config.toml").read_text()
    (stopped / "config.toml").unlink()
    resume(stopped)
    assert (stopped / "config.toml").read_text() == text


def test_a_damaged_checkpoint_is_named_and_the_one_before_goes_on(
    whole: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    train(small("fast", checkpoint__every_s="0.05"), folder, test=False)
    checkpoints = folder / "checkpoints"
    newest = max(checkpoints.glob("0*"))
    state = newest / "state.safetensors"
    content = bytearray(state.read_bytes())
    content[len(content) // 2] ^= 4
    state.write_bytes(content)
    with pytest.raises(CheckpointError, match=f"{state}: damaged") as refusal:
        resume(folder)
    offered = re.search(r"(rm -r \S+) and resume again", str(refusal.value))
    assert offered is not None
    subprocess.run(offered[1].split(), check=True)
    resume(folder)
    assert_same(outcome(folder), whole["fast"])


def test_a_finished_run_says_so_and_steps_extend_it(
    whole: dict[str, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    train(small("fast"), folder, test=False)
    capsys.readouterr()
    assert resume(folder) == folder
    assert "is finished" in capsys.readouterr().out
    assert resume(folder, steps=2000) == folder
    assert "is finished" in capsys.readouterr().out
    assert_same(outcome(folder), whole["fast"])
    resume(folder, steps=4000)
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["env_steps"], summary["stopped_by"]) == (4000, "steps")
    # The step sizes stay where their plan ended.
    arrays, _ = newest_arrays(folder)
    assert arrays["learner/progress"] == 1.0
    assert "is finished" not in capsys.readouterr().out
    resume(folder)
    assert "is finished" in capsys.readouterr().out


def test_an_extension_remembers_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    train(small("fast", training__steps="2000"), tmp_path / "run", test=False)
    with monkeypatch.context() as patch:
        patch.setattr("navrl.running.session.Interruption", Cut)
        Cut.moves_left = 100
        with pytest.raises(Interrupted):
            resume(tmp_path / "run", steps=4000)
    resume(tmp_path / "run")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["env_steps"] == 4000


def test_the_start_of_a_resuming_process_counts(stopped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("navrl.running.clock._claimed", False)
    monkeypatch.setattr("navrl.running.clock._process_age", lambda: 1000.0)
    before = Checkpoints(stopped / "checkpoints").newest().record["clock"]["wall_s"]
    resume(stopped)
    assert json.loads((stopped / "summary.json").read_text())["wall_s"] > before + 1000.0


def test_there_is_nothing_to_resume(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no run to resume"):
        resume(tmp_path)


def test_one_process_at_a_time(stopped: Path) -> None:
    with RunFolder.open(stopped), pytest.raises(UserError, match="in use by another navrl train"):
        resume(stopped)
    program = (
        f"from navrl.running.folder import RunFolder; from pathlib import Path; RunFolder.open(Path({str(stopped)!r}))"
    )
    with RunFolder.open(stopped):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "in use by another navrl train" in done.stderr
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_folder_that_is_not_empty_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(UserError, match="not empty"):
        train(small("fast"), tmp_path, test=False)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    with pytest.raises(UserError, match=r"mine\.txt/run: cannot be used as a run folder"):
        train(small("fast"), tmp_path / "mine.txt" / "run", test=False)


def test_a_run_in_a_world_file_keeps_it_and_may_be_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = tmp_path / "hall.json"
    world.write_text(json.dumps({"area": [-3, -3, 3, 3], "boxes": [[0, 0, 0.3, 1.0, 0.4]]}))
    config = small("fast", world__name=str(world))
    train(config, tmp_path / "whole", test=False)
    with monkeypatch.context() as patch:
        patch.setattr("navrl.running.session.Interruption", Cut)
        Cut.moves_left = 300
        with pytest.raises(Interrupted):
            train(config, tmp_path / "first", test=False)
    world.unlink()
    (tmp_path / "elsewhere").mkdir()
    moved = (tmp_path / "first").rename(tmp_path / "elsewhere" / "second")
    resume(moved)
    assert_same(outcome(moved), outcome(tmp_path / "whole"))
    assert load_config(moved / "config.toml").world.name == str(moved / "world.json")


def test_a_run_whose_lidar_loses_beams_continues_bitwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = small("fast", lidar__drop_probability="0.3")
    train(config, tmp_path / "whole", test=False)
    with monkeypatch.context() as patch:
        patch.setattr("navrl.running.session.Interruption", Cut)
        Cut.moves_left = 300
        with pytest.raises(Interrupted):
            train(config, tmp_path / "run", test=False)
    resume(tmp_path / "run")
    assert_same(outcome(tmp_path / "run"), outcome(tmp_path / "whole"))
