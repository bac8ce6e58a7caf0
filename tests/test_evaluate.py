"""The evaluator: every scenario once, the same numbers whatever runs beside it, and hand-made episodes."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from navrl.batch import Scenario
from navrl.config import Config, LidarConfig, RobotConfig, SimConfig, TaskConfig
from navrl.controllers import Controller
from navrl.evaluate import evaluate, scores_table, write_json
from navrl.metrics import EPISODE_KEYS, Episode
from navrl.policy import Policy, PolicyDescription, PolicyError
from navrl.scenarios import ScenarioError, hash_scenarios, load_list

Array = NDArray[np.float64]


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


class Constant:
    """Does the same whatever it sees."""

    def __init__(self, a1: float, a2: float) -> None:
        self.action = np.array([a1, a2], np.float32)

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.tile(self.action, (len(observations), 1))


class TowardsGoal:
    """Turns to the goal and drives, a little less straight where the lidar sees something near."""

    def __init__(self) -> None:
        self.rows = 0

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        self.rows += len(observations)
        nearest, angle = observations[:, :20].min(axis=1), observations[:, 21]
        turn = np.clip(2 * angle + 0.2 * np.maximum(0, 1 - nearest), -1, 1)
        return np.stack([np.where(np.abs(angle) < 0.5, 1, -1), turn], axis=1).astype(np.float32)


def scenario(goal: float = 3.0, **changes: object) -> Scenario:
    values = {"start": (0.0, 0.0, 0.0), "goal": (goal, 0.0), "goal_radius": 0.3, "time_limit": 10.0} | changes
    return Scenario(**values)  # type: ignore[arg-type]


def trained_like() -> Policy:
    """A policy with an odd layer, so that products of many shapes occur."""
    description = replace(PolicyDescription.from_config(Config()), hidden_sizes=(33, 16))
    generator = np.random.default_rng(0)
    sizes = {"hidden.0": (33, 26), "hidden.1": (16, 33), "output": (2, 16)}
    weights = {f"{n}.weight": generator.standard_normal(s).astype(np.float32) / 5 for n, s in sizes.items()}
    weights |= {f"{n}.bias": np.full(s[0], 0.1, np.float32) for n, s in sizes.items()}
    return Policy(weights, description)


# Episodes by hand: 0.05 m a step at full speed


def test_episodes_by_hand() -> None:
    ahead = Constant(1.0, 0.0)
    given = [
        # Under 0.3 m from the goal after 55 steps: 3.02 - 0.05 n < 0.3, and not after 54.
        scenario(goal=3.02),
        # The wall's near side at 2 m is met when the centre has driven 1.75 m, at the end of step 35.
        scenario(goal=5.0, boxes=[(2.5, 0.0, 0.0, 1.0, 1.0), (0.0, 1.25, 0.0, 1.0, 1.0)]),
        # 4 s are 40 steps.
        scenario(goal=5.0, time_limit=4.0),
    ]
    evaluation = evaluate(ahead, given, sim=SimConfig(), num_threads=1)
    reached, collided, late = evaluation.episodes
    assert (reached.outcome, collided.outcome, late.outcome) == ("goal", "collision", "timeout")
    assert (reached.steps, late.steps) == (55, 40)
    assert collided.steps in (35, 36)
    assert (reached.time_s, late.time_s) == pytest.approx((5.5, 4.0))
    assert reached.path_m == pytest.approx(2.75)
    assert collided.path_m == pytest.approx(1.75, abs=1e-4)
    assert reached.shortest_m == pytest.approx(2.72, rel=0.003)
    # The disc of 0.25 m starts 0.75 m - 0.25 m from the box on its left; nothing stands in the first world.
    assert collided.min_clearance_m == pytest.approx(0.0, abs=1e-4)
    assert reached.min_clearance_m is None
    # Eq. 3: v = 0.5 a step and 100 at the goal instead, whatever the configuration rewards.
    assert reached.total_return == pytest.approx(54 * 0.5 + 100)
    assert late.total_return == pytest.approx(40 * 0.5)
    scores = evaluation.summary
    assert (scores.success_rate, scores.collision_rate, scores.timeout_rate) == pytest.approx((1 / 3,) * 3)
    assert scores.spl == pytest.approx(reached.shortest_m / 2.75 / 3)
    assert scores.list_sha256 == hash_scenarios(given)


def test_a_world_without_obstacles_has_no_clearance() -> None:
    evaluation = evaluate(Constant(1.0, 0.0), [scenario()], sim=SimConfig())
    assert evaluation.summary.min_clearance_m is None
    json.dumps(evaluation.to_json("x"), allow_nan=False)


def test_acceleration_limits_and_period_of_the_configuration_count() -> None:
    sim = SimConfig(robot=RobotConfig(acceleration_max=0.5), task=TaskConfig(period=0.2))
    # 0.1, 0.2, 0.3, 0.4, 0.5, 0.5 ... m/s for 0.2 s each: 0.3 m after five steps, 2.75 m are passed after 25 more.
    episode = evaluate(Constant(1.0, 0.0), [scenario(goal=3.05)], sim=sim).episodes[0]
    assert (episode.steps, episode.time_s) == (30, pytest.approx(6.0))


# Every scenario once


def test_every_scenario_runs_exactly_once_in_order() -> None:
    drawn = load_list(SimConfig(), "test", count=200)
    policy = TowardsGoal()
    evaluation = evaluate(policy, drawn, sim=SimConfig())
    assert [e.index for e in evaluation.episodes] == list(range(200))
    # One decision a step and robot: finished robots are not asked, none is run twice.
    assert policy.rows == sum(e.steps for e in evaluation.episodes)
    assert evaluation.summary.episodes == 200
    assert np.array_equal([e.shortest_m for e in evaluation.episodes], drawn.shortest)
    straight = [math.dist(s.start[:2], s.goal) - s.goal_radius for s in drawn.scenarios]
    assert all(e.shortest_m > 0.996 * length for e, length in zip(evaluation.episodes, straight, strict=True))
    for episode in evaluation.episodes:
        if episode.outcome == "goal":
            assert episode.path_m > 0.99 * episode.shortest_m


def test_scores_do_not_depend_on_threads() -> None:
    drawn = load_list(SimConfig(), "test", count=300)
    one, two = (evaluate(trained_like(), drawn, num_threads=threads) for threads in (1, 2))
    assert one == two


def test_a_class_made_from_a_policy_acts_as_it_says() -> None:
    class Standing(Policy):
        def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
            return np.tile(np.array([-1.0, 0.0], np.float32), (len(observations), 1))

    trained = trained_like()
    drawn = load_list(SimConfig(), "test", count=20)
    standing = evaluate(Standing(trained.weights, trained.description), drawn, sim=SimConfig())
    assert standing.summary.timeout_rate == 1.0


def test_an_episode_does_not_depend_on_what_runs_beside_it() -> None:
    """The lidar's noise is named by the place in the list, so any beginning of the list gives the same episodes."""
    drawn = load_list(SimConfig(), "test", count=130)
    for policy in (trained_like(), TowardsGoal()):
        whole = evaluate(policy, drawn, sim=SimConfig()).episodes
        for count in (1, 17, 64):
            assert evaluate(policy, drawn.first(count), sim=SimConfig()).episodes == whole[:count]


def test_the_learners_copy_of_a_policy_scores_the_same() -> None:
    policy = trained_like()
    copy = Policy(policy.weights, policy.description)
    drawn = load_list(SimConfig(), "validation", count=50)
    assert evaluate(policy, drawn).episodes == evaluate(copy, drawn, sim=policy.description.sim_config()).episodes


# What belongs together


def test_robot_and_lidar_come_from_the_policy() -> None:
    config = Config(lidar=LidarConfig(beams=24, bins=4), robot=RobotConfig(v_max=0.2))
    description = replace(PolicyDescription.from_config(config), hidden_sizes=(3,))
    weights = {"hidden.0.weight": np.zeros((3, 10), np.float32), "hidden.0.bias": np.zeros(3, np.float32)}
    weights |= {"output.weight": np.zeros((2, 3), np.float32), "output.bias": np.array([9, 0], np.float32)}
    # 0.02 m a step: 2.7 m take 136.
    episode = evaluate(Policy(weights, description), [scenario(time_limit=30.0)]).episodes[0]
    assert episode.steps == pytest.approx(136, abs=1)


@pytest.mark.parametrize(
    ("sim", "message"),
    [
        (SimConfig(robot=RobotConfig(v_max=0.7)), r"robot\.v_max = 0\.7: the policy was trained for 0\.5"),
        (SimConfig(robot=RobotConfig(acceleration_max=1.0)), r"robot\.acceleration_max = 1\.0: .* trained for 0\.0$"),
        (
            SimConfig(robot=RobotConfig(angular_acceleration_max=2.0)),
            r"robot\.angular_acceleration_max = 2\.0: .* 0\.0$",
        ),
        (SimConfig(robot=RobotConfig(radius=0.3)), r"robot\.radius = 0\.3: the policy was trained for 0\.25"),
        (SimConfig(robot=RobotConfig(footprint="rectangle")), r"robot\.footprint = rectangle: .* trained for disc"),
        (SimConfig(lidar=LidarConfig(fov=2.0)), r"lidar\.fov = 2\.0"),
        (SimConfig(lidar=LidarConfig(beams=360)), r"lidar\.beams = 360: the policy was trained for 180"),
        (SimConfig(task=TaskConfig(period=0.2)), r"task\.period = 0\.2"),
    ],
)
def test_a_policy_refuses_another_robot(sim: SimConfig, message: str) -> None:
    with pytest.raises(PolicyError, match=message):
        evaluate(trained_like(), [scenario()], sim=sim)


def test_noise_and_sizes_of_another_footprint_may_differ_from_training() -> None:
    own = SimConfig()
    other = replace(own, lidar=replace(own.lidar, noise=0.02), robot=replace(own.robot, length=0.7, width=0.1))
    assert evaluate(trained_like(), [scenario()], sim=other).summary.episodes == 1


def test_a_policy_without_description_needs_a_simulator() -> None:
    with pytest.raises(PolicyError, match="sim: must be given"):
        evaluate(TowardsGoal(), [scenario()])


def test_scenarios_that_cannot_be_run_are_named_by_their_place() -> None:
    cage = [(2.0, -1.0, 2.0, 1.0), (4.0, -1.0, 4.0, 1.0), (2.0, -1.0, 4.0, -1.0), (2.0, 1.0, 4.0, 1.0)]
    for bad, reason in (
        (scenario(segments=cage), "unreachable"),
        (scenario(goal=0.2), "the way to the goal circle is 0 m long, at least 0.1 m are needed"),
        (scenario(goal=0.35), "the way to the goal circle is 0.05 m long"),
        (scenario(circles=[(0.1, 0.0, 0.3)]), "in contact"),
    ):
        with pytest.raises(ScenarioError, match=rf"^scenario 1: .*{reason}") as refusal:
            evaluate(Constant(1.0, 0.0), [scenario(), bad], sim=SimConfig())
        assert "\n" not in str(refusal.value)
    with pytest.raises(ScenarioError, match=r"^scenario 0: .* \(and 2 more scenarios\)$"):
        evaluate(Constant(1.0, 0.0), [scenario(goal=0.2), scenario(), *[scenario(goal=0.35)] * 2], sim=SimConfig())


def test_a_list_of_nothing_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"^scenarios: expected at least one$"):
        evaluate(Constant(1.0, 0.0), [], sim=SimConfig())


@pytest.mark.parametrize(("columns", "shape"), [((), r"\(2,\)"), ((3,), r"\(2, 3\)")])
def test_actions_of_another_shape_are_refused(columns: tuple[int, ...], shape: str) -> None:
    class Strange:
        def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
            return np.zeros((len(observations), *columns), np.float32)

    with pytest.raises(ValueError, match=rf"^act: expected actions of shape \(2, 2\), got {shape}$"):
        evaluate(Strange(), [scenario(), scenario()], sim=SimConfig())


def test_times_are_the_shortest_decimals() -> None:
    # 179 * 0.1 is 17.900000000000002.
    episode = evaluate(Constant(1.0, 0.0), [scenario(goal=50.0, time_limit=17.9)], sim=SimConfig()).episodes[0]
    assert (episode.steps, episode.time_s) == (179, 17.9)


def test_an_unknown_list_is_refused() -> None:
    with pytest.raises(ScenarioError, match="list exam"):
        evaluate(trained_like(), "exam")  # type: ignore[arg-type]


# Output


def test_the_json_file(tmp_path: Path) -> None:
    evaluation = evaluate(Constant(1.0, 0.0), [scenario(goal=3.02), scenario(goal=9.0)], sim=SimConfig())
    write_json(tmp_path / "scores.json", evaluation, "runs/0")
    record = json.loads((tmp_path / "scores.json").read_text())
    assert list(record) == ["schema", "policy", "summary", "episodes"]
    assert (record["schema"], record["policy"]) == (1, "runs/0")
    assert record["summary"]["success_rate"] == 0.5
    assert [tuple(episode) for episode in record["episodes"]] == [EPISODE_KEYS] * 2
    first = record["episodes"][0]
    first["total_return"] = first.pop("return")
    assert Episode(**first) == evaluation.episodes[0]


def test_the_table_shows_rates_with_their_intervals() -> None:
    evaluation = evaluate(Constant(1.0, 0.0), [scenario(goal=3.02), scenario(goal=9.0)], sim=SimConfig())
    text = scores_table(evaluation.summary, "default", "td3", Console(width=100))
    # Wilson for 1 of 2: 0.5 +- 0.405 (of the interval 0.0945 to 0.9055)
    for words in ("default on td3, list given: 2 scenarios", "50.00 %", "9.45 to 90.55 %", "5.50 s", "2.75 m"):
        assert words in text, text


# Controllers and functions


def straight(ranges: NDArray[np.float32], goal: Array, velocity: Array) -> Array:
    """As the built-in one."""
    assert ranges.dtype == np.float32
    assert (goal.dtype, velocity.dtype) == (np.float64, np.float64)
    assert ranges.shape == (len(goal), 180)
    return np.stack([np.where(np.abs(goal[:, 1]) < 0.3, 0.5, 0.0), np.clip(2 * goal[:, 1], -1, 1)], axis=1)


def test_a_callable_is_evaluated_as_the_built_in_one() -> None:
    class Straight:
        def command(self, ranges: NDArray[np.float32], goal: Array, velocity: Array) -> Array:
            return straight(ranges, goal, velocity)

    drawn = load_list(SimConfig(), "tuning", count=40)
    expected = evaluate(Controller("straight"), drawn)
    assert evaluate(straight, drawn, sim=SimConfig()) == expected
    assert evaluate(Straight(), drawn, sim=SimConfig()) == expected
    assert 5 < sum(episode.outcome == "goal" for episode in expected.episodes) < 35


def test_a_controller_that_remembers_is_told_which_robots_run() -> None:
    class Counting:
        def __init__(self) -> None:
            self.resets = 0

        def reset(self) -> None:
            self.resets, self.decisions = self.resets + 1, np.zeros(3, int)

        def command(self, ranges: NDArray[np.float32], goal: Array, velocity: Array, robots: NDArray[np.intp]) -> Array:
            self.decisions[robots] += 1
            return np.tile([0.5, 0.0], (len(robots), 1))

    counting = Counting()
    given = [Scenario(start=(0, 0, 0), goal=(5, 0), goal_radius=0.3, time_limit=t) for t in (1.0, 3.0, 2.0)]
    for _ in range(2):
        evaluate(counting, given, sim=SimConfig())
        assert counting.decisions.tolist() == [10, 30, 20]
    assert counting.resets == 2


def test_contenders_that_cannot_be_used_are_refused() -> None:
    given = [Scenario(start=(0, 0, 0), goal=(5, 0), goal_radius=0.3, time_limit=1.0)]
    with pytest.raises(TypeError, match="neither a policy with act nor a controller with command"):
        evaluate("dwa", given, sim=SimConfig())  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"command: expected commands of shape \(1, 2\), got \(2,\)"):
        evaluate(lambda *_: [0.5, 0.0], given, sim=SimConfig())
    with pytest.raises(ValueError, match="actions: expected finite numbers, got NaN for robot 0"):
        evaluate(lambda *_: [[math.nan, 0.0]], given, sim=SimConfig())
    with pytest.raises(PolicyError, match="sim: must be given"):
        evaluate(straight, given)
    with pytest.raises(PolicyError, match=r"task\.period = 0\.2: the controller was made for 0.1"):
        evaluate(Controller("dwa"), given, sim=SimConfig(task=TaskConfig(period=0.2)))
