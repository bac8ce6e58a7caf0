"""From options as typed to settings, numbers and files that commands can use."""

import os
from argparse import Namespace
from pathlib import Path

from navrl.config import THREADS_MAX
from navrl.config.files import Option
from navrl.errors import UserError

KEYS = {
    "world": "world.name",
    "boxes": "world.boxes",
    "beams": "lidar.beams",
    "noise": "lidar.noise",
    "algorithm": "learner.algorithm",
    "steps": "training.steps",
    "episodes": "training.episodes",
    "until": "training.until",
}
"""Options that stand for a configuration key."""
OTHER_LENGTH = {"steps": "training.episodes", "episodes": "training.steps"}
"""A length given as steps replaces one that was set as episodes, and the reverse."""


def given_settings(options: Namespace, *names: str) -> list[Option]:
    """The settings given by these options, then those given by key path.

    Args:
        options: what was typed.
        names: options of KEYS that the command has.
    """
    given = [(name, getattr(options, name)) for name in names if getattr(options, name) is not None]
    own = [Option(f"--{name}", KEYS[name], text) for name, text in given]
    own += [Option(f"--{name}", OTHER_LENGTH[name], "0") for name, _ in given if name in OTHER_LENGTH]
    return [*own, *(Option(f"--{key}", key, text) for key, text in options.settings)]


def whole_number(flag: str, text: str, least: int, most: int) -> int:
    """Reads the value of an option that is no configuration key.

    Raises:
        UserError: it is not a whole number of the range.
    """
    try:
        number = int(text)
    except ValueError:
        number = least - 1
    if not least <= number <= most:
        raise UserError(f"{flag} {text}: must be a whole number in [{least}, {most}]")
    return number


def margin(flag: str, text: str) -> float:
    """Reads a margin in metres.

    Raises:
        UserError: it is not a number in [0, 1].
    """
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0.0 <= number <= 1.0:
        raise UserError(f"{flag} {text}: must be a number of metres in [0, 1]")
    return number


def threads(text: str | None) -> int:
    """Number of threads: as given by --threads, or as many as this process has cores."""
    if text is not None:
        return whole_number("--threads", text, 1, THREADS_MAX)
    from navrl.machine import cores

    return cores()


def output_file(flag: str, text: str) -> Path:
    """A file that can be written, as far as one can tell before the work.

    Returns:
        The file, behind a link where it is one.

    Raises:
        UserError: it is a folder, a device or a pipe, or its folder does not exist or cannot be written to.
    """
    if not text:
        raise UserError(f"{flag}: expects the name of a file")
    typed = Path(text)
    try:
        path = typed.resolve() if typed.is_symlink() else typed
    except RuntimeError:  # from Python 3.13 on an OSError, which is told as any other
        raise UserError(f"{flag} {text}: is a link that leads back to itself") from None
    if path.is_dir():
        raise UserError(f"{flag} {text}: is a folder, not a file")
    if path.exists() and not path.is_file():
        raise UserError(f"{flag} {text}: is a device or a pipe, not a file")
    if not path.parent.is_dir():
        raise UserError(f"{flag} {text}: no such folder {path.parent}")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise UserError(f"{flag} {text}: cannot be written")
    return path
