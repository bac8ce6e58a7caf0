"""A filter that brakes before what the scan shows, whoever drives: the turn stays, the speed falls as far as it must.

    commands = brake(commands, ranges, velocities, sim, margin=0.02)     (N, 2), (N, beams), (N, 2) -> (N, 2)
    evaluate(policy, "test", brake=0.02)

A round robot that turns in place touches nothing, so that speed alone has to fall. The filter knows what a scan knows:
what stands outside the lidar's field of view or moves by itself it does not see.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navrl.config import SimConfig

SHARES = (1.0, 0.75, 0.5, 0.25)
"""Of the commanded speed, tried one after the other before 0."""
PLACES = 4
"""Where contact is looked for, evenly on the way until the robot stands: some centimetres apart."""


def check(sim: SimConfig, margin: float) -> None:
    """Refuses a robot or margin that the filter is not for.

    Raises:
        ValueError: The robot is not round, or the margin is not in [0, 1] m.
    """
    if sim.robot.footprint != "disc":
        raise ValueError("brake: needs robot.footprint = disc, for other robots may touch something as they turn")
    if not 0.0 <= margin <= 1.0:
        raise ValueError(f"brake: {margin}: expected a margin in [0, 1] m")


def brake(
    commands: NDArray[np.floating],
    ranges: NDArray[np.float32],
    velocities: NDArray[np.floating],
    sim: SimConfig,
    margin: float,
) -> NDArray[np.float64]:
    """Takes speed off commands after which a robot could not stop in time.

    Args:
        commands: (N, 2) v (m/s) and omega (rad/s).
        ranges: (N, beams) metres; `lidar.range_max` or more where a beam meets nothing, NaN where it is lost.
        velocities: (N, 2) v (m/s) and omega (rad/s) of the last period.
        sim: Robot, lidar and period.
        margin: What has to stay free beside the robot (m).

    Returns:
        (N, 2) commands of the same omega and at most the same v.

    Raises:
        ValueError: See `check`.
    """
    check(sim, margin)
    braked = np.array(commands, np.float64)
    points = _points(np.asarray(ranges, np.float64), sim)
    before = np.asarray(velocities, np.float64)[:, 0]
    danger = np.arange(len(braked))
    for share in SHARES:
        v, omega = braked[danger].T
        near = _comes_near(share * v, omega, before[danger], points[danger], sim, margin)
        braked[danger[~near], 0] *= share
        danger = danger[near]
    braked[danger, 0] = 0.0
    return braked


def _points(ranges: NDArray[np.float64], sim: SimConfig) -> NDArray[np.complex128]:
    """(N, beams) what the beams met, x + i y (m) in the robot's frame; infinitely far where there was nothing."""
    lidar, (x, y, yaw) = sim.lidar, sim.lidar.mount
    angles = yaw + lidar.fov * ((np.arange(lidar.beams) + 0.5) / lidar.beams - 0.5)
    seen = np.where(ranges < lidar.range_max, ranges, 1e9)
    points: NDArray[np.complex128] = x + 1j * y + seen * np.exp(1j * angles)
    return points


def _comes_near(
    v: NDArray[np.float64],
    omega: NDArray[np.float64],
    before: NDArray[np.float64],
    points: NDArray[np.complex128],
    sim: SimConfig,
    margin: float,
) -> NDArray[np.bool_]:
    """Whether a robot that gets v for a period and then brakes comes too near to a point, and nearer than it is."""
    robot, period = sim.robot, sim.task.period
    change = robot.acceleration_max or np.inf
    waiting = robot.delay_steps * period
    # Until the command acts the robot may go as fast as those before it allow; they are not known here.
    before = np.minimum(before + change * waiting, robot.v_max) if waiting else before
    reached = np.clip(v, before - change * period, before + change * period)
    # Then a period with the command, and ever slower.
    stopping = reached / change
    length = before * waiting + reached * (period + stopping / 2)
    turn = omega * (waiting + period + stopping)
    now = np.abs(points).min(axis=1)
    nearest = np.full(len(v), np.inf)
    for part in np.arange(1, PLACES + 1) / PLACES:
        # A chord of the arc: its length is the arc's times sin(h) / h, for half the angle h
        half = part * turn / 2
        place = part * length * np.sinc(half / np.pi) * np.exp(1j * half)
        nearest = np.minimum(nearest, np.abs(points - place[:, None]).min(axis=1))
    near: NDArray[np.bool_] = (nearest < robot.radius + margin) & (nearest < now)
    return near
