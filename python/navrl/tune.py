"""Finds settings of a classical controller: a search with a named budget on the tuning list, and on no other.

    tune("dwa", config, folder, trials=100, episodes=500) -> Tuned

The trials stand in FOLDER/study.db (SQLite): the same call continues a search that was cut short, with the trials that
it would have made anyway, and a larger budget extends it. FOLDER/best.toml holds the best settings, for `--config`.
The search is Optuna's tree-structured Parzen estimator (the extra `tune`), from the settings as configured.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navrl.batch import config_json
from navrl.config import Config, ControllersConfig
from navrl.config.controllers import Tunable, searched
from navrl.config.files import tables_to_toml
from navrl.controllers import Controller
from navrl.durable import write_file
from navrl.errors import UserError, shown
from navrl.evaluate import Evaluation, evaluate
from navrl.metrics import Scores
from navrl.scenarios import load_list

if TYPE_CHECKING:
    import optuna

FAILURE_COST = 10.0
"""A failure costs so many times the time limit: 1 % of failures weighs as 5 s of a limit of 50 s."""
STUDY_FILE = "study.db"
BEST_FILE = "best.toml"
SEED_STRIDE = 100_003
"""Seeds of the sampler's trials: seed x this + number of the trial."""


@dataclass(frozen=True)
class Tuned:
    """The best trial of a search."""

    settings: ControllersConfig
    """All settings, with the table of the controller as found."""
    trial: int
    """Number of the trial, from 0; 0 is that of the settings as configured."""
    cost_s: float
    """Mean time with FAILURE_COST, seconds."""
    scores: dict[str, Any]
    """Scores on the part of the tuning list that was driven."""


def penalised_time(evaluation: Evaluation, time_limit: float) -> float:
    """What the search makes small: the mean time to the goal, where a failure counts FAILURE_COST time limits.

    Args:
        evaluation: Episodes.
        time_limit: Longest episode, seconds.

    Returns:
        Seconds.
    """
    failure = FAILURE_COST * time_limit
    times = [e.time_s if e.outcome == "goal" else failure for e in evaluation.episodes]
    return math.fsum(times) / len(times)


def tune(
    name: Tunable,
    config: Config,
    folder: Path,
    *,
    trials: int,
    episodes: int,
    seed: int = 0,
    num_threads: int = 1,
    report: Callable[[str], None] = lambda line: None,
) -> Tuned:
    """Searches the settings of a controller until `trials` trials are done.

    Args:
        name: One of TUNABLE.
        config: World, robot, lidar and task to tune for; the settings to begin with, which also hold what is not
            searched.
        folder: Of the study; made if missing, continued if it holds the same search.
        trials: Budget, counted over all calls.
        episodes: Scenarios of each trial, the first of the tuning list.
        seed: Names the search's random numbers.
        num_threads: Threads that step the robots; they do not change results.
        report: Takes one line whenever a trial is the best so far.

    Returns:
        The best trial.

    Raises:
        UserError: Optuna is missing, the folder holds another search, or the list is shorter.
    """
    scenarios = load_list(config.sim, "tuning", count=episodes, num_threads=num_threads)
    task = {
        "controller": name,
        "list_sha256": scenarios.sha256,
        "seed": seed,
        "first": json.dumps(asdict(config.controllers)),
        "sim": config_json(config.sim),
    }
    study = _open(folder, task)
    while True:
        done = [trial for trial in study.trials if trial.value is not None]
        if len(done) >= trials:
            break
        trial = _ask(study, name, config, seed, len(done))
        settings = _with(config.controllers, name, trial.params)
        controller = Controller(name, config.sim, settings)
        evaluation = evaluate(controller, scenarios, sim=config.sim, num_threads=num_threads)
        cost = penalised_time(evaluation, config.task.time_limit)
        trial.set_user_attr("scores", evaluation.summary.to_json())
        study.tell(trial, cost)
        if not done or cost < min(other.value for other in done if other.value is not None):
            report(_line(len(done), trials, cost, evaluation.summary))
            best = _best(study, name, config)
            write_file(folder / BEST_FILE, _best_toml(best, name, config, len(done) + 1, episodes, seed).encode())
    best = _best(study, name, config)
    write_file(folder / BEST_FILE, _best_toml(best, name, config, len(done), episodes, seed).encode())
    return best


def _open(folder: Path, task: dict[str, Any]) -> optuna.Study:
    try:
        import optuna
        from sqlalchemy.exc import DatabaseError
    except ImportError:
        raise UserError("tune: needs Optuna: pip install 'navrl[tune]'") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    folder.mkdir(parents=True, exist_ok=True)
    storage = f"sqlite:///{(folder / STUDY_FILE).absolute()}"
    try:
        study = optuna.create_study(study_name="tune", storage=storage, direction="minimize", load_if_exists=True)
    except DatabaseError as error:
        raise UserError(f"{folder / STUDY_FILE}: damaged, or of something else: {error.orig}") from None
    for key, value in task.items():
        held = study.user_attrs.get(key, value)
        if held != value:
            raise UserError(f"{folder}: holds a search with another {key}: {shown(held)}, not {shown(value)}")
        study.set_user_attr(key, value)
    return study


def _ask(study: optuna.Study, name: Tunable, config: Config, seed: int, number: int) -> optuna.Trial:
    """The next trial: it depends on the seed and the trials that are done, not on interruptions."""
    import optuna

    space = searched(name)
    # Trials that were cut short teach nothing.
    for cut in study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.RUNNING,)):
        study.tell(cut.number, state=optuna.trial.TrialState.FAIL)
    if number == 0:
        first = asdict(getattr(config.controllers, name))
        study.enqueue_trial({key: min(max(first[key], s.low), s.high) for key, s in space.items()})
    study.sampler = optuna.samplers.TPESampler(seed=seed * SEED_STRIDE + number)
    return study.ask(
        {key: optuna.distributions.FloatDistribution(s.low, s.high, log=s.log) for key, s in space.items()}
    )


def _with(settings: ControllersConfig, name: Tunable, values: dict[str, float]) -> ControllersConfig:
    # Four digits say all that a search can know.
    rounded = {key: float(f"{value:.4g}") for key, value in values.items()}
    return replace(settings, **{name: replace(getattr(settings, name), **rounded)})


def _best(study: optuna.Study, name: Tunable, config: Config) -> Tuned:
    best, done = study.best_trial, [trial.number for trial in study.trials if trial.value is not None]
    assert best.value is not None
    settings = _with(config.controllers, name, best.params)
    return Tuned(settings, done.index(best.number), best.value, best.user_attrs["scores"])


def _best_toml(best: Tuned, name: Tunable, config: Config, trials: int, episodes: int, seed: int) -> str:
    world = config.world.name + (f" with {config.world.boxes} boxes" if config.world.name == "boxes" else "")
    low, high = best.scores["success_ci95"]
    return (
        f"# navrl tune {name}: trial {best.trial} of {trials}, seed {seed}, each on the first {episodes} scenarios of\n"
        f"# the tuning list of {world}: success {best.scores['success_rate']:.4f} [{low:.4f}, {high:.4f}],"
        f" SPL {best.scores['spl']:.3f}, cost {best.cost_s:.2f} s\n"
        + tables_to_toml({name: asdict(getattr(best.settings, name))})
    )


def _line(number: int, trials: int, cost: float, scores: Scores) -> str:
    success = f"success {100 * scores.success_rate:.1f} %, SPL {scores.spl:.3f}"
    return f"trial {number} of {trials}: {success}, cost {cost:.2f} s  best"
