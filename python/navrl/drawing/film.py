"""An episode as a picture (.png) or a film (.gif, .mp4).

check_output(file);  write(trajectory, file, title=...)
"""

from __future__ import annotations

import io
import math
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from navrl.drawing.trajectory import Trajectory
from navrl.durable import PENDING, write_file
from navrl.errors import UserError

if TYPE_CHECKING:
    from PIL import Image

    from navrl.drawing.render import Room

FORMATS = (".png", ".gif", ".mp4")
PICTURE_PX, FILM_PX = 1000, 560
"""Longer side of the room in a picture and in a film."""
GIF_RATE, MP4_RATE = 12.5, 25.0
"""Most frames a second."""
SPEED_UP = 2.5
"""How much faster than the robot a film runs, unless it would have too many frames."""
FRAMES_MAX = 300
LAST_FRAME_S = 1.5
"""How long a film shows the end."""
GHOST_S = 2.0
"""Time between the faint robots of a picture, seconds."""


def check_output(file: Path) -> None:
    """Refuses a file that `write` could not write, before anything is computed.

    Args:
        file: Where the picture or film is to go.

    Raises:
        UserError: Another ending, no such folder, or a film for which software is missing.
    """
    if file.suffix.lower() not in FORMATS:
        raise UserError(f"{file}: expected a name that ends in {', '.join(FORMATS)}")
    if not file.parent.is_dir():
        raise UserError(f"{file}: no such folder {file.parent}")
    if file.suffix.lower() == ".mp4":
        try:
            import_module("imageio_ffmpeg")
        except ImportError:
            raise UserError(
                f"{file}: needs the extra package of pip install 'navrl[video]'; .gif works without"
            ) from None


def write(trajectory: Trajectory, file: Path, *, title: str) -> float | None:
    """Writes an episode as a picture (.png) or a film (.gif, .mp4), which says how fast it runs.

    Args:
        trajectory: The episode.
        file: Where to; `check_output` says what is possible.
        title: First line of the caption.

    Returns:
        How many times as fast as the robot the film runs; None for a picture.
    """
    from navrl.drawing.legend import Item, ring
    from navrl.drawing.render import GHOST, GHOST_EDGE, Room

    kind, speed = file.suffix.lower(), None
    size, supersample = (PICTURE_PX, 4) if kind == ".png" else (FILM_PX, 2)
    explained = Item(f"the robot every {GHOST_S:g} s", ring(GHOST_EDGE, GHOST))
    if kind != ".png":
        speed = shown_speed(trajectory.steps, trajectory.sim.task.period, GIF_RATE if kind == ".gif" else MP4_RATE)
        explained = Item(f"shown {speed:.3g} times as fast")
    room = Room(
        trajectory.scenario,
        trajectory.sim,
        title=title,
        size=size,
        supersample=supersample,
        path=trajectory.poses[:, :2],
        planned=trajectory.planned,
        explained=[explained],
    )
    if kind == ".mp4":
        _write_mp4(trajectory, room, file)
        return speed
    content = io.BytesIO()
    if kind == ".png":
        picture(trajectory, room).save(content, "PNG", optimize=True)
    else:
        _save_gif(trajectory, room, content)
    write_file(file, content.getvalue())
    return speed


def picture(trajectory: Trajectory, room: Room) -> Image.Image:
    """The whole episode in one picture.

    The path, faint robots along it, the robot at the end, and with its rays the one nearest to an obstacle that it saw.

    Args:
        trajectory: The episode.
        room: Where to draw it.

    Returns:
        RGB image.
    """
    every = max(1, round(GHOST_S / trajectory.sim.task.period))
    ghosts = trajectory.poses[every : trajectory.steps : every]
    nearest = int(np.nan_to_num(trajectory.ranges, nan=np.inf).min(axis=1).argmin())
    return room.draw(trajectory.moment(trajectory.steps), ghosts=ghosts, scan=trajectory.moment(nearest))


def frame_steps(steps: int, period: float, rate: float) -> tuple[list[int], float]:
    """Which steps a film shows.

    Args:
        steps: Steps of the episode.
        period: Control period, seconds.
        rate: Most frames a second.

    Returns:
        Steps, the last one among them, and the time between them (s of the film).
    """
    every = max(1, math.ceil(SPEED_UP / (rate * period) - 1e-9))
    interval = every * period / SPEED_UP
    # A longer episode runs faster instead of growing without end.
    every = max(every, math.ceil(steps / FRAMES_MAX))
    return [*range(0, steps, every), steps], interval


def shown_speed(steps: int, period: float, rate: float) -> float:
    """How many times as fast as the robot a film runs.

    Args:
        steps: Steps of the episode.
        period: Control period, seconds.
        rate: Most frames a second.
    """
    shown, interval = frame_steps(steps, period, rate)
    return shown[1] * period / interval if len(shown) > 2 else SPEED_UP


def _save_gif(trajectory: Trajectory, room: Room, content: io.BytesIO) -> None:
    from PIL import Image

    shown, interval = frame_steps(trajectory.steps, trajectory.sim.task.period, GIF_RATE)
    frames = [room.draw(trajectory.moment(step)) for step in shown]
    # One palette for all frames keeps colours still and the file small: from moments all along the episode, and from
    # every colour that a ray may take.
    samples = [*frames[:: max(1, len(frames) // 8)], room.swatch()]
    strip = Image.new("RGB", (room.width, sum(sample.height for sample in samples)))
    top = 0
    for sample in samples:
        strip.paste(sample, (0, top))
        top += sample.height
    palette = strip.quantize(128, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    milliseconds = [round(1000 * interval)] * (len(frames) - 1) + [round(1000 * LAST_FRAME_S)]
    indexed[0].save(content, "GIF", save_all=True, append_images=indexed[1:], duration=milliseconds, loop=0)


def _write_mp4(trajectory: Trajectory, room: Room, file: Path) -> None:
    imageio_ffmpeg = import_module("imageio_ffmpeg")
    shown, interval = frame_steps(trajectory.steps, trajectory.sim.task.period, MP4_RATE)
    pending = file.with_name(PENDING + file.name)
    size = (room.width, room.height)
    writer = imageio_ffmpeg.write_frames(str(pending), size, fps=1 / interval, macro_block_size=2, quality=8)
    try:
        writer.send(None)
        for step in [*shown, *([trajectory.steps] * round(LAST_FRAME_S / interval))]:
            writer.send(room.draw(trajectory.moment(step)).tobytes())
        writer.close()
        pending.replace(file)
    finally:
        writer.close()
        pending.unlink(missing_ok=True)
