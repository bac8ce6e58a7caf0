"""The brake: it never speeds up or turns, lets pass what is free, and stops in time at any delay and deceleration."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl.batch import Scenario
from navrl.braking import brake
from navrl.config import LidarConfig, RobotConfig, SimConfig
from navrl.controllers import Controller
from navrl.evaluate import evaluate
from navrl.policy import load_policy
from navrl.scenarios import load_list

SIM = SimConfig()
BEAMS = SIM.lidar.beams
MARGIN = 0.02


class Reckless:
    """Full speed ahead, whatever it sees."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.tile(np.array([1.0, 0.0], np.float32), (len(observations), 1))


def wall_ahead(distance: float) -> NDArray[np.float32]:
    """(1, beams) ranges of a wall across, so far in front of the robot's centre."""
    angles = np.pi * ((np.arange(BEAMS) + 0.5) / BEAMS - 0.5)
    return np.minimum(distance / np.cos(angles), SIM.lidar.range_max)[None].astype(np.float32)


def braked(distance: float, v: float = 0.5, omega: float = 0.0, sim: SimConfig = SIM) -> tuple[float, float]:
    commands = brake(np.array([[v, omega]]), wall_ahead(distance), np.array([[v, omega]]), sim, MARGIN)
    return float(commands[0, 0]), float(commands[0, 1])


def test_speed_falls_with_the_way_that_is_left() -> None:
    # Radius 0.25 m and margin 0.02 m; 0.05 m in a period at full speed.
    assert braked(0.33) == (0.5, 0.0)
    assert braked(0.31) == (0.375, 0.0)
    assert braked(0.275, omega=0.7) == (0.0, 0.7)
    # What is nearer than the margin may be left behind.
    backwards = np.full((1, BEAMS), SIM.lidar.range_max, np.float32)
    backwards[0, 0] = 0.26
    left = brake(np.array([[0.5, 1.0]]), backwards, np.zeros((1, 2)), SIM, MARGIN)
    assert left.tolist() == [[0.5, 1.0]]


def test_lost_beams_and_free_ones_are_no_obstacles() -> None:
    for nothing in (np.nan, SIM.lidar.range_max, np.inf):
        ranges = np.full((1, BEAMS), nothing, np.float32)
        assert brake(np.array([[0.5, 0.3]]), ranges, np.zeros((1, 2)), SIM, MARGIN).tolist() == [[0.5, 0.3]]


def test_the_lidars_pose_counts() -> None:
    ahead = replace(SIM, lidar=LidarConfig(mount=(0.2, 0.0, 0.0)))
    behind = replace(SIM, lidar=LidarConfig(mount=(0.0, 0.0, np.pi)))
    assert braked(0.2, sim=ahead)[0] == 0.5
    assert braked(0.2)[0] == 0.0
    assert braked(0.2, sim=behind)[0] == 0.5


@pytest.mark.parametrize("turned", [0.0, 0.6])
@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("acceleration", [0.0, 1.0, 0.5])
def test_a_robot_stands_before_the_wall(acceleration: float, delay: int, turned: float) -> None:
    """Full speed towards a wall, straight or aslant, with a robot that answers late and slowly."""
    sim = replace(SIM, robot=RobotConfig(acceleration_max=acceleration, delay_steps=delay))
    wall = (2.0, 0.0, 0.0, 0.5, 6.0)
    scenario = Scenario(start=(0.0, 0.0, turned), goal=(5.0, 5.0), goal_radius=0.3, time_limit=10.0, boxes=[wall])
    free = evaluate(Reckless(), [scenario], sim=sim).episodes[0]
    episode = evaluate(Reckless(), [scenario], sim=sim, brake=MARGIN).episodes[0]
    assert (free.outcome, episode.outcome) == ("collision", "timeout")
    assert episode.min_clearance_m is not None
    assert 0.0 < episode.min_clearance_m < 0.15


def test_collisions_end_and_threads_change_nothing() -> None:
    scenarios = load_list(SIM, "tuning", count=120)
    straight, policy = Controller("straight", SIM), load_policy("default")
    assert evaluate(straight, scenarios).summary.collision_rate > 0.4
    # Noise lets what pushes on and on creep, and a lidar that looks ahead does not see what stands beside the robot.
    assert evaluate(straight, scenarios, brake=MARGIN).summary.collision_rate < 0.02
    one, two = (evaluate(policy, scenarios, num_threads=threads, brake=0.15) for threads in (1, 2))
    assert one.summary.collision_rate == 0.0
    assert one.episodes == two.episodes
    assert one.episodes != evaluate(policy, scenarios).episodes


def test_what_the_brake_is_not_for_is_refused() -> None:
    rectangle = replace(SIM, robot=RobotConfig(footprint="rectangle"))
    with pytest.raises(ValueError, match="footprint = disc"):
        evaluate(Reckless(), "tuning", sim=rectangle, brake=MARGIN)
    for margin in (-0.1, np.nan, 2.0):
        with pytest.raises(ValueError, match=r"expected a margin in \[0, 1\] m"):
            brake(np.zeros((1, 2)), wall_ahead(1.0), np.zeros((1, 2)), SIM, margin)
