"""The folder of a run: who may write to it, and what lies where.

with RunFolder.create(path) as folder: ...       a new run, in a new or empty folder
with RunFolder.open(path) as folder: ...         an existing run
    .checkpoints, .policy, .config_file, .summary_file
    .keep_world(config) -> config;  .write_config(config);  .edited_config(saved)
    .tables(config) -> dict;  .config(tables)
    .write_summary(summary);  .summary() -> dict or None

DIR/summary.json  DIR/config.toml  DIR/world.json  DIR/metrics.csv  DIR/events.out.tfevents.*
DIR/checkpoints/  DIR/policy/
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self

from pydantic import TypeAdapter, ValidationError

from navrl.config import WORLDS, Config
from navrl.config.files import load_config, tables_to_toml
from navrl.durable import PENDING, write_file
from navrl.errors import UserError, shown

FREE_KEYS = ("checkpoint.every_s", "checkpoint.keep", "threads.simulate", "threads.learn")
"""Settings of which config.toml may be edited before a resume: they never change results, or (threads of torch, which
learn) the checkpoint refuses the change."""


class RunFolder:
    """A run folder that this process alone writes to, from its creation or opening until it is left.

    Folders that were made for a run which then wrote nothing are removed again.
    """

    def __init__(self, path: Path) -> None:
        """Locks the folder.

        Args:
            path: An existing folder.

        Raises:
            UserError: Another process writes to it.
        """
        self.path = path
        self._made: list[Path] = []
        # The lock belongs to the open folder, and goes with the process however it ends.
        self._descriptor = os.open(path, os.O_RDONLY)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._descriptor)
            raise UserError(f"{path}: in use by another navrl train; wait for it or choose another folder") from None

    @classmethod
    def create(cls, path: Path) -> Self:
        """Makes the folder of a new run.

        Raises:
            UserError: It is not empty, or cannot be made.
        """
        missing = [above for above in (path, *path.parents) if not above.exists()]
        try:
            path.mkdir(parents=True, exist_ok=True)
            folder = cls(path)
            if any(path.iterdir()):
                folder.__exit__()
                raise UserError(
                    f"{path}: not empty; choose another folder, or resume the run in it with --resume {path}"
                )
        except OSError as error:
            raise UserError(f"{path}: cannot be used as a run folder: {(error.strerror or '').lower()}") from None
        folder._made = missing
        return folder

    @classmethod
    def open(cls, path: Path) -> Self:
        """Opens the folder of an existing run and removes what a crash left incomplete.

        Raises:
            UserError: There is no run in it.
        """
        if not (path / "checkpoints").is_dir():
            raise UserError(f"{path}: no run to resume: it has no folder checkpoints")
        folder = cls(path)
        for leftover in [*path.glob(PENDING + "*")]:
            leftover.unlink()
        return folder

    def __enter__(self) -> Self:
        """The folder, locked since its creation."""
        return self

    def __exit__(self, *_: object) -> None:
        """Lets other processes in."""
        with suppress(OSError):  # one that holds something stays, and those above it
            for made in self._made:
                made.rmdir()
        os.close(self._descriptor)

    @property
    def checkpoints(self) -> Path:
        """Folder of the saved states."""
        return self.path / "checkpoints"

    @property
    def policy(self) -> Path:
        """Folder of the best policy so far."""
        return self.path / "policy"

    @property
    def config_file(self) -> Path:
        """The complete configuration."""
        return self.path / "config.toml"

    @property
    def summary_file(self) -> Path:
        """What a finished run reports."""
        return self.path / "summary.json"

    @property
    def world_file(self) -> Path:
        """Copy of the world file, where the world is one."""
        return self.path / "world.json"

    def keep_world(self, config: Config) -> Config:
        """Copies the world file, so that the run needs nothing outside its folder.

        Returns:
            The configuration with the copy for its world; the same one for a built-in world.
        """
        if config.world.name in WORLDS:
            return config
        write_file(self.world_file, Path(config.world.name).read_bytes())
        return replace(config, world=replace(config.world, name=str(self.world_file.absolute())))

    def tables(self, config: Config) -> dict[str, Any]:
        """The configuration as tables that stay true when the folder is moved."""
        tables = asdict(config)
        if config.world.name not in WORLDS:
            tables["world"]["name"] = self.world_file.name
        return tables

    def config(self, tables: dict[str, Any]) -> Config:
        """The configuration that `tables` wrote, perhaps in another place.

        Raises:
            UserError: A key or value is not of this version, or the world file has gone.
        """
        if tables.get("world", {}).get("name") == self.world_file.name:
            tables = {**tables, "world": {**tables["world"], "name": str(self.world_file.absolute())}}
        try:
            return TypeAdapter(Config).validate_json(json.dumps(tables))
        except ValidationError as error:
            fault = error.errors()[0]
            key = ".".join(str(part) for part in fault["loc"])
            raise UserError(f"the checkpoint's {key} = {shown(fault['input'])}: {fault['msg']}") from None

    def write_config(self, config: Config) -> None:
        """Writes config.toml, from which the run can be repeated."""
        write_file(self.config_file, tables_to_toml(self.tables(config)).encode())

    def empty(self) -> None:
        """Removes what a run wrote that ended before its first checkpoint was complete."""
        for path in self.path.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()

    def edited_config(self, saved: Config) -> Config:
        """The configuration to resume with: the saved one, with edits of config.toml that never change results.

        Args:
            saved: Configuration in the checkpoint.

        Returns:
            The configuration of config.toml, or the saved one if that file is missing.

        Raises:
            UserError: config.toml cannot be read, or differs in a setting that belongs to the saved state.
        """
        if not self.config_file.exists():
            self.write_config(saved)
            return saved
        edited = load_config(self.config_file)
        for key, value in _settings(edited).items():
            before = _settings(saved)[key]
            if value != before and key not in FREE_KEYS:
                raise UserError(
                    f"{self.config_file}: {key} = {shown(value)}, but the checkpoint was made with {shown(before)}: "
                    "a resumed run keeps its settings; set it back or start a new run"
                )
        return edited

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Writes summary.json."""
        write_file(self.summary_file, (json.dumps(summary, indent=2) + "\n").encode())

    def summary(self) -> dict[str, Any] | None:
        """What the finished run reported; None if it has not finished, or the file is damaged."""
        try:
            summary = json.loads(self.summary_file.read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        return summary if isinstance(summary, dict) and "updates" in summary else None


def _settings(config: Config) -> dict[str, Any]:
    """Values by key path."""
    return {f"{table}.{key}": value for table, values in asdict(config).items() for key, value in values.items()}
