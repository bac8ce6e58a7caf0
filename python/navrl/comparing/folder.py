"""The folder of a comparison: what each contender did is kept there, so that a comparison continues where it was cut.

DIR/settings.json                     list, level and settings of every result in the folder
DIR/contenders/NAME.json, NAME.npz    scores and episodes, and where the robot was
DIR/results.json, episodes.jsonl, report.md, *.png    written at the end, anew each time
"""

from __future__ import annotations

import io
import json
from collections.abc import Collection
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
from navrl.metrics import OUTCOMES, Episode

SCHEMA = 2
"""Version of what is kept."""
SETTINGS_FILE = "settings.json"
CONTENDERS = "contenders"
LONGEST_NAME = 150
"""Characters of a contender's name in a file name: systems allow 255 bytes."""
TERMS = {
    "schema": "layout",
    "navrl": "version of navrl",
    "level": "level",
    "list": "list",
    "world.name": "world",
    "world.boxes": "number of boxes",
    "episodes": "number of scenarios",
}
"""Settings that everybody knows, in the user's words; where one of them differs, others follow from it."""


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
    made_with: dict[str, str | None]
    """Software and processor: `navrl.machine.made_with`."""

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
        settings = {"schema": SCHEMA} | settings
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
        content = _read(file)
        if content.get("policy_sha256") != policy_sha256:
            raise UserError(
                f"{name}: the policy has changed since it was compared in {self.path}; choose another folder, or remove"
                f" {file} to drive it anew"
            )
        return _record(file, content)

    def others(self, names: Collection[str]) -> list[Record]:
        """What is kept of contenders besides these, in alphabetical order.

        Args:
            names: Contenders.

        Raises:
            UserError: A file is damaged.
        """
        contents = {file: _read(file) for file in sorted((self.path / CONTENDERS).glob("*.json"))}
        return [_record(file, content) for file, content in contents.items() if content.get("name") not in names]

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
        kept = {"name": record.name, "policy_sha256": policy_sha256, "made_with": record.made_with}
        write_file(file, _json(kept | {"scores": record.scores, "episodes": episodes}))

    def _file(self, name: str) -> Path:
        short = quote(name, safe="+")
        if len(short) > LONGEST_NAME:
            short = f"{short[:LONGEST_NAME]}-{sha256(name.encode()).hexdigest()[:16]}"
        return self.path / CONTENDERS / f"{short}.json"


def _record(file: Path, content: dict[str, Any]) -> Record:
    tracks = file.with_suffix(file.suffix + ".npz")
    try:
        name, scores, made_with = content["name"], content["scores"], content["made_with"]
        episodes = [Episode.from_json(episode) for episode in content["episodes"]]
        with np.load(tracks, allow_pickle=False) as arrays:
            poses = arrays["poses"]
        ends = np.cumsum([episode.steps for episode in episodes])
        if poses.shape != (ends[-1], 3) or not all(episode.outcome in OUTCOMES.values() for episode in episodes):
            raise ValueError("poses of other episodes, or an outcome that is none")
    except (OSError, EOFError, ValueError, TypeError, KeyError, BadZipFile):
        raise UserError(f"{file}: damaged, or {tracks.name} is; remove both") from None
    return Record(name, scores, episodes, np.split(poses, ends[:-1]), made_with)


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
    differing = [key for key in {**held, **asked} if held.get(key) != asked.get(key) and key != "list_sha256"]
    told = [key for key in TERMS if key in differing] or differing
    if told:
        differences = [f"{TERMS.get(key, key)} {_plain(held.get(key))}, not {_plain(asked.get(key))}" for key in told]
        more = f"; and {len(told) - 3} more" if len(told) > 3 else ""
        fault = "; ".join(differences[:3]) + more
    elif held.get("list_sha256") != asked.get("list_sha256"):
        fault = f"other scenarios by the name of {asked['list']}: the file of the scenarios or of the world has changed"
    else:
        return
    raise UserError(f"{path}: holds a comparison with {fault}; choose another folder, or the same settings")


def _plain(value: object) -> str:
    return value if isinstance(value, str) else shown(value)
