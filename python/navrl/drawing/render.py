"""Pictures of a robot in its room: obstacles, path, goal, and the lidar's rays coloured by danger (the paper's figure).

Everything is drawn with Pillow on a canvas several times too large and then reduced, which smooths every edge. The part
of the room that does not move is drawn once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from navrl.drawing.legend import Item, legend, line, ramp, ring

if TYPE_CHECKING:
    from navrl.batch import Scenario
    from navrl.config import LidarConfig, SimConfig

Color = tuple[int, int, int]

PAPER: Color = (255, 255, 255)
FLOOR: Color = (250, 250, 247)
GRID: Color = (236, 236, 231)
OBSTACLE: Color = (74, 85, 104)
OBSTACLE_EDGE: Color = (45, 55, 72)
INK: Color = (38, 44, 56)
FAINT_INK: Color = (124, 131, 143)
PATH: Color = (37, 99, 235)
PLANNED: Color = (217, 119, 6)
ROBOT: Color = (29, 78, 216)
GHOST, GHOST_EDGE = (214, 222, 241), (134, 158, 230)
"""A robot that was there before, as it looks on the floor."""
GOAL: Color = (5, 150, 105)
GOAL_AREA: Color = (192, 225, 214)
OUTCOME_COLORS: dict[str, Color] = {
    "running": FAINT_INK,
    "goal": GOAL,
    "collision": (200, 30, 45),
    "timeout": (180, 110, 10),
}
OUTCOME_WORDS = {"running": "driving", "goal": "goal reached", "collision": "collision", "timeout": "out of time"}

DANGER_RANGES = (0.35, 1.0, 2.0, 4.0)
"""Ranges (m) between which the colour of a ray passes through DANGER_COLORS."""
DANGER_COLORS: tuple[Color, ...] = ((220, 38, 50), (243, 132, 40), (234, 188, 45), (40, 166, 98))
FAN_OPACITY = 62
"""Opacity of the area that the lidar sees, of 255."""

MARGIN_M = 0.4
"""Free border around what is shown, metres."""
OPEN_MARGIN_M = 3.0
"""The same around start, goal and path, in worlds without walls and in wide ones."""
NARROWEST = 0.6
"""Least ratio of the sides of what is shown: captions need their width."""
WIDE_M = 25.0
"""Wider worlds are not shown as a whole, metres."""
CAPTION_PX = 56
"""Height of the caption's words below the room, pixels; the legend follows."""
RAMP_PX = 80
"""Width of the colours of rays in the legend, pixels."""


@dataclass(frozen=True)
class Moment:
    """What moves: the robot at one step."""

    pose: NDArray[np.float64]
    """(3,) x, y, yaw of the robot (m, m, rad)."""
    ranges: NDArray[np.float32] | None
    """(beams,) the lidar's ranges, metres, NaN where a beam is lost; None draws no rays."""
    path: NDArray[np.float64]
    """(points, 2) where the robot's centre has been, metres, oldest first."""
    step: int
    """Control periods since the start."""
    v: float
    """Forward speed, m/s."""
    omega: float
    """Turning speed, rad/s."""
    outcome: str
    """"running", "goal", "collision" or "timeout"."""


def danger_colors(ranges: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Colours of rays: red near an obstacle, green where 4 m and more are free.

    Args:
        ranges: (n,) metres.

    Returns:
        (n, 3) uint8 RGB.
    """
    channels = [np.interp(ranges, DANGER_RANGES, [color[i] for color in DANGER_COLORS]) for i in range(3)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


class Room:
    """Draws moments of one scenario in one frame, so that the pictures of an episode fit together."""

    def __init__(
        self,
        scenario: Scenario,
        sim: SimConfig,
        *,
        title: str = "",
        size: int = 640,
        supersample: int = 2,
        path: NDArray[np.float64] | None = None,
        planned: NDArray[np.float64] | None = None,
        explained: Sequence[Item] = (),
    ) -> None:
        """Draws what does not move.

        Args:
            scenario: Start, goal and obstacles.
            sim: Robot and lidar.
            title: First line of the caption.
            size: Longer side of the room's picture, pixels, even.
            supersample: Factor of the canvas on which edges are smoothed, at least 1.
            path: (points, 2) where the robot will go, metres: it stays in the frame.
            planned: (points, 2) the path that leads it, metres, if there is one.
            explained: What the legend explains besides the room's own marks.
        """
        self.sim = sim
        self._title = title
        self._scenario = scenario
        self._supersample = supersample
        self._planned = np.zeros((0, 2)) if planned is None else planned
        x0, y0, x1, y1 = _frame(scenario, np.concatenate([np.zeros((0, 2)) if path is None else path, self._planned]))
        self._scale = size * supersample / max(x1 - x0, y1 - y0)
        self._origin = (x0, y1)
        self._grid = 1.0 if max(x1 - x0, y1 - y0) <= 40 else 10.0
        # Even sides, which video needs.
        across, down = (2 * max(1, round((side * self._scale) / supersample / 2)) for side in (x1 - x0, y1 - y0))
        self._legend = legend([*self._items(), *explained], width=across)
        self.width, self.height = across, down + CAPTION_PX + self._legend.height
        self._canvas = Image.new("RGB", (across * supersample, down * supersample), FLOOR)
        self._draw_static(x0, y0, x1, y1)

    def draw(
        self, moment: Moment, *, ghosts: NDArray[np.float64] | None = None, scan: Moment | None = None
    ) -> Image.Image:
        """The picture of a moment.

        Args:
            moment: The robot at one step.
            ghosts: (n, 3) earlier poses at which a faint robot is drawn.
            scan: Another step whose robot and rays are shown, instead of the rays of `moment`.

        Returns:
            RGB image of `width` x `height` pixels.
        """
        canvas = self._canvas.copy()
        draw = ImageDraw.Draw(canvas, "RGBA")
        seen = moment if scan is None else scan
        if seen.ranges is not None:
            self._draw_rays(draw, seen.pose, seen.ranges)
        self._draw_goal_and_start(draw)
        if len(moment.path) > 1:
            self._line(draw, moment.path, PATH, 0.045)
        for ghost in [] if ghosts is None else ghosts:
            self._draw_robot(draw, ghost, (*ROBOT, 40), (*ROBOT, 120))
        for shown in {id(seen): seen, id(moment): moment}.values():
            self._draw_robot(draw, shown.pose, (*ROBOT, 255), (255, 255, 255, 255))
        picture = Image.new("RGB", (self.width, self.height), PAPER)
        picture.paste(canvas.reduce(self._supersample), (0, 0))
        self._draw_caption(picture, moment, seen)
        return picture

    def swatch(self) -> Image.Image:
        """Every colour that a ray may take, full and faint, as a strip of the pictures' width."""
        ramp = danger_colors(np.linspace(DANGER_RANGES[0], DANGER_RANGES[-1], self.width, dtype=np.float32))
        faint = np.array(FLOOR) + (ramp - np.array(FLOOR)) * (FAN_OPACITY / 255)
        return Image.fromarray(np.repeat(np.stack([ramp, faint.astype(np.uint8)]), 40, axis=0))

    def pixel(self, x: float, y: float) -> tuple[int, int]:
        """Column and row of a point (m) in the pictures."""
        [(across, down)] = self._px([(x, y)])
        return int(across / self._supersample), int(down / self._supersample)

    @property
    def caption_height(self) -> int:
        """Height (pixels) of words and legend below the room."""
        return CAPTION_PX + self._legend.height

    def _items(self) -> list[Item]:
        near, far = DANGER_RANGES[0], DANGER_RANGES[-1]
        colors = [(r, g, b) for r, g, b in danger_colors(np.linspace(near, far, RAMP_PX, dtype=np.float32)).tolist()]
        items = [Item("start", ring(PATH)), Item("goal", ring(GOAL, GOAL_AREA)), Item("driven", line(PATH))]
        if len(self._planned) > 1:
            items.append(Item("planned", line(PLANNED)))
        items.append(Item(f"rays: {near:g} to {far:g} m", ramp(colors), RAMP_PX))
        return [*items, Item(f"grid {self._grid:g} m", line(GRID, 1.5))]

    def _px(self, points: Iterable[Sequence[float]]) -> list[tuple[float, float]]:
        x0, y1 = self._origin
        return [((x - x0) * self._scale, (y1 - y) * self._scale) for x, y in points]

    def _disc(
        self,
        draw: ImageDraw.ImageDraw,
        center: Sequence[float],
        radius: float,
        fill: tuple[int, ...] | None,
        outline: tuple[int, ...] | None = None,
        width: float = 0.0,
    ) -> None:
        [(x, y)] = self._px([center])
        r = radius * self._scale
        line = max(1, round(width * self._scale)) if outline else 0
        draw.ellipse((x - r, y - r, x + r, y + r), fill=fill, outline=outline, width=line)

    def _line(
        self, draw: ImageDraw.ImageDraw, points: NDArray[np.float64], color: tuple[int, ...], width_m: float
    ) -> None:
        width = max(self._supersample, round(width_m * self._scale))
        draw.line(self._px(points.tolist()), fill=color, width=width, joint="curve")

    def _draw_static(self, x0: float, y0: float, x1: float, y1: float) -> None:
        draw = ImageDraw.Draw(self._canvas, "RGBA")
        spacing = self._grid
        for x in np.arange(math.ceil(x0 / spacing) * spacing, x1, spacing):
            draw.line(self._px([(x, y0), (x, y1)]), fill=GRID, width=self._supersample)
        for y in np.arange(math.ceil(y0 / spacing) * spacing, y1, spacing):
            draw.line(self._px([(x0, y), (x1, y)]), fill=GRID, width=self._supersample)
        edge = max(1, round(0.02 * self._scale))
        for x, y, radius in self._scenario.circles:
            self._disc(draw, (x, y), radius, OBSTACLE, OBSTACLE_EDGE, 0.02)
        for x, y, yaw, length, width in self._scenario.boxes:
            corners = self._px(_box_corners((x, y, yaw), length, width))
            draw.polygon(corners, fill=OBSTACLE, outline=OBSTACLE_EDGE, width=edge)
        for polygon in self._scenario.polygons:
            draw.polygon(self._px(polygon), fill=OBSTACLE, outline=OBSTACLE_EDGE, width=edge)
        for xa, ya, xb, yb in self._scenario.segments:
            self._line(draw, np.array([(xa, ya), (xb, yb)]), OBSTACLE_EDGE, 0.05)
        if len(self._planned) > 1:
            self._line(draw, self._planned, PLANNED, 0.03)

    def _draw_goal_and_start(self, draw: ImageDraw.ImageDraw) -> None:
        goal, radius = self._scenario.goal, self._scenario.goal_radius
        self._disc(draw, goal, radius, (*GOAL, 60), (*GOAL, 255), 0.035)
        self._disc(draw, goal, min(0.07, radius / 3), (*GOAL, 255))
        x, y, _ = self._scenario.start
        self._disc(draw, (x, y), 0.12, (*PAPER, 255), (*PATH, 255), 0.035)

    def _draw_rays(self, draw: ImageDraw.ImageDraw, pose: NDArray[np.float64], ranges: NDArray[np.float32]) -> None:
        lidar = self.sim.lidar
        origin, heading = _lidar_pose(pose, lidar)
        width = lidar.fov / lidar.beams
        angles = heading - 0.5 * lidar.fov + (np.arange(lidar.beams) + 0.5) * width
        # Lost beams are not drawn.
        angles, ranges = angles[~np.isnan(ranges)], ranges[~np.isnan(ranges)]
        colors = danger_colors(ranges).tolist()
        ends = origin + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        [start] = self._px([(float(origin[0]), float(origin[1]))])
        tips = self._px(ends.tolist())
        half = [0.5 * width * float(r) * self._scale for r in ranges]
        for tip, angle, spread, color in zip(tips, angles, half, colors, strict=True):
            # A thin triangle per beam: together they fill the fan that the lidar sees.
            dx, dy = -math.sin(angle) * spread, -math.cos(angle) * spread
            draw.polygon([start, (tip[0] - dx, tip[1] - dy), (tip[0] + dx, tip[1] + dy)], fill=(*color, FAN_OPACITY))
        every = max(1, lidar.beams // 90)
        for tip, color in zip(tips[::every], colors[::every], strict=True):
            draw.line([start, tip], fill=(*color, 120), width=max(1, self._supersample // 2))
        dot = 1.7 * self._supersample
        for (x, y), color, distance in zip(tips, colors, ranges.tolist(), strict=True):
            if distance < lidar.range_max:
                draw.ellipse((x - dot, y - dot, x + dot, y + dot), fill=(*color, 255))

    def _draw_robot(
        self, draw: ImageDraw.ImageDraw, pose: NDArray[np.float64], fill: tuple[int, ...], mark: tuple[int, ...]
    ) -> None:
        x, y, yaw = (float(value) for value in pose)
        robot = self.sim.robot
        if robot.footprint == "disc":
            reach = robot.radius
            self._disc(draw, (x, y), reach, fill, mark, 0.025)
        else:
            reach = 0.5 * min(robot.length, robot.width)
            corners = self._px(_box_corners((x, y, yaw), robot.length, robot.width))
            draw.polygon(corners, fill=fill, outline=mark, width=max(1, round(0.025 * self._scale)))
        # An arrow head that points where the robot drives.
        arrow = [(0.72, 0.0), (-0.38, 0.5), (-0.12, 0.0), (-0.38, -0.5)]
        cos, sin = math.cos(yaw) * reach, math.sin(yaw) * reach
        draw.polygon(self._px([(x + cos * a - sin * b, y + sin * a + cos * b) for a, b in arrow]), fill=mark)

    def _draw_caption(self, picture: Image.Image, moment: Moment, seen: Moment) -> None:
        draw = ImageDraw.Draw(picture)
        large, small = _font(15), _font(12)
        top = self.height - self.caption_height
        draw.line((0, top, self.width, top), fill=GRID)
        words = OUTCOME_WORDS[moment.outcome]
        color = OUTCOME_COLORS[moment.outcome]
        draw.ellipse((14, top + 13, 24, top + 23), fill=color)
        draw.text((31, top + 18), words, font=large, fill=color if moment.outcome != "running" else INK, anchor="lm")
        x, y = moment.pose[:2]
        left = math.hypot(self._scenario.goal[0] - x, self._scenario.goal[1] - y)
        time = moment.step * self.sim.task.period
        # Adding 0 turns -0.0 into 0.
        turn = round(moment.omega, 2) + 0.0
        facts = f"{time:.1f} s   step {moment.step}   {moment.v:.2f} m/s   {turn:+.2f} rad/s   {left:.1f} m to goal"
        if seen.step != moment.step:
            facts += f"   rays as of {seen.step * self.sim.task.period:.1f} s"
        draw.text((14, top + 41), facts, font=small, fill=INK, anchor="lm")
        if draw.textlength(self._title, font=small) + draw.textlength(words, font=large) + 60 < self.width:
            draw.text((self.width - 14, top + 18), self._title, font=small, fill=FAINT_INK, anchor="rm")
        picture.paste(self._legend, (0, top + CAPTION_PX))


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _lidar_pose(pose: NDArray[np.float64], lidar: LidarConfig) -> tuple[NDArray[np.float64], float]:
    x, y, yaw = (float(value) for value in pose)
    mx, my, turn = lidar.mount
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([x + cos * mx - sin * my, y + sin * mx + cos * my]), yaw + turn


def _box_corners(pose: Sequence[float], length: float, width: float) -> list[tuple[float, float]]:
    x, y, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    halves = [(length / 2, width / 2), (-length / 2, width / 2), (-length / 2, -width / 2), (length / 2, -width / 2)]
    return [(x + cos * a - sin * b, y + sin * a + cos * b) for a, b in halves]


def _frame(scenario: Scenario, path: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Rectangle x0, y0, x1, y1 (m) that holds start, goal and path, and all obstacles unless the world is wide."""
    corners = [(x + dx, y + dy) for x, y, r in scenario.circles for dx, dy in ((-r, -r), (r, r))]
    for x, y, yaw, length, width in scenario.boxes:
        corners += _box_corners((x, y, yaw), length, width)
    corners += [point for polygon in scenario.polygons for point in polygon]
    corners += [point for xa, ya, xb, yb in scenario.segments for point in ((xa, ya), (xb, yb))]
    places = np.array([scenario.start[:2], scenario.goal, *path.tolist()])
    around = np.array([places.min(axis=0) - OPEN_MARGIN_M, places.max(axis=0) + OPEN_MARGIN_M])
    frame = around
    if corners:
        points = np.concatenate([np.array(corners), places])
        frame = np.array([points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M])
        if np.ptp(frame, axis=0).max() > WIDE_M:
            # Of a wide world only the part that the robot may see.
            frame = np.array([np.maximum(frame[0], around[0]), np.minimum(frame[1], around[1])])
    sides = frame[1] - frame[0]
    missing = np.maximum(NARROWEST * sides.max() - sides, 0)
    (x0, y0), (x1, y1) = (frame + np.array([-0.5, 0.5])[:, None] * missing).tolist()
    return x0, y0, x1, y1
