"""Contenders of a comparison: who takes part, what they see and by whom they are led, at which level."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

import navrl.compare
from contending import SIM, policy_folder, scenario
from navrl.batch import BatchSim
from navrl.comparing import timing
from navrl.comparing.contenders import along, enter
from navrl.config import ControllersConfig, PlannerConfig, PursuitConfig
from navrl.config.levels import at_level
from navrl.controllers import Controller
from navrl.errors import UserError
from navrl.evaluate import driver, evaluate
from navrl.planners import Lookahead, plan, plan_all
from navrl.scenarios import ScenarioList, given_list

pytestmark = pytest.mark.usefixtures("quick")


# Who takes part


def test_names_of_contenders() -> None:
    assert (enter("dwa").pilot, enter("dwa").planner) == ("dwa", None)
    assert (enter("pursuit+rrt").pilot, enter("pursuit+rrt").planner) == ("pursuit", "rrt")
    assert enter("default+astar").policy_sha256 == enter("default").policy_sha256 is not None
    for name, message in (
        ("pursuit", r"^pursuit: follows a path: name a planner too"),
        ("dwa+teb", r"^dwa\+teb: expected a planner after the \+: astar, "),
        ("nobody", r"^nobody: no such folder; .* or a contender of dwa, "),
        ("nobody+astar", r"^nobody: no such folder"),
    ):
        with pytest.raises(UserError, match=message) as refusal:
            enter(name)
        assert "\n" not in str(refusal.value)


def test_a_folder_may_have_a_plus_in_its_name(tmp_path: Path) -> None:
    folder = policy_folder(tmp_path / "a+b")
    assert enter(str(folder)).policy is not None
    assert enter(f"{folder}+fmm").planner == "fmm"


class Blindfolded:
    """What a contender without a map may look at; anything else of the simulator is out of its sight."""

    def __init__(self, simulator: BatchSim) -> None:
        self.observations, self.ranges = simulator.observations, simulator.ranges
        self.velocities = simulator.velocities


@pytest.mark.parametrize("name", ["default", "dwa", "dwa-1997", "apf", "gap", "mppi", "straight", "random"])
def test_no_contender_without_a_planner_reads_the_map(name: str, drawn: ScenarioList) -> None:
    contender, sim = enter(name), at_level(SIM, "real")
    assert list(contender.plans(drawn.scenarios, sim, PlannerConfig())) == []
    simulator = BatchSim(sim, num_envs=12, autoreset=False, scenarios=drawn.scenarios)
    # Its driver is made where there is no scenario at all, and drives with scan, goal and speed alone.
    drive = contender.driver([], [], sim, ControllersConfig(), PlannerConfig())
    assert drive(Blindfolded(simulator), np.arange(12)).shape == (12, 2)  # type: ignore[arg-type]


def test_a_led_contender_gets_its_place_and_the_local_one_nothing_more(drawn: ScenarioList) -> None:
    contender, seen = enter("gap+astar"), []
    plans = list(contender.plans(drawn.scenarios, SIM, PlannerConfig()))
    simulator = BatchSim(SIM, num_envs=12, autoreset=False, scenarios=drawn.scenarios)
    drive = contender.driver(drawn.scenarios, plans, SIM, ControllersConfig(), PlannerConfig())
    with pytest.raises(AttributeError, match="odometry"):
        drive(Blindfolded(simulator), np.arange(12))  # type: ignore[arg-type]
    guide = Lookahead(plans, simulator.goals, distance=PlannerConfig().lookahead)

    def local(
        ranges: NDArray[np.float32], goal: NDArray[np.float64], velocity: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        seen.append((ranges, goal, velocity))
        return np.zeros((len(goal), 2))

    driver(local, SIM, towards=along(guide))(simulator, np.array([2, 5]))
    [(ranges, goal, velocity)] = seen
    assert np.array_equal(ranges, simulator.ranges[[2, 5]])
    assert np.array_equal(velocity, simulator.velocities[[2, 5]])
    targets = Lookahead(plans, simulator.goals, distance=PlannerConfig().lookahead).update(simulator.poses[:, :2])[
        [2, 5]
    ]
    x, y, yaw = simulator.poses[[2, 5]].T
    assert goal[:, 0] == pytest.approx(np.hypot(targets[:, 0] - x, targets[:, 1] - y), rel=1e-6)
    bearing = np.arctan2(targets[:, 1] - y, targets[:, 0] - x)
    assert np.cos(goal[:, 1] + yaw - bearing) == pytest.approx(1.0)
    assert (np.abs(goal[:, 1]) <= np.float32(math.pi)).all()


def test_a_path_leads_around_what_a_straight_driver_meets() -> None:
    wall = scenario(goal=(4.0, 0.0), boxes=[(2.0, 0.5, 0.0, 0.2, 3.0)], time_limit=60.0)
    given = given_list([wall], SIM)
    assert evaluate(Controller("straight"), given).episodes[0].outcome == "collision"
    for planner in ("astar", "rrt"):
        contender = enter(f"pursuit+{planner}")
        plans = list(contender.plans(given.scenarios, SIM, PlannerConfig()))
        drive = contender.driver(given.scenarios, plans, SIM, ControllersConfig(), PlannerConfig())
        episode = navrl.compare.measure(drive, given, SIM, num_threads=1).episodes[0]
        assert (episode.outcome, episode.needs_detour) == ("goal", True)
        assert episode.path_m == pytest.approx(plan(wall, planner).length, rel=0.1)


@pytest.mark.parametrize(("name", "expected"), [("straight+astar", 0.6), ("pursuit+astar", 0.9)])
def test_how_far_ahead_a_path_leads_is_a_setting(name: str, expected: float, monkeypatch: pytest.MonkeyPatch) -> None:
    given, seen = given_list([scenario(goal=(4.0, 0.0))], SIM), []

    def command(
        self: Controller, ranges: object, goal: NDArray[np.float64], *_: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        seen.append(goal[0, 0])
        return np.zeros((1, 2))

    monkeypatch.setattr(Controller, "command", command)
    contender, planner = enter(name), PlannerConfig(lookahead=0.6)
    controllers = ControllersConfig(pursuit=PursuitConfig(lookahead=0.9))
    plans = list(contender.plans(given.scenarios, SIM, planner))
    drive = contender.driver(given.scenarios, plans, SIM, controllers, planner)
    drive(BatchSim(SIM, num_envs=1, autoreset=False, scenarios=given.scenarios), np.arange(1))
    assert seen == pytest.approx([expected])


def test_paths_are_not_followed_by_points_that_count_as_reached() -> None:
    for name, key in (("straight+astar", "planner.lookahead"), ("pursuit+astar", "pursuit.lookahead")):
        controllers, planner = ControllersConfig(pursuit=PursuitConfig(lookahead=0.09)), PlannerConfig(lookahead=0.09)
        with pytest.raises(UserError, match=rf"^{key} = 0\.09: must be at least 0\.1, a third of task\.goal_radius$"):
            enter(name).driver([], [], SIM, controllers, planner)


def test_policies_are_led_by_the_goal_in_their_observation() -> None:
    given = given_list([scenario(goal=(4.0, 0.0), boxes=[(2.0, 0.5, 0.0, 0.2, 3.0)])], SIM)
    simulator = BatchSim(SIM, num_envs=1, autoreset=False, scenarios=given.scenarios)
    seen = []

    def act(observations: NDArray[np.float32]) -> NDArray[np.float32]:
        seen.append(observations.copy())
        return np.zeros((1, 2), np.float32)

    guide = Lookahead(plan_all(given.scenarios), simulator.goals, distance=1.0)
    driver(SimpleNamespace(act=act), SIM, towards=along(guide))(simulator, np.array([0]))
    own = simulator.observations
    assert np.array_equal(seen[0][:, :20], own[:, :20])
    assert np.array_equal(seen[0][:, -2:], own[:, -2:])
    # A metre ahead on a path that leads down and around the wall, and not at the goal 4 m ahead.
    assert own[0, -4:-2].tolist() == [4.0, 0.0]
    assert seen[0][0, -4] == pytest.approx(1.0, abs=1e-3)
    assert seen[0][0, -3] < -0.3


# Levels


def test_the_levels() -> None:
    assert at_level(SIM, "ideal") == SIM
    real = at_level(SIM, "real")
    assert (real.robot.acceleration_max, real.robot.angular_acceleration_max) == (1.0, 2.5)
    assert (real.robot.delay_steps, real.robot.odometry_noise) == (1, 0.02)
    assert (real.lidar.noise, real.lidar.drop_probability) == (0.02, 0.01)
    assert (real.task, real.world, real.robot.radius, real.lidar.beams) == (SIM.task, SIM.world, 0.25, 180)


def test_a_led_robot_follows_its_path_from_where_it_believes_to_be() -> None:
    sim = replace(SIM, robot=replace(SIM.robot, odometry_noise=0.2))
    given = given_list([scenario(goal=(8.0, 0.0))], sim)
    simulator = BatchSim(sim, num_envs=1, autoreset=False, scenarios=given.scenarios)
    towards = along(Lookahead(plan_all(given.scenarios), simulator.goals, distance=1.0))
    for _ in range(40):
        # On a straight path the target lies a metre beyond the place where it believes to be.
        assert towards(simulator, np.array([0]))[0].tolist() == pytest.approx([1.0, 0.0], abs=1e-6)
        simulator.step(np.array([[1.0, 0.0]], np.float32))
    assert abs(simulator.odometry[0, 0] - simulator.poses[0, 0]) > 0.01


def test_decisions_are_timed_after_the_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = iter([time for k in range(1, 100) for time in (1000.0 * k, 1000.0 * k + k)])
    monkeypatch.setattr(timing, "perf_counter", lambda: next(ticks))
    short = scenario(time_limit=0.7)
    times = timing.decision_times(enter("straight"), [short, short], SIM, ControllersConfig(), PlannerConfig())
    # Five calls are dropped; seven fit into a scenario, so that several are driven.
    assert times.tolist() == list(range(6, 26))
