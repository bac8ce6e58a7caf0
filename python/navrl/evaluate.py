"""The one evaluator: every scenario of a fixed list exactly once, without exploration noise (equation 13).

    evaluate(policy, "test") -> Evaluation;  evaluate(policy, scenario_list, sim=..., num_threads=2)
    evaluate(Controller("dwa"), "test");  evaluate(my_controller, "test", sim=SimConfig())
    evaluate(policy, "test", brake=0.02)        with `navrl.braking` between it and the robot

Training, `navrl eval` and `navrl compare` call it, so that they agree episode by episode. The scenario's place in the
list names its lidar noise: a result depends neither on threads nor on how many scenarios run beside it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from navrl import _navsim, braking
from navrl.batch import BatchSim, Scenario
from navrl.config import SimConfig
from navrl.controllers import Command, Commander, Controller, Remembering
from navrl.durable import write_file
from navrl.machine import cores
from navrl.metrics import OUTCOMES, RUNNING, Episode, Scores, summarize
from navrl.motion import Motion
from navrl.policy import Policy
from navrl.policy_description import ROBOT_KEYS, SIZES, PolicyDescription, PolicyError
from navrl.scenarios import ScenarioList, given_list, load_list, robot_radius

if TYPE_CHECKING:
    from rich.console import Console

    from navrl.batch import Split

SCHEMA = 1
"""Version of the JSON file."""
CLEARANCE_MAX = 1000.0
"""What the simulator calls the clearance (m) of a robot that has no obstacle around it."""
EVALUATION_SEED = 0
"""Seed of the lidar's noise; the streams of given scenarios are apart from those of training."""


@runtime_checkable
class Actor(Protocol):
    """A policy, or anything that acts on observations."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (N, 2) float32 in [-1, 1] for observations (N, bins + 4) float32."""


Pilot = Actor | Command | Commander | Remembering
"""What can drive: policies, and controllers as functions or as objects with a method `command`."""
Driver = Callable[[BatchSim, NDArray[np.intp]], NDArray[np.float32]]
"""From a simulator and the robots that still run to their actions (N, 2) float32 in [-1, 1]."""
Towards = Callable[[BatchSim, NDArray[np.intp]], NDArray[np.float64]]
"""From a simulator and the robots that still run to where they are led: distance (m) and angle (rad), (N, 2)."""


@dataclass(frozen=True)
class Evaluation:
    """How a pilot did on a list."""

    summary: Scores
    """Rates, intervals and means."""
    episodes: list[Episode]
    """One record for each scenario, in the order of the list."""
    tracks: list[NDArray[np.float32]] = field(default_factory=list, compare=False, repr=False)
    """Where the robot was after each step of each scenario: (steps, 3) x, y, yaw (m, m, rad)."""

    def to_json(self, policy: str) -> dict[str, Any]:
        """The record of `navrl eval --json`.

        Args:
            policy: Name of the policy.

        Returns:
            Schema, policy, summary and episodes.
        """
        episodes = [episode.to_json() for episode in self.episodes]
        return {"schema": SCHEMA, "policy": policy, "summary": self.summary.to_json(), "episodes": episodes}


def evaluate(
    pilot: Pilot,
    scenarios: ScenarioList | Split | Sequence[Scenario] = "test",
    *,
    sim: SimConfig | None = None,
    num_threads: int = 0,
    brake: float | None = None,
) -> Evaluation:
    """Runs every scenario of a list exactly once.

    Args:
        pilot: What drives: a policy, a controller, or a callable with a controller's signature.
        scenarios: A list, the purpose of a built-in one, or scenarios one by one.
        sim: Robot, lidar and task, and the world of a built-in list; the pilot's if None, for a policy in "td3".
        num_threads: Threads that step the robots, 0 for all cores; they do not change results.
        brake: Margin (m) of `navrl.braking.brake`, through which the pilot's commands pass; None for as they are.

    Returns:
        Scores and episodes.

    Raises:
        PolicyError: The pilot is for another robot, lidar or period than `sim` has, or `sim` is missing.
        ScenarioError: There is no such list, it is empty, or the robot cannot run one of its scenarios.
        TypeError: The pilot has neither of the methods `act` and `command`, nor can it be called.
        ValueError: It returned actions or commands of another shape, or NaN; a brake for a robot that is not round,
            or with a margin out of range.
    """
    own = own_sim(pilot)
    if sim is None:
        if own is None:
            raise PolicyError("sim: must be given for a policy without a description of its robot")
        sim = own
    elif own is not None:
        check_same(own, sim, pilot)
    if brake is not None:
        braking.check(sim, brake)
    threads = num_threads or cores()
    if isinstance(scenarios, str):
        scenarios = load_list(sim, scenarios, num_threads=threads)
    elif not isinstance(scenarios, ScenarioList):
        scenarios = given_list(scenarios, sim, num_threads=threads)
    # A class made from Policy may act otherwise, and need not bear several threads.
    if type(pilot) is Policy:
        return _in_shares(pilot, scenarios, sim, threads, brake)
    return measure(_braked(driver(pilot, sim), sim, brake), scenarios, sim, num_threads=threads)


def _in_shares(
    policy: Policy, scenarios: ScenarioList, sim: SimConfig, threads: int, brake: float | None
) -> Evaluation:
    """Measures a policy on a share of the list in each thread."""

    def drive_share(share: NDArray[np.intp]) -> Evaluation:
        first, end, lines = int(share[0]), int(share[-1]) + 1, scenarios.lines
        kept = replace(
            scenarios,
            scenarios=scenarios.scenarios[first:end],
            shortest=scenarios.shortest[first:end],
            lines=lines and lines[first:end],
        )
        # Threads that ask one and the same policy wait for each other.
        own = Policy(policy.weights, policy.description)
        return measure(_braked(driver(own, sim), sim, brake), kept, sim, num_threads=1, first=first)

    shares = np.array_split(np.arange(len(scenarios)), min(threads, len(scenarios)))
    # The limit is the process's: set around all threads, none of them can restore another one's.
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(len(shares)) as pool:
        parts = list(pool.map(drive_share, shares))
    episodes = [episode for part in parts for episode in part.episodes]
    tracks = [track for part in parts for track in part.tracks]
    return Evaluation(summarize(scenarios.name, scenarios.sha256, episodes), episodes, tracks)


def measure(drive: Driver, scenarios: ScenarioList, sim: SimConfig, *, num_threads: int, first: int = 0) -> Evaluation:
    """Drives each scenario of a list until it ends.

    Args:
        drive: What drives.
        scenarios: Robot k runs scenario k.
        sim: Robot, lidar and task.
        num_threads: Threads that step the robots.
        first: Place of the first scenario in the list of which these are a part.

    Returns:
        Scores and episodes.

    Raises:
        ValueError: `drive` returned actions of another shape, or NaN.
    """
    simulator = BatchSim(
        sim,
        num_envs=len(scenarios),
        seed=EVALUATION_SEED,
        num_threads=num_threads,
        autoreset=False,
        scenarios=scenarios.scenarios,
        first=first,
    )
    motion = Motion(len(scenarios), sim.task.period)
    for moved in steps(drive, simulator, np.arange(len(scenarios))):
        motion.observe(simulator, moved)
    episodes = _episodes(simulator, motion, scenarios, sim, first)
    return Evaluation(summarize(scenarios.name, scenarios.sha256, episodes), episodes, motion.tracks())


def steps(drive: Driver, simulator: BatchSim, running: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Drives robots until the episode of each has ended, period by period.

    Args:
        drive: What drives.
        simulator: Without autoreset, all robots at their starts.
        running: The robots to drive; others stand still.

    Yields:
        The robots that have just made a step.

    Raises:
        ValueError: `drive` returned actions of another shape, or NaN.
    """
    actions = np.zeros((len(simulator.outcome), 2), np.float32)
    with threadpool_limits(1, user_api="blas"):
        while running.size:
            actions[running] = drive(simulator, running)
            simulator.step(actions)
            yield running
            running = running[simulator.outcome[running] == RUNNING]


def driver(pilot: Pilot, sim: SimConfig, *, towards: Towards | None = None) -> Driver:
    """How any pilot drives: a policy by observations, a controller by ranges, goal and velocity.

    Args:
        pilot: A policy, a controller, or a callable with a controller's signature. What it remembers is forgotten.
        sim: Robot and lidar.
        towards: What it is led to in place of its goal; None for the goal.

    Returns:
        The function that the evaluator calls in every period.

    Raises:
        TypeError: The pilot has neither of the methods `act` and `command`, nor can it be called.
    """
    if isinstance(pilot, Actor):
        act = pilot.act

        def by_observations(simulator: BatchSim, running: NDArray[np.intp]) -> NDArray[np.float32]:
            seen = _observations(simulator, running, towards)
            actions = _checked("act", "actions", act(seen), running)
            return np.asarray(actions, np.float32)

        return by_observations
    if isinstance(pilot, Remembering):
        pilot.reset()
        return _by_command(pilot.command, sim, towards, with_robots=True)
    command = getattr(pilot, "command", pilot)
    if not callable(command):
        raise TypeError(f"{type(pilot).__name__}: neither a policy with act nor a controller with command")
    return _by_command(command, sim, towards, with_robots=False)


def _braked(drive: Driver, sim: SimConfig, margin: float | None) -> Driver:
    """The same through the brake, if there is one."""
    if margin is None:
        return drive
    v_max, omega_max = sim.robot.v_max, sim.robot.omega_max

    def drive_braked(simulator: BatchSim, running: NDArray[np.intp]) -> NDArray[np.float32]:
        actions = np.clip(drive(simulator, running), -1.0, 1.0)
        # Eq. 6, and back for those alone that are to be slower
        commands = np.stack([v_max * (actions[:, 0] + 1.0) / 2, omega_max * actions[:, 1]], axis=1)
        slower = braking.brake(commands, simulator.ranges[running], simulator.velocities[running], sim, margin)
        rows = slower[:, 0] < commands[:, 0]
        actions[rows, 0] = 2 * slower[rows, 0] / v_max - 1
        return actions

    return drive_braked


def _observations(simulator: BatchSim, running: NDArray[np.intp], towards: Towards | None) -> NDArray[np.float32]:
    """(N, bins + 4) what the robots observe, with the goal's distance and angle where they are led."""
    seen = simulator.observations[running]
    if towards is not None:
        seen[:, -4:-2] = towards(simulator, running)
    return seen


def _by_command(
    command: Callable[..., ArrayLike], sim: SimConfig, towards: Towards | None, *, with_robots: bool
) -> Driver:
    bins, largest = sim.lidar.bins, np.array([sim.robot.v_max, sim.robot.omega_max])

    def drive(simulator: BatchSim, running: NDArray[np.intp]) -> NDArray[np.float32]:
        # The goal as the robot knows it: distance and angle behind the bins of its observation.
        goal = _observations(simulator, running, towards)[:, bins : bins + 2].astype(np.float64)
        known = (simulator.ranges[running], goal, simulator.velocities[running])
        commands = command(*known, running) if with_robots else command(*known)
        # Eq. 6 backwards: a1 = 2 v / v_max - 1, a2 = omega / omega_max
        actions = _checked("command", "commands", commands, running) / largest * [2.0, 1.0] - [1.0, 0.0]
        return np.asarray(actions, np.float32)

    return drive


def _checked(method: str, noun: str, answer: ArrayLike, running: NDArray[np.intp]) -> NDArray[np.floating]:
    array, expected = np.asarray(answer), (len(running), 2)
    if array.shape != expected:
        raise ValueError(f"{method}: expected {noun} of shape {expected}, got {array.shape}")
    return array


def own_sim(pilot: Pilot) -> SimConfig | None:
    """The simulator that the pilot belongs to, if it says."""
    description, sim = getattr(pilot, "description", None), getattr(pilot, "sim", None)
    if isinstance(description, PolicyDescription):
        return description.sim_config()
    return sim if isinstance(sim, SimConfig) else None


def check_same(own: SimConfig, sim: SimConfig, pilot: Pilot, *, apart_from: Sequence[str] = ()) -> None:
    """Refuses a pilot for another robot with the first difference in limits, footprint, lidar or period.

    Args:
        own: What the pilot is for.
        sim: What it is to drive.
        pilot: The pilot.
        apart_from: Keys of the robot that may differ.

    Raises:
        PolicyError: There is a difference.
    """
    made_for = "the controller was made for" if isinstance(pilot, Controller) else "the policy was trained for"
    sizes = SIZES[own.robot.footprint]
    for table, keys in (
        ("robot", (*ROBOT_KEYS, "footprint", *sizes)),
        ("lidar", ("bins", "fov", "beams", "range_min", "range_max", "mount")),
        ("task", ("period",)),
    ):
        for key in keys:
            trained, asked = (getattr(getattr(config, table), key) for config in (own, sim))
            if trained != asked and key not in apart_from:
                raise PolicyError(f"{table}.{key} = {asked}: {made_for} {trained}")


def _episodes(
    simulator: BatchSim, motion: Motion, scenarios: ScenarioList, sim: SimConfig, first: int
) -> list[Episode]:
    radius, period, steps = robot_radius(sim), sim.task.period, simulator.episode_steps.tolist()
    # The fields of an episode in their order.
    columns = (
        [OUTCOMES[outcome] for outcome in simulator.outcome.tolist()],
        steps,
        # The nearest decimal: 179 x 0.1 s are 17.9 s.
        [round(count * period, 9) for count in steps],
        simulator.episode_path.tolist(),
        scenarios.shortest.tolist(),
        simulator.episode_returns.tolist(),
        _clearances(simulator.episode_clearance),
        scenarios.lines or [None] * len(scenarios),
        _clearances(motion.clearance(5)),
        motion.jerk().tolist(),
        motion.omega_change().tolist(),
        motion.turning_share().tolist(),
        [_navsim.needs_detour(scenario, radius) for scenario in scenarios.scenarios],
    )
    return [Episode(index, *row) for index, row in enumerate(zip(*columns, strict=True), start=first)]


def _clearances(values: NDArray[np.float64]) -> list[float | None]:
    return [value if value < CLEARANCE_MAX else None for value in values.tolist()]


def scores_table(scores: Scores, policy: str, world: str, console: Console) -> str:
    """Scores as a line and a small table, to be printed.

    Args:
        scores: What to show.
        policy: Name of the policy.
        world: Name of the world or file.
        console: Whose width and colours it has.
    """
    from rich.table import Table

    # "-" stands where a mean has nothing to be taken over.
    def shown(value: float | None, unit: str) -> str:
        return "-" if value is None else f"{value:.2f} {unit}"

    which = "" if scores.list == world else f", list {scores.list}"
    table = Table()
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_column("95 % interval", justify="right")
    for name, rate, (low, high) in (
        ("success", scores.success_rate, scores.success_ci95),
        ("collision", scores.collision_rate, scores.collision_ci95),
        ("time-out", scores.timeout_rate, scores.timeout_ci95),
    ):
        table.add_row(name, f"{100 * rate:.2f} %", f"{100 * low:.2f} to {100 * high:.2f} %")
    table.add_row("SPL", f"{scores.spl:.3f}", "")
    table.add_row("return", f"{scores.average_return:.1f}", "")
    table.add_row("time to goal", shown(scores.time_to_goal_s, "s"), "")
    table.add_row("path length", shown(scores.path_length_m, "m"), "")
    table.add_row("smallest clearance", shown(scores.min_clearance_m, "m"), "")
    # As text, for a console that prints ends the process when its reader has gone.
    with console.capture() as capture:
        console.print(f"{policy} on {world}{which}: {scores.episodes:,} scenarios", soft_wrap=True, highlight=False)
        console.print(table)
    return capture.get()


def write_json(file: Path, evaluation: Evaluation, policy: str) -> None:
    """Writes the record of `navrl eval --json`.

    Args:
        file: Where to, in a folder that exists.
        evaluation: What to write.
        policy: Name of the policy.
    """
    write_file(file, (json.dumps(evaluation.to_json(policy), indent=2) + "\n").encode())
