"""The simulators that `peers.py` times, and the rooms that all of them drive in.

Room, draw_rooms();  Navrl, navrl_ranges();  IrSim, MuJoCo: Peers
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from navrl.batch import BatchSim, Scenario, draw_list
from navrl.config import LidarConfig, SimConfig, WorldConfig

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

ROOMS, POSES, STEPS = 8, 32, 10
"""Rooms, robots in each, and steps between two times at which a peer's robots are put back."""
ROBOTS = ROOMS * POSES
AREA_M = 5.0
"""Poses are drawn in the square of twice this side."""
FREE_M, TOUCHING_M = 0.3, 0.24
"""Distance to the nearest obstacle, at least and at most, of poses without and with contact for a disc of 0.25 m."""
CONFIG = SimConfig(world=WorldConfig(name="open8"), lidar=LidarConfig(beams=180, noise=0.0))
ANGLES = (np.arange(CONFIG.lidar.beams) + 0.5) * CONFIG.lidar.fov / CONFIG.lidar.beams - CONFIG.lidar.fov / 2
"""Directions of the beams in the robot's frame (rad)."""


class Room(NamedTuple):
    """A room and poses (x, y, yaw) in it."""

    scenario: Scenario
    free: Floats
    """(POSES, 3): nothing is nearer than FREE_M."""
    touching: Floats
    """(POSES, 3): something is nearer than TOUCHING_M."""


class Scans(NamedTuple):
    """What a simulator reports in given poses of one room."""

    ranges: Floats
    """(poses, beams), metres."""
    contacts: NDArray[np.bool_] | None
    """(poses,), or None if it does not look for contacts."""


class Contender(Protocol):
    """A simulator to time."""

    def rewind(self) -> None:
        """Puts the robots back to the free poses."""

    def drive(self) -> int:
        """Makes steps with random actions and returns their number, counted over all robots."""


class Peer(Contender, Protocol):
    """A simulator to compare with."""

    def scans(self, room: int, poses: Floats) -> Scans:
        """Reports of robots put at `poses` (at most POSES of them), by the calls that `drive` makes."""


def obstacle_boxes(scenario: Scenario) -> Floats:
    """Boxes, then walls as boxes of width 0: (obstacles, 5), x, y, yaw, length and width."""
    x1, y1, x2, y2 = np.array(scenario.segments).T
    walls = np.stack([(x1 + x2) / 2, (y1 + y2) / 2, np.arctan2(y2 - y1, x2 - x1), np.hypot(x2 - x1, y2 - y1), 0 * x1])
    return np.concatenate([np.array(scenario.boxes), walls.T])


def clearance(scenario: Scenario, points: Floats) -> Floats:
    """Distance (m) of each of `points (n, 2)` to the nearest obstacle; 0 within a box."""
    x, y, yaw, length, width = obstacle_boxes(scenario).T[:, :, None]
    dx, dy = points[:, 0] - x, points[:, 1] - y
    along = np.abs(np.cos(yaw) * dx + np.sin(yaw) * dy) - length / 2
    across = np.abs(np.cos(yaw) * dy - np.sin(yaw) * dx) - width / 2
    nearest: Floats = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)).min(axis=0)
    return nearest


def draw_rooms() -> list[Room]:
    """The first test rooms of "open8", with poses all over them."""
    generator = np.random.default_rng(0)
    rooms = []
    for scenario in draw_list(CONFIG, "test", ROOMS):
        poses = generator.uniform([-AREA_M, -AREA_M, -np.pi], [AREA_M, AREA_M, np.pi], (100 * POSES, 3))
        nearest = clearance(scenario, poses[:, :2])
        rooms.append(Room(scenario, poses[nearest > FREE_M][:POSES], poses[nearest < TOUCHING_M][:POSES]))
    return rooms


def random_commands(shape: tuple[int, ...]) -> Floats:
    """Uniform speeds (m/s, rad/s) over the robot's limits: (*shape, 2)."""
    high = [CONFIG.robot.v_max, CONFIG.robot.omega_max]
    return np.random.default_rng(0).uniform([0.0, -high[1]], high, (*shape, 2))


class Navrl:
    """This package, as `navrl bench` drives it."""

    def __init__(self, num_envs: int) -> None:
        self.sim = BatchSim(CONFIG, num_envs=num_envs, num_threads=1)
        calls = max(1, 4096 // num_envs)
        self.actions = np.random.default_rng(0).uniform(-1.0, 1.0, (calls, num_envs, 2)).astype(np.float32)

    def rewind(self) -> None:
        """Nothing: an episode that ends begins anew within the step."""

    def drive(self) -> int:
        """About 4,096 steps."""
        for actions in self.actions:
            self.sim.step(actions)
        return len(self.actions) * self.sim.num_envs


def navrl_ranges(room: Room) -> Floats:
    """What navrl measures in the free poses of a room: (POSES, beams), metres."""
    keys = json.loads(room.scenario.to_json())
    lines = [json.dumps(keys | {"start": pose}) for pose in room.free.tolist()]
    sim = BatchSim(CONFIG, num_envs=len(lines), scenarios=[Scenario.from_json(line) for line in lines])
    return sim.ranges.astype(np.float64)


class IrSim:
    """IR-SIM without display, one environment a room."""

    def __init__(self, rooms: Sequence[Room]) -> None:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints which displays are missing
            import irsim

        self.rooms, self.commands = rooms, random_commands((STEPS,))
        self.environments = []
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "room.yaml"
            for room in rooms:
                file.write_text(json.dumps(irsim_world(room.scenario)), encoding="utf-8")  # JSON is YAML
                self.environments.append(irsim.make(str(file), headless=True, log_level="CRITICAL"))
        self.room, self.turn = 0, 0

    def scans(self, room: int, poses: Floats) -> Scans:
        """One after the other."""
        environment = self.environments[room]
        ranges, contacts = np.empty((len(poses), len(ANGLES))), np.empty(len(poses), bool)
        for k, pose in enumerate(poses):
            environment.robot.set_state(pose)
            environment.step(np.zeros(2))
            ranges[k], contacts[k] = environment.get_lidar_scan()["ranges"], environment.robot.collision
        return Scans(ranges, contacts)

    def rewind(self) -> None:
        """On to the next room; a step without motion lets it forget the contact."""
        self.turn += 1
        self.room = self.turn % len(self.rooms)
        free = self.rooms[self.room].free
        self.scans(self.room, free[[self.turn // len(self.rooms) % len(free)]])

    def drive(self) -> int:
        """One robot in one room."""
        environment = self.environments[self.room]
        for command in self.commands:
            environment.step(command)
        return len(self.commands)


def irsim_world(scenario: Scenario) -> dict[str, object]:
    """A room as IR-SIM's configuration; its beams include both ends of the angle."""
    lidar, robot = CONFIG.lidar, CONFIG.robot
    sensor = {"name": "lidar2d", "range_min": 0, "range_max": lidar.range_max, "number": lidar.beams, "noise": False}
    boxes = [
        {"shape": {"name": "rectangle", "length": length, "width": width}, "state": [x, y, yaw]}
        for x, y, yaw, length, width in scenario.boxes
    ]
    walls = [
        {"shape": {"name": "linestring", "vertices": [[x1, y1], [x2, y2]]}, "state": [0, 0, 0]}
        for x1, y1, x2, y2 in scenario.segments
    ]
    return {
        "world": {"width": 12, "height": 12, "offset": [-6, -6], "step_time": CONFIG.task.period},
        "robot": {
            "kinematics": {"name": "diff"},
            "shape": {"name": "circle", "radius": robot.radius},
            "state": list(scenario.start),
            "vel_min": [0, -robot.omega_max],
            "vel_max": [robot.v_max, robot.omega_max],
            "sensors": [sensor | {"angle_range": float(ANGLES[-1] - ANGLES[0])}],
        },
        "obstacle": boxes + walls,
    }


class MuJoCo:
    """MuJoCo's own rollout of POSES robots in each room, in the calling thread."""

    def __init__(self, rooms: Sequence[Room], *, contacts: bool) -> None:
        import mujoco
        from mujoco.rollout import Rollout

        self.contacts, self.rollout = contacts, Rollout(nthread=0)
        self.models = [mujoco.MjModel.from_xml_string(mujoco_model(room.scenario, contacts=contacts)) for room in rooms]
        model = self.models[0]
        self.scratch = mujoco.MjData(model)
        width = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self.start = np.zeros((ROBOTS, width))
        self.start[:, 1:4] = np.concatenate([room.free for room in rooms])  # after the time
        self.robot_models = [model for model in self.models for _ in range(POSES)]
        self.commands = np.insert(random_commands((ROBOTS, STEPS)), 1, 0.0, axis=2)  # forwards, sideways, turning
        self.state, self.sensors = np.empty((ROBOTS, STEPS, width)), np.empty((ROBOTS, STEPS, model.nsensordata))

    def scans(self, room: int, poses: Floats) -> Scans:
        """A step reports what its sensors met before the motion."""
        start = np.zeros((len(poses), self.start.shape[1]))
        start[:, 1:4] = poses
        models = [self.models[room]] * len(poses)
        sensors = self.rollout.rollout(models, self.scratch, start, self.commands[: len(poses), :1])[1][:, 0]
        return Scans(sensors[:, : len(ANGLES)], sensors[:, len(ANGLES)] > 0 if self.contacts else None)

    def rewind(self) -> None:
        """Nothing: every rollout begins in the given states."""

    def drive(self) -> int:
        """All robots, all rooms, one call."""
        self.rollout.rollout(
            self.robot_models, self.scratch, self.start, self.commands, state=self.state, sensordata=self.sensors
        )
        return ROBOTS * STEPS


def mujoco_model(scenario: Scenario, *, contacts: bool) -> str:
    """A room as MJCF: outer walls are planes, which cost it least, inner ones boxes 2 um thick."""
    bodies = []
    for x, y, yaw, length, width in obstacle_boxes(scenario):
        if length == 2 * AREA_M and width == 0.0:
            # The corners run counter-clockwise, so that the inside lies to the left; z of the plane is x times y.
            axes = f"0 0 1 {np.cos(yaw)} {np.sin(yaw)} 0"
            bodies.append(f'<geom type="plane" size="1 {length / 2} 1" pos="{x} {y} 0" xyaxes="{axes}"/>')
        else:
            half = f"{length / 2} {max(width / 2, 1e-6)} 1"
            bodies.append(f'<geom type="box" size="{half}" pos="{x} {y} 0" euler="0 0 {yaw}"/>')
    beams = [f'<site name="beam{i}" zaxis="{np.cos(a)} {np.sin(a)} 0"/>' for i, a in enumerate(ANGLES)]
    sensors = [f'<rangefinder site="beam{i}" cutoff="{CONFIG.lidar.range_max}"/>' for i in range(len(ANGLES))]
    if contacts:
        sensors.append('<contact geom1="disc" num="1" data="found"/>')
    disabled = 'gravity="disable"' + ("" if contacts else ' contact="disable" constraint="disable"')
    return f"""<mujoco>
      <compiler angle="radian"/>
      <option timestep="{CONFIG.task.period}" integrator="implicitfast"><flag {disabled}/></option>
      <worldbody>
        {"".join(bodies)}
        <body>
          <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
          <joint name="yaw" type="hinge" axis="0 0 1"/>
          <geom name="disc" type="cylinder" size="{CONFIG.robot.radius} 0.1" mass="1" condim="1"/>
          <site name="centre"/>{"".join(beams)}
        </body>
      </worldbody>
      <sensor>{"".join(sensors)}</sensor>
      <actuator>
        <velocity site="centre" gear="1 0 0 0 0 0" kv="1000"/>
        <velocity site="centre" gear="0 1 0 0 0 0" kv="1000"/>
        <velocity joint="yaw" kv="1000"/>
      </actuator>
    </mujoco>"""
