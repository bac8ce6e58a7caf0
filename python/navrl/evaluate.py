"""The one evaluator: every scenario of a fixed list exactly once, without exploration noise (equation 13).

    evaluate(policy, "test") -> Evaluation;  evaluate(policy, scenario_list, sim=..., num_threads=2)

Training, `navrl eval` and comparisons call it, so that they agree episode by episode. The scenario's place in the list
names its lidar noise: a result depends neither on threads nor on how many scenarios run beside it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from navrl.batch import BatchSim, Scenario
from navrl.config import SimConfig
from navrl.durable import write_file
from navrl.machine import cores
from navrl.metrics import OUTCOMES, RUNNING, Episode, Scores, summarize
from navrl.policy_description import ROBOT_KEYS, SIZES, PolicyDescription, PolicyError
from navrl.scenarios import ScenarioList, given_list, load_list

if TYPE_CHECKING:
    from rich.console import Console

    from navrl.batch import Split

SCHEMA = 1
"""Version of the JSON file."""
CLEARANCE_MAX = 1000.0
"""What the simulator calls the clearance (m) of a robot that has no obstacle around it."""
EVALUATION_SEED = 0
"""Seed of the lidar's noise; the streams of given scenarios are apart from those of training."""


class Actor(Protocol):
    """What can be evaluated: a policy, or anything that acts on observations."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (N, 2) float32 in [-1, 1] for observations (N, bins + 4) float32."""


@dataclass(frozen=True)
class Evaluation:
    """How a policy did on a list."""

    summary: Scores
    """Rates, intervals and means."""
    episodes: list[Episode]
    """One record for each scenario, in the order of the list."""

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
    policy: Actor,
    scenarios: ScenarioList | Split | Sequence[Scenario] = "test",
    *,
    sim: SimConfig | None = None,
    num_threads: int = 0,
) -> Evaluation:
    """Runs every scenario of a list exactly once.

    Args:
        policy: What drives.
        scenarios: A list, the purpose of a built-in one, or scenarios one by one.
        sim: Robot, lidar and task, and the world of a built-in list; those of the policy in "td3" if None.
        num_threads: Threads that step the robots, 0 for all cores; they do not change results.

    Returns:
        Scores and episodes.

    Raises:
        PolicyError: The policy was trained for another robot, lidar or period than `sim` has, or `sim` is missing.
        ScenarioError: There is no such list, it is empty, or the robot cannot run one of its scenarios.
        ValueError: The policy returned actions of another shape.
    """
    description = getattr(policy, "description", None)
    if sim is None:
        if not isinstance(description, PolicyDescription):
            raise PolicyError("sim: must be given for a policy without a description of its robot")
        sim = description.sim_config()
    elif isinstance(description, PolicyDescription):
        check_fits(description, sim)
    threads = num_threads or cores()
    if isinstance(scenarios, str):
        scenarios = load_list(sim, scenarios, num_threads=threads)
    elif not isinstance(scenarios, ScenarioList):
        scenarios = given_list(scenarios, sim, num_threads=threads)
    with threadpool_limits(1, user_api="blas"):
        simulator = run_to_end(policy, scenarios.scenarios, sim, num_threads=threads)
    episodes = _episodes(simulator, scenarios, sim.task.period)
    return Evaluation(summarize(scenarios.name, scenarios.sha256, episodes), episodes)


def run_to_end(policy: Actor, scenarios: Sequence[Scenario], sim: SimConfig, *, num_threads: int) -> BatchSim:
    """Drives each scenario until it ends.

    Args:
        policy: What drives.
        scenarios: Robot k runs scenario k.
        sim: Robot, lidar and task.
        num_threads: Threads that step the robots.

    Returns:
        The simulator, in which every robot has ended its episode.
    """
    simulator = BatchSim(
        sim,
        num_envs=len(scenarios),
        seed=EVALUATION_SEED,
        num_threads=num_threads,
        autoreset=False,
        scenarios=scenarios,
    )
    actions = np.zeros((len(scenarios), 2), np.float32)
    running = np.arange(len(scenarios))
    while running.size:
        actions[running] = _actions(policy, simulator.observations[running])
        simulator.step(actions)
        running = running[simulator.outcome[running] == RUNNING]
    return simulator


def _actions(policy: Actor, observations: NDArray[np.float32]) -> NDArray[np.float32]:
    actions, expected = np.asarray(policy.act(observations)), (len(observations), 2)
    if actions.shape != expected:
        raise ValueError(f"act: expected actions of shape {expected}, got {actions.shape}")
    return actions


def check_fits(description: PolicyDescription, sim: SimConfig) -> None:
    """Refuses to let a policy drive a robot that it was not trained for.

    Args:
        description: What the policy was trained for.
        sim: What it is to drive.

    Raises:
        PolicyError: Names the first difference in limits, footprint, lidar or period.
    """
    own = description.sim_config()
    sizes = SIZES[own.robot.footprint]
    for table, keys in (
        ("robot", (*ROBOT_KEYS, "footprint", *sizes)),
        ("lidar", ("bins", "fov", "beams", "range_min", "range_max", "mount")),
        ("task", ("period",)),
    ):
        for key in keys:
            trained, asked = (getattr(getattr(config, table), key) for config in (own, sim))
            if trained != asked:
                raise PolicyError(f"{table}.{key} = {asked}: the policy was trained for {trained}")


def _episodes(simulator: BatchSim, scenarios: ScenarioList, period: float) -> list[Episode]:
    records = zip(
        simulator.outcome.tolist(),
        simulator.episode_steps.tolist(),
        simulator.episode_path.tolist(),
        simulator.episode_returns.tolist(),
        simulator.episode_clearance.tolist(),
        scenarios.shortest.tolist(),
        scenarios.lines or [None] * len(scenarios),
        strict=True,
    )
    return [
        Episode(
            index=index,
            outcome=OUTCOMES[outcome],
            steps=steps,
            # The nearest decimal: 179 x 0.1 s are 17.9 s.
            time_s=round(steps * period, 9),
            path_m=path,
            shortest_m=shortest,
            total_return=total_return,
            min_clearance_m=clearance if clearance < CLEARANCE_MAX else None,
            line=line,
        )
        for index, (outcome, steps, path, total_return, clearance, shortest, line) in enumerate(records)
    ]


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
