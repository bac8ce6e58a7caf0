"""Saved states of a run: tensors in safetensors, the rest in JSON, never pickle.

    checkpoints/<number>/manifest.json          the caller's record, and the size and SHA-256 of every file
    checkpoints/<number>/state.safetensors      every array but replay
    checkpoints/rows/rows-<first>-<last>.safetensors     rows of replay by their number, shared between checkpoints

    Checkpoints(folder)                          removes leftovers
        .save(record, arrays, replay, keep=)     a crash or a full disk at any moment leaves the older ones complete
        .prepare(record, arrays, replay, keep=)  the same in two parts: calling the result writes
        .newest() -> Saved                       .record, .arrays, .restore_replay(replay)
    CheckpointError                              one line that names the file

A checkpoint writes only the rows that were added since the one before. Rows never change once they are written, so a
file of rows stays until no kept checkpoint needs one of them. A manifest makes a checkpoint valid: its folder appears
under its number by one rename, after everything that it names is on the disk.

A damaged file is named, never skipped in silence: a disk that flips bits is worth knowing about. The message offers the
newest checkpoint that is intact, from which the run goes on to the same results.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from navrl.durable import PENDING, sync_folder, write_file
from navrl.errors import UserError
from navrl.replay import Arrays, Replay

SCHEMA = 1
"""Version of the files' layout."""
MANIFEST = "manifest.json"
STATE = "state.safetensors"
ROWS = "rows"
REMOVED = ".old-"
"""Beginning of the name of a checkpoint that is being removed."""
CHUNK_ROWS = 1 << 16
"""Most rows of one file: one flush to the disk stays short."""
MOST_SMALL_CHUNKS = 64
"""Smaller files at the end beyond which a checkpoint joins them to one."""


class CheckpointError(UserError):
    """A checkpoint that cannot be written or read; the text names the file."""


class _DamagedError(Exception):
    """A file that is not what the manifest says; the text names it."""


@dataclass(frozen=True)
class FileEntry:
    """What a manifest says about a file."""

    file: str
    """Its path, relative to the folder of all checkpoints."""
    bytes: int
    """Its size."""
    sha256: str
    """Hash of its content, in hexadecimal digits."""


@dataclass(frozen=True)
class Chunk(FileEntry):
    """A file of rows of replay."""

    first: int
    """Number of its first row, counted from the first row ever added."""
    last: int
    """Number after its last row."""

    @property
    def rows(self) -> int:
        """How many rows it holds."""
        return self.last - self.first


class Saved:
    """A checkpoint that was read; its rows stay on the disk until they are asked for."""

    def __init__(self, checkpoints: Checkpoints, number: int) -> None:
        """Reads and checks the manifest and the arrays."""
        self._checkpoints = checkpoints
        self.number = number
        """The checkpoint's number, from 0."""
        self.record = _read_manifest(checkpoints.folder / _name(number))
        """The record that was saved, and the keys of the manifest."""
        self.chunks = [Chunk(**entry) for entry in self.record["rows"]]
        """Files of rows, in the rows' order."""
        self.arrays: Arrays = _read_tensors(checkpoints.folder, FileEntry(**self.record["state"]))
        """Arrays by name."""

    def restore_replay(self, replay: Replay) -> None:
        """Fills an empty ring with the rows that were in it; its counter is part of `arrays`.

        Args:
            replay: Ring of the same capacity and width.

        Raises:
            CheckpointError: A file is damaged, or has rows of another width.
        """
        try:
            for chunk in self.chunks:
                rows = _read_rows(self._checkpoints.folder, chunk)
                if rows.shape[1] != replay.width:
                    name = self._checkpoints.folder / chunk.file
                    raise CheckpointError(f"{name}: rows of {rows.shape[1]} columns, this run needs {replay.width}")
                kept = min(len(rows), replay.capacity)
                replay.write(chunk.last - kept, rows[len(rows) - kept :])
        except _DamagedError as damage:
            raise self._checkpoints.refusal(self.number, damage) from None


class Checkpoints:
    """The checkpoints of a run, for the one process that holds the run's lock."""

    def __init__(self, folder: Path) -> None:
        """Removes what a crash left incomplete.

        Args:
            folder: Folder of all checkpoints of the run; the first checkpoint makes it.
        """
        self.folder = folder
        self._remove_leftovers()
        self._chunks: dict[int, Sequence[Chunk]] = {}
        for number in self.numbers():
            try:
                record = _read_manifest(folder / _name(number))
            except _DamagedError:
                return  # its files of rows are unknown, so none may be removed
            self._chunks[number] = [Chunk(**entry) for entry in record["rows"]]
        self._remove_unused_chunks()

    def numbers(self) -> list[int]:
        """Numbers of the complete checkpoints, oldest first."""
        return sorted(int(path.name) for path in _entries(self.folder) if path.name.isascii() and path.name.isdigit())

    def newest(self) -> Saved:
        """Reads the newest checkpoint.

        Returns:
            Its content.

        Raises:
            CheckpointError: There is none, a file of it is damaged, or another version wrote it.
        """
        numbers = self.numbers()
        if not numbers:
            raise CheckpointError(f"{self.folder}: no checkpoint to resume from; start the run anew")
        try:
            return Saved(self, numbers[-1])
        except _DamagedError as damage:
            raise self.refusal(numbers[-1], damage) from None

    def refusal(self, number: int, damage: Exception) -> CheckpointError:
        """The error for a damaged checkpoint: names the file and offers the newest one before it that is intact."""
        for older in [n for n in reversed(self.numbers()) if n < number]:
            try:
                saved = Saved(self, older)
                for chunk in saved.chunks:
                    _read_rows(self.folder, chunk)
            except (_DamagedError, CheckpointError):
                continue
            newer = " ".join(str(self.folder / _name(n)) for n in self.numbers() if n > older)
            offer = f"checkpoint {_name(older)} before it is intact: rm -r {newer} and resume again"
            return CheckpointError(f"{damage}; {offer}")
        return CheckpointError(f"{damage}; no other checkpoint of this run is intact: start the run anew")

    def save(self, record: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], replay: Replay, *, keep: int) -> None:
        """Writes a checkpoint, then removes those beyond the newest `keep`.

        Args:
            record: What JSON can hold; floats come back to the same bits.
            arrays: Arrays by name.
            replay: The ring, whose rows are saved apart from its counter.
            keep: Newest checkpoints kept, at least 1.

        Raises:
            CheckpointError: The disk refused; the older checkpoints are complete.
        """
        self.prepare(record, arrays, replay, keep=keep)()

    def prepare(
        self, record: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], replay: Replay, *, keep: int
    ) -> Callable[[], None]:
        """Takes copies of the new rows, so that a checkpoint can be written while replay goes on.

        Args:
            record: As for `save`; nobody may change it until it is written.
            arrays: As for `save`; nobody may change them until they are written.
            replay: As for `save`.
            keep: As for `save`.

        Returns:
            What writes the checkpoint, in any thread but before the next one is prepared; it raises as `save` does.
        """
        newest = self._chunks[max(self._chunks)] if self._chunks else []
        chunks = [chunk for chunk in newest if chunk.last > replay.oldest]
        first = max(chunks[-1].last if chunks else 0, replay.oldest)
        small = 0
        while small < len(chunks) and chunks[-1 - small].rows < CHUNK_ROWS:
            small += 1
        if first < replay.added and small >= MOST_SMALL_CHUNKS:
            first = max(chunks[-small].first, replay.oldest)
            del chunks[-small:]
        starts = range(first, replay.added, CHUNK_ROWS)
        rows = {start: replay.read(start, min(start + CHUNK_ROWS, replay.added)) for start in starts}
        return partial(self._write, record, arrays, chunks, rows, keep)

    def _write(
        self,
        record: Mapping[str, Any],
        arrays: Mapping[str, NDArray[Any]],
        chunks: list[Chunk],
        rows: Mapping[int, NDArray[np.float32]],
        keep: int,
    ) -> None:
        """Writes `rows`, by the number of the first, as files beside `chunks`, then the rest of the checkpoint."""
        number = max(self.numbers(), default=-1) + 1
        pending = self.folder / (PENDING + _name(number))
        try:
            (self.folder / ROWS).mkdir(parents=True, exist_ok=True)
            chunks = chunks + [self._write_chunk(first, array) for first, array in rows.items()]
            pending.mkdir()
            state = save({name: np.asarray(array, order="C") for name, array in arrays.items()})
            write_file(pending / STATE, state)
            entry = _entry(f"{_name(number)}/{STATE}", state)
            manifest = {"schema": SCHEMA, "navrl": metadata.version("navrl"), **record}
            manifest |= {"state": asdict(entry), "rows": [asdict(chunk) for chunk in chunks]}
            manifest["sha256"] = _digest(manifest)
            write_file(pending / MANIFEST, _dump(manifest))
            os.rename(pending, self.folder / _name(number))
            sync_folder(self.folder)
            self._chunks[number] = chunks
            self._remove_older(keep)
        except OSError as error:
            shutil.rmtree(pending, ignore_errors=True)
            self._remove_unused_chunks()
            kept = "the newest one there is complete" if self.numbers() else "there is none before it"
            raise CheckpointError(f"{self.folder}: no checkpoint could be saved: {error.strerror}; {kept}") from error

    def _write_chunk(self, first: int, rows: NDArray[np.float32]) -> Chunk:
        last = first + len(rows)
        name = f"{ROWS}/rows-{first:012d}-{last:012d}.safetensors"
        content = save({"rows": rows})
        write_file(self.folder / name, content)
        return Chunk(**asdict(_entry(name, content)), first=first, last=last)

    def _remove_older(self, keep: int) -> None:
        for number in self.numbers()[:-keep]:
            removed = self.folder / (REMOVED + _name(number))
            os.rename(self.folder / _name(number), removed)
            shutil.rmtree(removed)
            self._chunks.pop(number, None)
        self._remove_unused_chunks()

    def _remove_unused_chunks(self) -> None:
        if set(self._chunks) != set(self.numbers()):
            return  # a manifest could not be read
        used = {chunk.file for chunks in self._chunks.values() for chunk in chunks}
        for path in _entries(self.folder / ROWS):
            if f"{ROWS}/{path.name}" not in used:
                path.unlink()

    def _remove_leftovers(self) -> None:
        for path in [*_entries(self.folder), *_entries(self.folder / ROWS)]:
            if path.name.startswith((PENDING, REMOVED)):
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def _entries(folder: Path) -> list[Path]:
    """What is in a folder; nothing if there is none."""
    return list(folder.iterdir()) if folder.is_dir() else []


def _name(number: int) -> str:
    return f"{number:08d}"


def _entry(name: str, content: bytes) -> FileEntry:
    return FileEntry(name, len(content), hashlib.sha256(content).hexdigest())


def _dump(manifest: Mapping[str, Any]) -> bytes:
    return json.dumps(manifest, indent=1).encode()


def _digest(manifest: Mapping[str, Any]) -> str:
    """Hash of everything in a manifest but the hash itself."""
    content = {key: value for key, value in manifest.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _read_manifest(folder: Path) -> dict[str, Any]:
    path = folder / MANIFEST
    try:
        content = path.read_bytes()
        manifest: dict[str, Any] = json.loads(content)
    except OSError as error:
        raise _DamagedError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from None
    except (ValueError, RecursionError):
        raise _DamagedError(f"{path}: damaged: not JSON") from None
    sound = isinstance(manifest, dict) and _dump(manifest) == content and manifest.get("sha256") == _digest(manifest)
    if not sound:
        raise _DamagedError(f"{path}: damaged: its content does not fit its sha256")
    if manifest["schema"] != SCHEMA:
        own = f"navrl {metadata.version('navrl')} reads schema {SCHEMA}"
        raise CheckpointError(f"{path}: schema {manifest['schema']} of navrl {manifest['navrl']}, but {own}")
    return manifest


def _read_file(folder: Path, entry: FileEntry) -> bytes:
    path = folder / entry.file
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _DamagedError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from None
    if len(content) != entry.bytes:
        raise _DamagedError(f"{path}: damaged: {len(content)} bytes, expected {entry.bytes}")
    if hashlib.sha256(content).hexdigest() != entry.sha256:
        raise _DamagedError(f"{path}: damaged: its content does not fit its sha256 {entry.sha256[:12]}...")
    return content


def _read_tensors(folder: Path, entry: FileEntry) -> dict[str, NDArray[Any]]:
    try:
        tensors: dict[str, NDArray[Any]] = load(_read_file(folder, entry))
    except SafetensorError as error:
        raise _DamagedError(f"{folder / entry.file}: not safetensors: {error}") from None
    return tensors


def _read_rows(folder: Path, chunk: Chunk) -> NDArray[np.float32]:
    rows: NDArray[np.float32] = _read_tensors(folder, chunk)["rows"]
    return rows
