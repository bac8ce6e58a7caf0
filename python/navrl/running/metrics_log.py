"""Where the rows of metrics go: metrics.csv and a TensorBoard event file, both in the run folder.

    MetricsLog(folder, resume_at=None)
        .add(row);  .sync() -> bytes of metrics.csv on the disk;  .close()

A resumed run cuts metrics.csv back to what the checkpoint knows, and tells TensorBoard to forget later steps, so that
no row appears twice.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from tensorboard.compat.proto.event_pb2 import Event, SessionLog  # type: ignore[import-untyped]
from tensorboard.compat.proto.summary_pb2 import Summary  # type: ignore[import-untyped]
from tensorboard.summary.writer.event_file_writer import EventFileWriter  # type: ignore[import-untyped]

from navrl.errors import UserError
from navrl.running.training_metrics import COLUMNS, Row

FILE = "metrics.csv"
GROUPS = {
    "rollout": ("success", "collision", "timeout", "return", "training_return", "episode_length", "v", "omega"),
    "learner": ("critic_loss", "average_q", "maximum_q", "actor_loss", "saturated_share"),
    "speed": ("sps", "ups"),
}
"""TensorBoard's headings; the validation columns go under "validation"."""


class ResumePoint(NamedTuple):
    """Where a resumed run continues its log."""

    bytes: int
    """Size of metrics.csv at the checkpoint."""
    steps: int
    """Environment steps of its newest row."""


class MetricsLog:
    """Appends rows of metrics to the files of a run."""

    def __init__(self, folder: Path, resume_at: ResumePoint | None = None) -> None:
        """Opens the files.

        Args:
            folder: The run folder.
            resume_at: Where to continue; None begins anew.

        Raises:
            UserError: metrics.csv is shorter than the checkpoint says, or cannot be written.
        """
        path = folder / FILE
        if resume_at is not None and (not path.exists() or path.stat().st_size < resume_at.bytes):
            raise UserError(f"{path}: rows that the checkpoint knows are missing; restore the file to resume")
        self._csv = path.open("w" if resume_at is None else "r+", encoding="utf-8", newline="")
        if resume_at is None:
            self._csv.write(",".join(COLUMNS) + "\n")
            self._csv.flush()
        else:
            self._csv.truncate(resume_at.bytes)
            self._csv.seek(0, os.SEEK_END)
        self._events = EventFileWriter(str(folder))
        if resume_at is not None:
            # TensorBoard drops what it has read of steps from this one on.
            start = SessionLog(status=SessionLog.START)
            self._events.add_event(Event(wall_time=time.time(), step=resume_at.steps + 1, session_log=start))

    def add(self, row: Row) -> None:
        """Writes one row: empty where a value is None."""
        self._csv.write(",".join("" if row[name] is None else repr(row[name]) for name in COLUMNS) + "\n")
        self._csv.flush()
        values = [Summary.Value(tag=_tag(name), simple_value=row[name]) for name in COLUMNS if _shown(name, row)]
        self._events.add_event(Event(wall_time=time.time(), step=int(row["steps"] or 0), summary=Summary(value=values)))

    def sync(self) -> int:
        """Flushes metrics.csv to the disk.

        Returns:
            Its size in bytes.
        """
        self._csv.flush()
        os.fsync(self._csv.fileno())
        return self._csv.tell()

    def close(self) -> None:
        """Closes both files; what a full disk has not taken is lost, as the error that told of it said."""
        for file in (self._csv, self._events):
            with suppress(OSError):
                file.close()


def _shown(name: str, row: Row) -> bool:
    return row[name] is not None and name not in ("steps", "train_s")


def _tag(name: str) -> str:
    heading = next((heading for heading, names in GROUPS.items() if name in names), "progress")
    return name.replace("_", "/", 1) if name.startswith("validation_") else f"{heading}/{name}"
