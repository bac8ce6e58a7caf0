"""Pictures: what stands where, in which colour."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl.config import LidarConfig, RobotConfig, SimConfig
from navrl.drawing.render import (
    DANGER_COLORS,
    FLOOR,
    GOAL,
    OBSTACLE,
    OBSTACLE_EDGE,
    OUTCOME_COLORS,
    PATH,
    ROBOT,
    Moment,
    Room,
    danger_colors,
)


def scenario(**shapes: Any) -> Any:  # noqa: ANN401 - stands for a Scenario, of which drawing reads the fields only
    fields = {"circles": [], "boxes": [], "segments": [], "polygons": []} | shapes
    return SimpleNamespace(start=(-3.0, -3.0, 0.0), goal=(3.2, 2.7), goal_radius=0.3, **fields)


WALLS = [(0, 4.05, 8.2, 0.1), (0, -4.05, 8.2, 0.1), (4.05, 0, 0.1, 8.2), (-4.05, 0, 0.1, 8.2)]
ROOM = scenario(
    boxes=[(x, y, 0.0, length, width) for x, y, length, width in WALLS] + [(0.0, 2.5, math.pi / 4, 1.0, 1.0)],
    circles=[(-2.6, 1.6, 0.5)],
    polygons=[[(1.0, -1.0), (2.0, -1.0), (1.5, -2.0)]],
    segments=[(-1.0, -3.5, 1.0, -3.5)],
)


def moment(x: float = 0.5, y: float = 0.5, yaw: float = 0.0, *, ranges: float | None = None, **changes: Any) -> Moment:  # noqa: ANN401
    values: dict[str, Any] = {
        "pose": np.array([x, y, yaw]),
        "ranges": None if ranges is None else np.full(180, ranges, np.float32),
        "path": np.array([[-3.0, -3.0], [x, y]]),
        "step": 42,
        "v": 0.3,
        "omega": -0.2,
        "outcome": "running",
    }
    return Moment(**(values | changes))


def pixels(room: Room, when: Moment) -> NDArray[np.int64]:
    return np.asarray(room.draw(when)).astype(np.int64)


def color_at(room: Room, picture: NDArray[np.int64], x: float, y: float) -> NDArray[np.int64]:
    column, row = room.pixel(x, y)
    return picture[row, column]


def near(color: NDArray[np.int64], expected: tuple[int, ...], tolerance: int = 12) -> bool:
    return bool(np.abs(color - np.array(expected)).max() <= tolerance)


def test_every_kind_of_obstacle_stands_in_its_place() -> None:
    room = Room(ROOM, SimConfig(), size=640)
    picture = pixels(room, moment())
    for x, y in [(0.0, 2.5), (0.0, 3.1), (-2.6, 1.6), (-2.6, 2.0), (1.5, -1.3), (0.0, 4.05), (-4.05, 0.0)]:
        assert near(color_at(room, picture, x, y), OBSTACLE), (x, y)
    assert near(color_at(room, picture, 0.0, -3.5), OBSTACLE_EDGE)
    # Beside the corners of the turned box, the disc, and below the triangle.
    for x, y in [(0.52, 2.98), (-2.13, 2.07), (1.12, -1.8)]:
        assert near(color_at(room, picture, x, y), FLOOR), (x, y)


def test_x_points_right_and_y_points_up() -> None:
    room = Room(ROOM, SimConfig(), size=640)
    picture = pixels(room, moment())[: -room.caption_height]
    greens = np.argwhere(np.abs(picture - np.array(GOAL)).max(axis=2) < 12)
    rows, columns = greens[:, 0], greens[:, 1]
    assert rows.max() < 320 < columns.min(), "the goal at (3.2, 2.7) is drawn at the upper right"
    assert np.abs([columns.mean(), rows.mean()] - np.array(room.pixel(3.2, 2.7))).max() < 2


def test_the_size_of_the_goal_is_that_of_its_circle() -> None:
    room = Room(ROOM, SimConfig(), size=640)
    picture = pixels(room, moment())
    across = picture[room.pixel(3.2, 2.7)[1]]
    greens = np.flatnonzero(np.abs(across - np.array(GOAL)).max(axis=1) < 40)
    width_m = (np.ptp(greens) + 1) / (room.pixel(1.0, 0.0)[0] - room.pixel(0.0, 0.0)[0])
    assert width_m == pytest.approx(0.6, abs=0.03)


@pytest.mark.parametrize(("ranges", "color"), [*zip((0.35, 1.0, 2.0), DANGER_COLORS, strict=False)])
def test_rays_end_at_their_range_in_the_colour_of_their_danger(ranges: float, color: tuple[int, ...]) -> None:
    room = Room(ROOM, SimConfig(), size=640)
    calm, picture = (pixels(room, moment(ranges=distance)) for distance in (None, ranges))
    changed = np.argwhere(np.abs(picture - calm).max(axis=2) > 6)
    column, row = room.pixel(0.5, 0.5)
    scale = room.pixel(1.5, 0.5)[0] - column
    reach = np.hypot(changed[:, 0] - row, changed[:, 1] - column).max() / scale
    assert reach == pytest.approx(ranges, abs=0.06)
    assert near(color_at(room, picture, 0.5 + ranges, 0.5), color, 30)


def test_the_lidar_looks_where_the_robot_and_its_mount_point() -> None:
    lidar = LidarConfig(fov=math.pi / 2, mount=(0.0, 0.0, math.pi / 2))
    room = Room(ROOM, SimConfig(lidar=lidar), size=640)
    calm, picture = (pixels(room, moment(ranges=ranges)) for ranges in (None, 1.5))
    changed = np.abs(picture - calm).max(axis=2) > 6
    for dx, dy, seen in ((0.0, 1.2, True), (0.0, -1.2, False), (1.2, 0.0, False), (-1.2, 0.0, False)):
        column, row = room.pixel(0.5 + dx, 0.5 + dy)
        assert changed[row, column] == seen, (dx, dy)


def test_a_beam_that_meets_nothing_has_no_dot() -> None:
    room = Room(scenario(), SimConfig(lidar=LidarConfig(range_max=2.0)), size=640)
    full = np.array(DANGER_COLORS[2])

    def dots(ranges: float) -> int:
        picture = pixels(room, moment(-3.0, -3.0, ranges=ranges, path=np.zeros((1, 2))))
        return int((np.abs(picture[: -room.caption_height] - full).max(axis=2) < 40).sum())

    assert dots(2.0) == 0
    assert dots(1.999) > 100


def test_danger_colours_at_their_ranges() -> None:
    colors = danger_colors(np.array([0.0, 0.35, 1.0, 2.0, 4.0, 10.0], np.float32))
    expected = [DANGER_COLORS[0], *DANGER_COLORS, DANGER_COLORS[-1]]
    assert colors.tolist() == [list(color) for color in expected]
    # Red fades and green grows steadily in between.
    ramp = danger_colors(np.linspace(0.35, 4.0, 50, dtype=np.float32)).astype(int)
    assert ramp[0, 0] - ramp[0, 1] > 100
    assert ramp[-1, 1] - ramp[-1, 0] > 100
    assert np.all(np.diff(ramp[:, 1] - ramp[:, 0]) >= 0)


@pytest.mark.parametrize(
    ("robot", "inside", "outside"),
    [
        (RobotConfig(radius=0.25), [(0.0, 0.2), (-0.2, 0.0)], [(0.0, 0.29), (0.22, 0.22)]),
        (
            RobotConfig(footprint="rectangle", length=1.0, width=0.4),
            [(0.42, 0.12), (-0.42, -0.12)],
            [(0.0, 0.26), (0.56, 0.0)],
        ),
    ],
)
def test_the_robot_has_its_footprint(
    robot: RobotConfig, inside: list[tuple[float, float]], outside: list[tuple[float, float]]
) -> None:
    room = Room(ROOM, SimConfig(robot=robot), size=900)
    yaw = 0.6
    picture = pixels(room, moment(0.5, 0.5, yaw, path=np.zeros((1, 2))))

    def place(x: float, y: float) -> tuple[float, float]:
        return 0.5 + math.cos(yaw) * x - math.sin(yaw) * y, 0.5 + math.sin(yaw) * x + math.cos(yaw) * y

    for point in inside:
        assert near(color_at(room, picture, *place(*point)), ROBOT), point
    for point in outside:
        assert not near(color_at(room, picture, *place(*point)), ROBOT, 60), point


def test_the_arrow_points_ahead() -> None:
    room = Room(ROOM, SimConfig(), size=900)
    white = (255, 255, 255)
    for yaw in (0.0, math.pi / 2, 2.5):
        picture = pixels(room, moment(0.5, 0.5, yaw, path=np.zeros((1, 2))))
        dx, dy = 0.14 * math.cos(yaw), 0.14 * math.sin(yaw)
        assert near(color_at(room, picture, 0.5 + dx, 0.5 + dy), white)
        assert near(color_at(room, picture, 0.5 - dx, 0.5 - dy), ROBOT)


def test_the_path_is_drawn_where_the_robot_went() -> None:
    room = Room(ROOM, SimConfig(), size=640)
    path = np.array([[-3.0, -3.0], [-3.0, 0.0], [0.5, 0.0]])
    picture = pixels(room, moment(0.5, 0.0, path=path))
    for x, y in [(-3.0, -1.5), (-1.5, 0.0)]:
        assert near(color_at(room, picture, x, y), PATH), (x, y)
    assert near(color_at(room, picture, -1.25, -1.5), FLOOR)


@pytest.mark.parametrize("outcome", ["running", "goal", "collision", "timeout"])
def test_the_caption_tells_the_outcome_by_colour(outcome: str) -> None:
    room = Room(ROOM, SimConfig(), size=640)
    caption = pixels(room, moment(outcome=outcome))[-room.caption_height :]
    for name, color in OUTCOME_COLORS.items():
        found = int((np.abs(caption[:, :30] - np.array(color)).max(axis=2) < 4).sum())
        assert (found > 30) == (name == outcome), (name, found)


def test_the_caption_changes_with_step_and_speed() -> None:
    room = Room(ROOM, SimConfig(), size=640)
    first = pixels(room, moment())[-room.caption_height :]
    for other in (moment(step=43), moment(v=0.4), moment(omega=0.2)):
        assert (pixels(room, other)[-room.caption_height :] != first).any()


def test_pictures_of_an_episode_fit_together_and_have_even_sides() -> None:
    for size in (320, 641):
        room = Room(ROOM, SimConfig(), size=size)
        one, other = room.draw(moment()), room.draw(moment(-1.0, -1.0))
        assert one.size == other.size == (room.width, room.height)
        assert room.width % 2 == room.height % 2 == 0
        assert abs(room.width - size) <= 1


def test_an_open_world_shows_start_goal_and_path() -> None:
    path = np.array([[-3.0, -3.0], [0.0, -6.0], [3.0, 2.5]])
    room = Room(scenario(), SimConfig(), size=400, path=path)
    for x, y in [(-3.0, -3.0), (3.2, 2.7), (0.0, -6.0)]:
        column, row = room.pixel(x, y)
        assert 10 < column < room.width - 10
        assert 10 < row < room.height - room.caption_height - 10


def test_of_a_wide_world_the_robots_surroundings_are_shown() -> None:
    walls = [
        (-50.0, -50.0, 50.0, -50.0),
        (50.0, -50.0, 50.0, 50.0),
        (50.0, 50.0, -50.0, 50.0),
        (-50.0, 50.0, -50.0, -50.0),
    ]
    room = Room(scenario(segments=walls), SimConfig(), size=400, path=np.array([[-3.0, -3.0], [3.0, 2.5]]))
    left, right = room.pixel(-3.0, 0.0)[0], room.pixel(3.2, 0.0)[0]
    assert 0.4 < (right - left) / room.width < 0.6
    # A wall that is near is still the edge of what is shown.
    room = Room(scenario(segments=[(-4.0, -50.0, -4.0, 50.0)]), SimConfig(), size=400)
    assert room.pixel(-4.0, 0.0)[0] < 0.06 * room.width


def test_pictures_are_wide_enough_for_their_caption() -> None:
    for x, y in ((0.0, 40.0), (40.0, 0.0)):
        room = Room(scenario(), SimConfig(), size=560, path=np.array([[0.0, 0.0], [x, y]]))
        sides = (room.width, room.height - room.caption_height)
        assert max(sides) == 560
        assert min(sides) >= 0.59 * 560


def test_ghosts_are_faint_robots() -> None:
    room = Room(ROOM, SimConfig(), size=640)
    picture = np.asarray(room.draw(moment(), ghosts=np.array([[-1.0, -1.0, 0.0]]))).astype(np.int64)
    ghost = color_at(room, picture, -1.0, -0.85)
    assert not near(ghost, FLOOR, 10)
    assert not near(ghost, ROBOT, 60)
