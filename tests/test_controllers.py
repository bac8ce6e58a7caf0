"""Classical controllers: what each decides where one can say what it must, and how the evaluator runs them."""

import dataclasses
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl import Scenario, SimConfig, evaluate
from navrl.batch import BatchSim
from navrl.comparing.contenders import along
from navrl.config import (
    Config,
    ControllersConfig,
    DwaConfig,
    GapConfig,
    LidarConfig,
    MppiConfig,
    PursuitConfig,
    RobotConfig,
    WorldConfig,
)
from navrl.controllers import NAMES, Controller, Name
from navrl.evaluate import driver, measure
from navrl.planners import Lookahead, Plan
from navrl.scenarios import given_list, load_list

REPOSITORY = Path(__file__).parent.parent
Array = NDArray[np.float64]
QUICK = ControllersConfig(mppi=MppiConfig(samples=64, steps=20))
QUIET = SimConfig(lidar=LidarConfig(noise=0.0))
BEAMS, FAR = 180, 10.0
ANGLES = (np.arange(BEAMS) + 0.5) * math.pi / BEAMS - math.pi / 2


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def decide(
    name: Name,
    ranges: NDArray[np.float32] | Array,
    goal: tuple[float, float],
    velocity: tuple[float, float] = (0.0, 0.0),
    *,
    sim: SimConfig = QUIET,
    settings: ControllersConfig = QUICK,
) -> Array:
    """The command of one robot."""
    return Controller(name, sim, settings).command(ranges[None], [goal], [velocity])[0]


def situations(count: int, *, steps: int = 25) -> tuple[NDArray[np.float32], Array, Array]:
    """Ranges, goals and velocities of robots on their way through "td3"."""
    simulator = BatchSim(QUIET, num_envs=count, scenarios=load_list(QUIET, "tuning", count=count).scenarios)
    generator = np.random.default_rng(0)
    for _ in range(steps):
        simulator.step(np.stack([np.full(count, 0.5), generator.uniform(-1, 1, count)], axis=1).astype(np.float32))
    goals = simulator.observations[:, 20:22].astype(np.float64)
    return simulator.ranges.copy(), goals, simulator.velocities.copy()


def test_the_core_tests_and_benches_use_these_settings() -> None:
    text = (REPOSITORY / "crates/navsim/tests/controllers.json").read_text(encoding="utf-8")
    assert json.loads(text) == dataclasses.asdict(ControllersConfig())
    assert Config().controllers == ControllersConfig()


# The dynamic window


def slow_dwa(ranges: Array, goal: Array, velocity: Array, sim: SimConfig, dwa: DwaConfig) -> tuple[Array, Array]:
    """Every command of the window with its value by the definition: arcs driven in steps of a millimetre."""
    hit = ranges < FAR
    points = ranges[hit, None] * np.stack([np.cos(ANGLES[hit]), np.sin(ANGLES[hit])], axis=1)
    radius, step = sim.robot.radius + dwa.margin, 1e-3
    reach = min(dwa.clearance_max, goal[0])
    target = goal[0] * np.array([math.cos(goal[1]), math.sin(goal[1])])

    def free(start: Array, yaw: float, curvature: float) -> float:
        ways = np.arange(0, 5, step)
        ways = ways[ways * abs(curvature) <= math.pi]
        half = curvature * ways / 2
        chords = ways * np.sinc(half / math.pi)
        places = start + chords[:, None] * np.stack([np.cos(yaw + half), np.sin(yaw + half)], axis=1)
        if not len(points):
            return math.inf
        near = ((places[:, None] - points) ** 2).sum(axis=2).min(axis=1) <= radius**2
        return float(ways[near.argmax()]) if near.any() else math.inf

    def window(now: float, limit: float, low: float, high: float) -> tuple[float, float]:
        change = limit * sim.task.period if limit else math.inf
        return min(max(now - change, low), high), min(max(now + change, low), high)

    robot = sim.robot
    speeds = np.linspace(*window(velocity[0], robot.acceleration_max, 0, robot.v_max), dwa.v_samples)
    turns = np.linspace(
        *window(velocity[1], robot.angular_acceleration_max, -robot.omega_max, robot.omega_max), dwa.omega_samples
    )
    commands, values = [], []
    for v in speeds:
        for omega in turns:
            way = free(np.zeros(2), 0.0, omega / v) if v else free(np.zeros(2), omega * dwa.horizon, 0.0)
            braking = v * v / (2 * robot.acceleration_max) if robot.acceleration_max else 0.0
            admissible = v == 0 or v * dwa.reaction + braking <= way
            time = min(dwa.horizon, goal[0] / 2 / v) if v else dwa.horizon
            turn = omega * time / 2
            place = v * time * np.sinc(turn / math.pi) * np.array([math.cos(turn), math.sin(turn)])
            off = math.atan2(target[1] - place[1], target[0] - place[0]) - 2 * turn
            off = abs((off + math.pi) % (2 * math.pi) - math.pi)
            value = (
                dwa.heading * (1 - off / math.pi)
                + dwa.clearance * min(way, reach) / reach
                + dwa.speed * v / robot.v_max
            )
            commands.append((v, omega))
            values.append(value if admissible else -math.inf)
    return np.array(commands), np.array(values)


@pytest.mark.parametrize("limits", [(0.0, 0.0), (1.0, 2.5)])
def test_the_dynamic_window_chooses_as_its_definition(limits: tuple[float, float]) -> None:
    sim = dataclasses.replace(QUIET, robot=RobotConfig(acceleration_max=limits[0], angular_acceleration_max=limits[1]))
    dwa = DwaConfig(heading=1.0, clearance=1.5, speed=1.0, horizon=1.0, clearance_max=1.5, v_samples=4, omega_samples=7)
    # What the window holds is then driven in a period.
    dwa = dataclasses.replace(dwa, interval=sim.task.period)
    ranges, goals, velocities = situations(25)
    chosen = Controller("dwa", sim, ControllersConfig(dwa=dwa)).command(ranges, goals, velocities)
    same = 0
    for k in range(len(chosen)):
        # Within the margin the definition says nothing.
        if ranges[k].min() < sim.robot.radius + dwa.margin + 0.01:
            continue
        commands, values = slow_dwa(ranges[k].astype(np.float64), goals[k], velocities[k], sim, dwa)
        place = int(np.abs(commands - chosen[k]).sum(axis=1).argmin())
        assert commands[place] == pytest.approx(chosen[k], abs=1e-6)
        # A step of a millimetre may misjudge the clearance by as much.
        assert values[place] >= values.max() - 2 * dwa.clearance * 1e-3 / min(dwa.clearance_max, goals[k][0])
        same += place == values.argmax()
    assert same >= 18


def test_the_window_keeps_to_accelerations() -> None:
    sim = dataclasses.replace(QUIET, robot=RobotConfig(acceleration_max=1.0, angular_acceleration_max=2.5))
    v, omega = decide("dwa", np.full(BEAMS, FAR), (5.0, 0.0), (0.2, 0.5), sim=sim)
    # 1 m/s^2 and 2.5 rad/s^2 for 0.1 s, in open space straight to the goal.
    assert v == pytest.approx(0.3)
    assert omega == pytest.approx(0.25)


def test_admissible_speeds_by_hand() -> None:
    # A wall 0.5 m from the robot's border, all arcs straight: v x 0.4 s + v^2 / 2 <= 0.5 leaves v <= 0.6770.
    ranges = np.full(BEAMS, FAR)
    ranges[80:100] = (0.25 + 0.5) / np.cos(ANGLES[80:100])
    sim = dataclasses.replace(
        QUIET, robot=RobotConfig(v_max=1.0, omega_max=1e-6, acceleration_max=1.0, angular_acceleration_max=1e-6)
    )
    dwa = DwaConfig(heading=0.0, clearance=0.0, speed=1.0, margin=0.0, reaction=0.4, v_samples=201, omega_samples=2)
    dwa = dataclasses.replace(dwa, interval=0.1)
    v, _ = decide("dwa", ranges, (5.0, 0.0), (0.65, 0.0), sim=sim, settings=ControllersConfig(dwa=dwa))
    # 201 speeds from 0.55 to 0.75.
    assert 0.6770 - 0.001 <= v <= 0.6770
    assert math.isclose(0.6770 * 0.4 + 0.6770**2 / 2, 0.5, abs_tol=1e-4)


def test_a_robot_that_must_gather_speed_finds_the_way_around() -> None:
    """With a window of one period it stands before the obstacle: after so short a turn nothing looks better."""
    sim = dataclasses.replace(QUIET, robot=RobotConfig(acceleration_max=1.0, angular_acceleration_max=2.5))
    wall = Scenario(
        start=(0.0, 0.0, 0.0), goal=(6.0, 0.0), goal_radius=0.3, time_limit=60.0, boxes=[(1.0, 0.0, 0.0, 0.4, 2.0)]
    )
    outcomes = []
    for interval in (0.1, 0.4):
        dwa = DwaConfig(clearance=30.0, speed=7.0, horizon=3.0, clearance_max=2.8, reaction=0.4, interval=interval)
        controller = Controller("dwa", sim, ControllersConfig(dwa=dwa))
        outcomes.append(evaluate(controller, [wall], sim=sim).episodes[0].outcome)
    assert outcomes == ["timeout", "goal"]


def test_the_weights_of_1997() -> None:
    ranges, goals, velocities = situations(20)
    # 0.2 for each of the 10 m that the lidar sees.
    weights = {"heading": 2.0, "clearance": 2.0, "speed": 0.2}
    dwa = dataclasses.replace(ControllersConfig().dwa, **weights, clearance_max=10.0, horizon=1.0, interval=0.25)
    expected = Controller("dwa", QUIET, ControllersConfig(dwa=dwa)).command(ranges, goals, velocities)
    assert np.array_equal(Controller("dwa-1997", QUIET).command(ranges, goals, velocities), expected)
    assert not np.array_equal(Controller("dwa", QUIET).command(ranges, goals, velocities), expected)


# The potential field and gap following


def behind_a_wall() -> Scenario:
    """The goal straight behind a wall 2 m wide."""
    return Scenario(
        start=(0.0, 0.0, 0.0), goal=(6.0, 0.0), goal_radius=0.3, time_limit=60.0, boxes=[(3.0, 0.0, 0.0, 0.4, 2.0)]
    )


def test_the_potential_field_stands_in_its_local_minimum() -> None:
    episode = evaluate(Controller("apf", QUIET), [behind_a_wall()], sim=QUIET).episodes[0]
    assert episode.outcome == "timeout"
    # It stands before the wall, whose side is at 2.8 m, and does not touch it.
    assert 1.0 < episode.path_m < 2.6
    # Others find the way round.
    gap = GapConfig(reach=1.6, heading=0.7, border=0.3, turn_gain=3.5, slow_distance=0.6)
    for name in ("dwa", "gap"):
        controller = Controller(name, QUIET, ControllersConfig(gap=gap))
        assert evaluate(controller, [behind_a_wall()], sim=QUIET).episodes[0].outcome == "goal"


def test_the_potential_field_drives_straight_where_nothing_pushes() -> None:
    assert decide("apf", np.full(BEAMS, FAR), (3.0, 0.0)) == pytest.approx([0.5, 0.0], abs=1e-6)
    v, omega = decide("apf", np.full(BEAMS, FAR), (3.0, 0.05))
    assert v == pytest.approx(0.5 * math.cos(0.05), abs=1e-6)
    assert omega == pytest.approx(0.05 * ControllersConfig().apf.turn_gain, abs=1e-6)


@pytest.mark.parametrize("side", [1, -1])
def test_gap_following_takes_the_gap_by_hand(side: int) -> None:
    # A wall at 1 m with a gap from 20 to 60 degrees on one side and one from 62 to 88 on the other. A robot of 0.3 m
    # with its margin needs asin(0.3) = 17.46 degrees to either side: 37.46 to 42.54 is free, and nothing of the other.
    degrees = side * np.degrees(ANGLES)
    ranges = np.where(((degrees > 20) & (degrees < 60)) | ((degrees < -62) & (degrees > -88)), FAR, 1.0)
    gap = GapConfig(reach=1.0, margin=0.05, goal=1.0, heading=0.5, border=0.0, turn_gain=1.0, slow_distance=1.4)
    v, omega = decide("gap", ranges, (5.0, 0.0), settings=ControllersConfig(gap=gap))
    direction = math.degrees(omega) * side
    assert 37.46 - 2 <= direction <= 42.54 + 2
    # 0.7 m are free ahead, half of 1.4.
    assert v == pytest.approx(0.5 * math.cos(omega) * 0.5, abs=1e-3)


def test_gap_following_turns_where_nothing_is_free() -> None:
    for side in (1, -1):
        assert decide("gap", np.full(BEAMS, 0.4), (5.0, side * 0.4)) == pytest.approx([0.0, side])
        assert decide("gap", np.full(BEAMS, FAR), (5.0, side * 3.0)) == pytest.approx([0.0, side])


# Pursuit


def test_pursuit_drives_off_from_what_it_starts_beside() -> None:
    # A wall 1 cm beside the robot, half of its margin, and a little ahead.
    wall = Scenario(
        start=(0.0, 0.0, 0.0), goal=(3.0, 0.0), goal_radius=0.3, time_limit=20.0, boxes=[(1.05, 0.36, 0.0, 2.0, 0.2)]
    )
    episode = evaluate(Controller("pursuit", QUIET), [wall], sim=QUIET).episodes[0]
    assert episode.outcome == "goal"
    assert episode.min_clearance_m == pytest.approx(0.01, abs=1e-6)


def test_pursuit_slows_as_it_could_still_stop() -> None:
    # A wall 0.3 m from the disc with its margin, and 0.3 s before the robot brakes: v x 0.3 s <= 0.3 m without a limit,
    # v x 0.3 s + v^2 / (2 m/s^2) <= 0.3 m leaves v <= 0.5307 m/s with one.
    ranges = np.full(BEAMS, FAR)
    ranges[45:135] = (0.25 + 0.02 + 0.3) / np.cos(ANGLES[45:135])
    settings = ControllersConfig(pursuit=PursuitConfig(stop_time=0.2, margin=0.02, detour=0.0))
    for acceleration, expected in ((0.0, 1.0), (1.0, 0.5307)):
        robot = RobotConfig(v_max=2.0, acceleration_max=acceleration)
        sim = dataclasses.replace(QUIET, robot=robot)
        v, omega = decide("pursuit", ranges, (5.0, 0.0), (0.6, 0.0), sim=sim, settings=settings)
        assert v == pytest.approx(expected, abs=1e-3)
        assert omega == pytest.approx(0.0)


def test_pursuit_stops_before_an_obstacle() -> None:
    wall = Scenario(
        start=(0.0, 0.0, 0.0), goal=(5.0, 0.0), goal_radius=0.3, time_limit=20.0, boxes=[(3.0, 0.0, 0.0, 0.4, 2.0)]
    )
    settings = ControllersConfig(pursuit=PursuitConfig(detour=0.0))
    episode = evaluate(Controller("pursuit", QUIET, settings), [wall], sim=QUIET).episodes[0]
    assert episode.outcome == "timeout"
    # The border of the disc of 0.25 m comes to the wall's side at 2.8 m but for the margin, and stays there.
    assert episode.min_clearance_m is not None
    assert episode.min_clearance_m == pytest.approx(settings.pursuit.margin, abs=1e-4)
    assert episode.path_m == pytest.approx(2.8 - 0.25 - episode.min_clearance_m, abs=1e-3)


def test_pursuit_steps_aside_for_what_stands_on_its_path() -> None:
    # The map, and the path, know nothing of the post.
    post = Scenario(
        start=(0.0, 0.0, 0.0), goal=(6.0, 0.0), goal_radius=0.3, time_limit=40.0, boxes=[(3.0, 0.1, 0.0, 0.3, 0.3)]
    )
    path = np.stack([np.linspace(0, 6, 61), np.zeros(61)], axis=1)
    outcomes = []
    for detour in (0.0, 2.0):
        settings = ControllersConfig(pursuit=PursuitConfig(detour=detour))
        guide = Lookahead([Plan("found", path, 6.0, 0.0, 0, 0.0)], path[-1:], distance=settings.pursuit.lookahead)
        drive = driver(Controller("pursuit", QUIET, settings), QUIET, towards=along(guide))
        episode = measure(drive, given_list([post], QUIET), QUIET, num_threads=1).episodes[0]
        outcomes.append(episode.outcome)
    assert outcomes == ["timeout", "goal"]
    # Beside what is free nothing changes: the arc is the same with and without.
    ranges, goals, velocities = situations(20)
    near = np.minimum(goals, [0.3, math.inf])
    free = ranges.min(axis=1) > 0.25 + 0.02 + 0.3
    aside, stubborn = (
        Controller("pursuit", QUIET, ControllersConfig(pursuit=PursuitConfig(detour=detour))).command(
            ranges[free], near[free], velocities[free]
        )
        for detour in (2.0, 0.0)
    )
    assert free.sum() > 5
    assert np.array_equal(aside, stubborn)


@pytest.mark.parametrize(
    "path",
    [
        np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [4.0, 2.0]]),
        np.stack([np.linspace(0, 6, 61), np.sin(np.linspace(0, 6, 61))], axis=1),
    ],
    ids=["corners", "waves"],
)
def test_pursuit_follows_a_path(path: Array) -> None:
    settings = PursuitConfig()
    controller, pose, velocity = Controller("pursuit", QUIET), np.zeros(3), np.zeros(2)
    furthest, nothing = 0.0, np.full((1, BEAMS), FAR)
    guide = Lookahead([Plan("found", path, 0.0, 0.0, 0, 0.0)], path[-1:], distance=settings.lookahead)
    dense = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(path)])
    for _ in range(400):
        velocity = controller.command(nothing, guide.goal(pose[None]), [velocity])[0]
        half = velocity[1] * 0.05
        chord = velocity[0] * 0.1 * np.sinc(half / math.pi)
        pose += [chord * math.cos(pose[2] + half), chord * math.sin(pose[2] + half), 2 * half]
        furthest = max(furthest, float(np.hypot(*(dense - pose[:2]).T).min()))
        if math.dist(pose[:2], path[-1]) < 0.1:
            break
    assert math.dist(pose[:2], path[-1]) < 0.1
    # A corner is cut by less than half of the look-ahead distance.
    assert furthest < settings.lookahead / 2


# Robots that err


def test_commands_that_act_late_are_decided_for_where_the_robot_will_be() -> None:
    late = dataclasses.replace(QUIET, robot=RobotConfig(delay_steps=2))
    ahead = Controller("straight", late)
    nothing, goal, velocity = np.full((1, BEAMS), FAR), np.array([3.0, 0.2]), np.array([0.5, 0.0])
    pose, given = np.zeros(3), []
    place = goal[0] * np.array([math.cos(goal[1]), math.sin(goal[1])])
    for _ in range(6):
        seen = np.array([np.linalg.norm(place - pose[:2]), math.atan2(*(place - pose[:2])[::-1]) - pose[2]])
        given.append(ahead.command(nothing, [seen], [velocity])[0])
        # What acts now was given two decisions before; the robot stands until then.
        waiting = ([np.zeros(2), np.zeros(2), *given])[-3:]
        later = pose.copy()
        for v, omega in waiting[:2]:
            chord = v * 0.1 * np.sinc(omega * 0.05 / math.pi)
            yaw = later[2] + omega * 0.05
            later += [chord * math.cos(yaw), chord * math.sin(yaw), omega * 0.1]
        there = np.array([np.linalg.norm(place - later[:2]), math.atan2(*(place - later[:2])[::-1]) - later[2]])
        assert given[-1] == pytest.approx(
            Controller("straight", QUIET).command(nothing, [there], [velocity])[0], abs=1e-5
        )
        velocity = waiting[0]
        chord, yaw = velocity[0] * 0.1 * np.sinc(velocity[1] * 0.05 / math.pi), pose[2] + velocity[1] * 0.05
        pose += [chord * math.cos(yaw), chord * math.sin(yaw), velocity[1] * 0.1]


@pytest.mark.parametrize("name", ["dwa", "apf", "gap", "mppi", "pursuit"])
def test_a_goal_that_odometry_misplaced_is_found(name: Name) -> None:
    sim = SimConfig(robot=RobotConfig(odometry_noise=0.1))
    goals = [(5.0 * math.cos(0.5 * k), 5.0 * math.sin(0.5 * k)) for k in range(24)]
    tasks = [Scenario(start=(0.0, 0.0, 0.0), goal=goal, goal_radius=0.3, time_limit=60.0) for goal in goals]
    settings = ControllersConfig(mppi=MppiConfig(samples=64))
    episodes = evaluate(Controller(name, sim, settings), tasks, sim=sim).episodes
    # Nearly half of them are believed to lie more than their radius away from where they are, some five times as far.
    assert sum(episode.outcome == "goal" for episode in episodes) >= 20


# All of them


@pytest.mark.parametrize("name", NAMES)
def test_arrays_of_any_layout_give_the_same(name: Name) -> None:
    ranges, goals, velocities = situations(6)
    expected = Controller(name, QUIET, QUICK).command(ranges, goals, velocities)
    assert expected.shape == (6, 2)
    assert expected.dtype == np.float64
    other = Controller(name, QUIET, QUICK).command(
        np.asfortranarray(ranges),
        np.repeat(goals, 2, axis=1)[:, ::2],
        velocities[::-1][::-1],
        robots=np.arange(12, dtype=np.int64)[::2] // 2,
    )
    assert np.array_equal(other, expected)
    lists = Controller(name, QUIET, QUICK).command(ranges.tolist(), goals.tolist(), velocities.tolist())
    assert np.array_equal(lists, expected)


@pytest.mark.parametrize("name", NAMES)
def test_what_cannot_be_used_is_refused(name: Name) -> None:
    controller = Controller(name, QUIET, QUICK)
    ranges, zeros = np.full((2, BEAMS), FAR), np.zeros((2, 2))
    for bad, message in (
        ((ranges[:, 1:], zeros, zeros), r"ranges: expected shape \[2, 180\], got \[2, 179\]"),
        ((ranges[0], zeros, zeros), "ranges: expected shape"),
        ((ranges, zeros[:1], zeros), r"goal: expected shape \[2, 2\], got \[1, 2\]"),
        ((ranges, zeros + math.nan, zeros), "goal: row 0: expected numbers"),
        ((ranges, zeros - 1, zeros), "goal: row 0: expected a distance >= 0, got -1"),
        ((ranges, zeros, zeros + math.inf), "velocity: row 0: expected numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            controller.command(*bad)
    # Lost beams are no mistake.
    assert np.isfinite(controller.command(ranges * math.nan, zeros, zeros)).all()


def test_names_and_settings_are_checked() -> None:
    with pytest.raises(ValueError, match="controller 'dwb': expected one of dwa, dwa-1997"):
        Controller("dwb")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"dwa.horizon = 0.0: must be a number in \[0.001, 60\]"):
        DwaConfig(horizon=0.0)


@pytest.mark.parametrize("name", NAMES)
def test_no_controller_can_read_the_map(name: Name) -> None:
    """Worlds that differ only behind the robot and behind a wall look the same, and are decided upon alike."""
    wall = (2.0, 0.3, 0.0, 0.2, 1.5)
    hidden: list[list[tuple[float, ...]]] = [[], [(-1.0, 0.0, 0.0, 0.5, 0.5)], [(3.0, 0.3, 0.0, 0.4, 1.0)]]
    commands = []
    for boxes in hidden:
        scenario = Scenario(
            start=(0.0, 0.0, 0.0), goal=(5.0, 1.0), goal_radius=0.3, time_limit=50.0, boxes=[wall, *boxes]
        )
        simulator = BatchSim(QUIET, num_envs=1, autoreset=False, scenarios=[scenario])
        drive = driver(Controller(name, QUIET, QUICK), QUIET)
        commands.append(drive(simulator, np.arange(1)).tolist())
    assert commands[0] == commands[1] == commands[2]


@pytest.mark.parametrize("name", ["mppi", "random"])
def test_random_numbers_depend_on_the_robot_alone(name: Name) -> None:
    ranges, goals, velocities = situations(5)
    together, alone = (Controller(name, QUIET, QUICK, seed=4) for _ in range(2))
    for _ in range(3):
        expected = together.command(ranges, goals, velocities)
        for k in (3, 0, 4, 1, 2):
            row = slice(k, k + 1)
            assert np.array_equal(alone.command(ranges[row], goals[row], velocities[row], [k]), expected[row])
    drawn = load_list(SimConfig(), "tuning", count=4)
    controller = Controller(name, SimConfig(), QUICK)
    first, again = (evaluate(controller, drawn, num_threads=threads) for threads in (1, 2))
    assert first == again


# How good they are


@pytest.mark.parametrize(("name", "floor"), [("dwa", 0.95), ("gap", 0.9), ("apf", 0.5), ("mppi", 0.5)])
def test_controllers_reach_their_goals(name: Name, floor: float) -> None:
    sim = SimConfig(world=WorldConfig(name="boxes", boxes=8))
    drawn = load_list(sim, "tuning", count=20 if name == "mppi" else 100)
    settings = ControllersConfig(mppi=MppiConfig(samples=256))
    scores = evaluate(Controller(name, sim, settings), drawn).summary
    assert scores.success_rate >= floor
    assert scores.collision_rate <= 0.02
