"""Files that survive a crash: written beside, flushed to the disk, then renamed into place.

    write_file(path, content);  sync_folder(folder)

File modes obey the umask. Names that begin with PENDING are leftovers of a write that was cut short.
"""

from __future__ import annotations

import os
from pathlib import Path

PENDING = ".new-"
"""Beginning of the name of what is not complete yet."""


def write_file(path: Path, content: bytes) -> None:
    """Puts a file in place; a crash at any moment leaves the old content or the new one complete.

    Args:
        path: The file, in a folder that exists.
        content: All of it.

    Raises:
        OSError: It could not be written; an older file of that name is untouched.
    """
    pending = path.with_name(PENDING + path.name)
    try:
        with pending.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(pending, path)
    except OSError as error:
        pending.unlink(missing_ok=True)
        if error.errno is not None:  # a full disk names no file, and others the pending one
            error.filename, error.filename2 = str(path), None
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Flushes the names in a folder to the disk, so that a rename in it survives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
