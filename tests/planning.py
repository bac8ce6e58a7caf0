"""Worlds to plan in, and a check of paths of another kind than the planners'."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl.batch import Scenario, draw_list
from navrl.config import RobotConfig, SimConfig, WorldConfig
from navrl.planners import Plan

Points = NDArray[np.float64]
RADIUS = RobotConfig().radius


def corners(scenario: Scenario) -> list[Points]:
    """Corners of every box and polygon, in order."""
    turned = []
    for x, y, yaw, length, width in scenario.boxes:
        c, s = math.cos(yaw), math.sin(yaw)
        signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        halves = [(i * length / 2, j * width / 2) for i, j in signs]
        turned.append(np.array([(x + c * u - s * v, y + s * u + c * v) for u, v in halves]))
    return turned + [np.array(polygon) for polygon in scenario.polygons]


def edges(scenario: Scenario) -> tuple[Points, Points, Points]:
    """Both ends of every edge (E, 2), a circle being one without length, and the distance (E,) that it adds."""
    rows = [(*wall, 0.0) for wall in scenario.segments] + [(x, y, x, y, r) for x, y, r in scenario.circles]
    for solid in corners(scenario):
        ends = np.hstack([solid, np.roll(solid, -1, axis=0)])
        rows += [(*row, 0.0) for row in ends.tolist()]
    table = np.array(rows).reshape(-1, 5)
    return table[:, :2], table[:, 2:4], table[:, 4]


def to_segments(points: Points, a: Points, b: Points) -> Points:
    """Distances (P, S) of points from segments."""
    along, offset = b - a, points[:, None] - a
    square = np.maximum((along**2).sum(-1), 1e-300)
    share = np.clip((offset * along).sum(-1) / square, 0, 1)
    return np.linalg.norm(offset - share[..., None] * along, axis=-1)


def turn(a: Points, b: Points, c: Points) -> Points:
    """z of (b - a) x (c - a)."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def path_clearance(scenario: Scenario, path: Points) -> float:
    """Distance from a path to the nearest shape; 0 if it touches or enters one."""
    a, b, grown = edges(scenario)
    if not len(a):
        return math.inf
    p, q = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
    nearest = np.minimum(to_segments(p, a, b), to_segments(q, a, b))
    nearest = np.minimum(nearest, np.minimum(to_segments(a, p, q), to_segments(b, p, q)).T)
    p, q = p[:, None], q[:, None]
    crossing = (turn(p, q, a) * turn(p, q, b) < 0) & (turn(a, b, p) * turn(a, b, q) < 0)
    for solid in corners(scenario):
        sides = turn(solid, np.roll(solid, -1, axis=0), path[:, None])
        if ((sides > 0).all(axis=1) | (sides < 0).all(axis=1)).any():
            return 0.0
    return float(np.where(crossing, 0.0, nearest - grown).min())


def check(scenario: Scenario, route: Plan) -> None:
    """What makes a path one."""
    path = route.path
    assert path.shape[1] == 2
    assert path.dtype == np.float64
    assert path[0].tolist() == list(scenario.start[:2])
    assert math.dist(path[-1], scenario.goal) < scenario.goal_radius
    assert path_clearance(scenario, path) >= route.clearance
    assert route.length == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).sum(), rel=1e-12)


def room(half: float = 3.0) -> list[list[float]]:
    """Four walls."""
    h = half
    return [[-h, -h, h, -h], [h, -h, h, h], [h, h, -h, h], [-h, h, -h, -h]]


def scenario(**changes: Any) -> Scenario:  # noqa: ANN401 - the keys of a scenario
    """A box between start and goal in a room."""
    values = {
        "start": (-2.5, 0.1, 0.0),
        "goal": (2.5, 0.0),
        "goal_radius": 0.3,
        "time_limit": 50.0,
        "segments": room(),
        "boxes": [(0.0, 0.0, 0.4, 1.5, 1.0)],
    }
    return Scenario(**(values | changes))


def user_worlds(count: int) -> list[Scenario]:
    """Circles, boxes, walls and triangles at random, some of them overlapping, some around the start or the goal."""
    random = np.random.Generator(np.random.Philox(5))
    worlds = []
    for _ in range(count):
        centers = random.uniform(-2.8, 2.8, (12, 2))
        angles = random.uniform(-math.pi, math.pi, 12)
        circles = [(x, y, random.uniform(0.05, 0.5)) for x, y in centers[:4]]
        boxes = [(x, y, yaw, *random.uniform(0.2, 1.0, 2)) for (x, y), yaw in zip(centers[4:7], angles, strict=False)]
        walls = [(x, y, x + math.cos(t), y + math.sin(t)) for (x, y), t in zip(centers[7:9], angles, strict=False)]
        triangles = [
            [(x + 0.5 * math.cos(t + k), y + 0.5 * math.sin(t + k)) for k in (0.0, 2.0, 4.0)]
            for (x, y), t in zip(centers[9:], angles, strict=False)
        ]
        start, goal = random.uniform(-2.7, 2.7, (2, 2))
        shapes = {"circles": circles, "boxes": boxes, "segments": [*room(), *walls], "polygons": triangles}
        worlds.append(scenario(start=(*start, 0.0), goal=tuple(goal), **shapes))
    return worlds


WORLDS = {
    "td3": lambda: draw_list(SimConfig(), "tuning", 150),
    "boxes": lambda: draw_list(SimConfig(world=WorldConfig(name="boxes", boxes=16)), "tuning", 150),
    "own": lambda: user_worlds(150),
}
