"""The folder of a comparison: what each contender did is kept there, so that a comparison continues where it was cut.

DIR/settings.json                     what every result in the folder was made with
DIR/contenders/NAME.json, NAME.npz    scores and episodes, and where the robot was
DIR/results.json, episodes.jsonl, report.md, *.png    written at the end, anew each time
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any
from urllib.parse import quote
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from navrl.durable import write_file
from navrl.errors import UserError, shown
from navrl.metrics import Episode

SETTINGS_FILE = "settings.json"
CONTENDERS = "contenders"
LONGEST_NAME = 150
"""Characters of a contender's name in a file name: systems allow 255 bytes."""


@dataclass(frozen=True)
class Record:
    """What a contender did on a list."""

    name: str
    """The contender."""
    scores: dict[str, Any]
    """SCORES, and what is known of its planner and of the times that it takes."""
    episodes: list[Episode]
    """One for each scenario."""
    tracks: list[NDArray[np.float32]]
    """(steps, 3) x, y, yaw (m, m, rad) after each step of each scenario."""

    def solved(self) -> list[bool]:
        """Which scenarios it reached the goal of."""
        return [episode.outcome == "goal" for episode in self.episodes]


class ComparisonFolder:
    """Where results of one list, level and set of settings are kept."""

    def __init__(self, path: Path, settings: dict[str, Any]) -> None:
        """Opens a folder or makes it.

        Args:
            path: New, empty, or of a comparison with the same settings.
            settings: What results depend on besides their contender; JSON values by dotted keys.

        Raises:
            UserError: It is no folder, it holds something else, or a comparison with other settings.
        """
        self.path = path
        if path.exists() and not path.is_dir():
            raise UserError(f"--out {path}: is not a folder")
        file = path / SETTINGS_FILE
        if file.is_file():
            _check_settings(path, _read(file), settings)
        elif path.is_dir() and any(path.iterdir()):
            raise UserError(f"--out {path}: is not empty and holds no comparison")
        (path / CONTENDERS).mkdir(parents=True, exist_ok=True)
        write_file(file, _json(settings))

    def read(self, name: str, policy_sha256: str | None) -> Record | None:
        """What a contender did before, if it is kept here.

        Args:
            name: The contender.
            policy_sha256: Its policy, if it has one.

        Raises:
            UserError: The policy of that name was another one then, or a file is damaged.
        """
        file = self._file(name)
        if not file.is_file():
            return None
        record, tracks = _read(file), file.with_suffix(file.suffix + ".npz")
        if record.get("policy_sha256") != policy_sha256:
            raise UserError(f"{self.path}: holds results of another policy {name}; choose another folder")
        try:
            scores, episodes = record["scores"], [Episode.from_json(episode) for episode in record["episodes"]]
            with np.load(tracks, allow_pickle=False) as arrays:
                poses = arrays["poses"]
            ends = np.cumsum([episode.steps for episode in episodes])
            if poses.shape != (ends[-1], 3):
                raise ValueError("poses of other episodes")
        except (OSError, EOFError, ValueError, TypeError, KeyError, BadZipFile):
            raise UserError(f"{file}: damaged, or {tracks.name} is; remove both") from None
        return Record(name, scores, episodes, np.split(poses, ends[:-1]))

    def keep(self, record: Record, policy_sha256: str | None) -> None:
        """Keeps what a contender did; a crash leaves it complete or absent.

        Args:
            record: What it did.
            policy_sha256: Its policy, if it has one.
        """
        file, content = self._file(record.name), io.BytesIO()
        np.savez_compressed(content, poses=np.concatenate(record.tracks))
        write_file(file.with_suffix(file.suffix + ".npz"), content.getvalue())
        episodes = [episode.to_json() for episode in record.episodes]
        kept = {"name": record.name, "policy_sha256": policy_sha256, "scores": record.scores, "episodes": episodes}
        write_file(file, _json(kept))

    def _file(self, name: str) -> Path:
        short = quote(name, safe="+")
        if len(short) > LONGEST_NAME:
            short = f"{short[:LONGEST_NAME]}-{sha256(name.encode()).hexdigest()[:16]}"
        return self.path / CONTENDERS / f"{short}.json"


def _read(file: Path) -> dict[str, Any]:
    try:
        record = json.loads(file.read_text(encoding="utf-8"), parse_constant=_no_number)
    except ValueError:
        record = None
    if not isinstance(record, dict):
        raise UserError(f"{file}: damaged: not the JSON of a comparison")
    return record


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


def _json(value: Any) -> bytes:  # noqa: ANN401 - any JSON value
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def _check_settings(path: Path, held: dict[str, Any], asked: dict[str, Any]) -> None:
    for key in {**held, **asked}:
        old, new = held.get(key), asked.get(key)
        if old != new:
            raise UserError(f"{path}: holds a comparison with another {key}: {shown(old)}, not {shown(new)}")
