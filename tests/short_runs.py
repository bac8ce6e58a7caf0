"""Runs of seconds, of both presets, and what is compared of them."""

import csv
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl.config import Config
from navrl.config.files import Option, load_config
from navrl.replay import Replay, row_width
from navrl.running import interrupt
from navrl.running.checkpoint import Checkpoints
from navrl.running.session import Interrupted, resume, train
from navrl.running.training_metrics import CLOCKED

PRESETS = ("fast", "paper")
FAST = {
    "training.num_envs": "8",
    "training.steps": "3000",
    "training.updates_per_step": "1.3",
    "exploration.random_steps": "200",
    "replay.capacity": "1500",
    "networks.hidden_sizes": "[16, 16]",
    "learner.batch_size": "16",
    "validation.every_steps": "1000",
    "validation.scenarios": "10",
    "task.time_limit": "10.0",
    "checkpoint.every_s": "1e6",
}
PAPER = {
    "training.episodes": "12",
    "replay.capacity": "400",
    "networks.hidden_sizes": "[16, 12]",
    "learner.batch_size": "8",
    "validation.every_steps": "150",
    "validation.scenarios": "5",
    "task.time_limit": "6.0",
    "exploration.forced_range": "3.0",
    "checkpoint.every_s": "1e6",
}
CLOCKED_IN_SUMMARY = ("train_s", "update_s", "eval_s", "wall_s")


def small(preset: str, **changes: str) -> Config:
    """A small configuration: keys with __ for the dot."""
    settings = {**(FAST if preset == "fast" else PAPER), **{key.replace("__", "."): v for key, v in changes.items()}}
    return load_config(preset=preset, options=[Option("test", key, text) for key, text in settings.items()])


def outcome(folder: Path) -> dict[str, Any]:
    """Everything that a run leaves and that no clock decides."""
    with (folder / "metrics.csv").open(newline="") as file:
        rows = [{key: value for key, value in row.items() if key not in CLOCKED} for row in csv.DictReader(file)]
    summary = json.loads((folder / "summary.json").read_text())
    arrays, replay = newest_arrays(folder)
    # The last row's seconds are part of the metrics' state.
    arrays["metrics/last"] = arrays["metrics/last"][:3]
    return {
        "rows": rows,
        "summary": {key: value for key, value in summary.items() if key not in CLOCKED_IN_SUMMARY},
        "actor": (folder / "policy" / "actor.safetensors").read_bytes(),
        "policy": (folder / "policy" / "policy.json").read_bytes(),
        "arrays": {name: array.tobytes() for name, array in arrays.items()},
        "replay": replay.tobytes(),
    }


def newest_arrays(folder: Path) -> tuple[dict[str, NDArray[Any]], NDArray[np.float32]]:
    """Arrays and rows of replay in the newest checkpoint."""
    saved = Checkpoints(folder / "checkpoints").newest()
    inputs = saved.arrays["assembler/observations"].shape[2]
    replay = Replay(saved.record["config"]["replay"]["capacity"], row_width(inputs))
    saved.restore_replay(replay)
    return dict(saved.arrays), replay.rows


def assert_same(one: dict[str, Any], other: dict[str, Any]) -> None:
    """Compares outcomes part by part, so that a failure names the part."""
    for part in ("rows", "summary", "actor", "policy", "replay"):
        assert one[part] == other[part], part
    differing = [name for name in one["arrays"] if one["arrays"][name] != other["arrays"].get(name)]
    assert differing == []
    assert one["arrays"].keys() == other["arrays"].keys()


class Cut(interrupt.Interruption):
    """A signal that comes before the move of a given number."""

    moves_left = 0

    @property
    def requested(self) -> bool:
        Cut.moves_left -= 1
        return Cut.moves_left < 0

    @requested.setter
    def requested(self, value: bool) -> None:
        pass


def run_with_cuts(config: Config, folder: Path, preset: str, cuts: Iterator[int], patch: pytest.MonkeyPatch) -> int:
    """Trains, cut after each of the numbers of moves in turn, then to the end; returns the number of cuts made."""
    patch.setattr("navrl.running.session.Interruption", Cut)
    made = 0
    while True:
        Cut.moves_left = next(cuts, 10**9)
        try:
            if made == 0:
                train(config, folder, preset=preset, test=False)
            else:
                resume(folder)
        except Interrupted:
            made += 1
            continue
        return made


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "navrl.cli", *arguments]


def options(preset: str, **changes: str) -> list[str]:
    settings = {**(FAST if preset == "fast" else PAPER), **{key.replace("__", "."): v for key, v in changes.items()}}
    return ["--preset", preset, "--no-test", *(word for key, text in settings.items() for word in (f"--{key}", text))]


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    """Waits until the path exists."""
    while not path.exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
