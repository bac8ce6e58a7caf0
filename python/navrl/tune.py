"""Finds settings of a classical controller: a search with a named budget on the tuning list, and on no other.

    tune("dwa", config, folder, trials=100, episodes=500) -> Tuned
    tune("pursuit+astar", config, folder, trials=100, episodes=500)     the planner's margin with it

The trials stand in FOLDER/study.db (SQLite): the same call continues a search that was cut short, with the trials that
it would have made anyway, and a larger budget extends it. FOLDER/best.toml holds the best settings, for `--config`.
The search is Optuna's tree-structured Parzen estimator (the extra `tune`), from the settings as configured.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

from navrl.batch import config_json
from navrl.comparing.contenders import Contender, enter
from navrl.config import Config
from navrl.config.controllers import TUNABLE
from navrl.config.files import tables_to_toml
from navrl.config.levels import at_level
from navrl.config.searching import Search, searched
from navrl.durable import write_file
from navrl.errors import UserError, shown
from navrl.evaluate import Evaluation, measure
from navrl.metrics import Scores
from navrl.planners import PLANNERS
from navrl.scenarios import ScenarioList, load_list

if TYPE_CHECKING:
    import optuna

FAILURE_COST = 10.0
"""A failure costs so many times the time limit: 1 % of failures weighs as 5 s of a limit of 50 s."""
STUDY_FILE = "study.db"
BEST_FILE = "best.toml"
SEED_STRIDE = 100_003
"""Seeds of the sampler's trials: seed x this + number of the trial."""
END = 0.02
"""A best value nearer to the end of what was searched than this share of it is told."""

Space = dict[str, Search]
"""What is searched, by key path."""


@dataclass(frozen=True)
class Tuned:
    """The best trial of a search."""

    config: Config
    """As given, with the settings as found."""
    trial: int
    """Number of the trial, from 0; 0 is that of the settings as configured."""
    cost_s: float
    """Mean time with FAILURE_COST, seconds."""
    scores: dict[str, Any]
    """Scores on the part of the tuning list that was driven."""
    refused: int
    """Trials of the budget whose settings exclude each other: they were not driven."""
    at_ends: list[str]
    """Settings that lie at the end of what was searched: a wider search may find better ones."""
    cut: int = field(default=0, compare=False)
    """Trials that were interrupted, and made again."""
    cpu_s: float = field(default=0.0, compare=False)
    """CPU time of all trials, seconds."""


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


def tunable(name: str) -> Contender:
    """The contender of that name, if it has settings to search.

    Raises:
        UserError: It has none, or `pursuit` has no planner.
    """
    pilot, plus, planner = name.partition("+")
    if pilot not in TUNABLE or (plus and planner not in PLANNERS):
        raise UserError(
            f"tune: {name}: must be one of {', '.join(TUNABLE)}, with or without + and one of {', '.join(PLANNERS)}"
        )
    return enter(name)


def tune(
    name: str,
    config: Config,
    folder: Path,
    *,
    trials: int,
    episodes: int,
    seed: int = 0,
    num_threads: int = 1,
    command: str = "",
    report: Callable[[str], None] = lambda line: None,
) -> Tuned:
    """Searches the settings of a controller until `trials` trials are done.

    Args:
        name: One of TUNABLE, or one of them, "+" and a planner, whose margin and look-ahead are then searched too.
        config: World, robot, lidar and task to tune for; the settings to begin with, which also hold what is not
            searched. One that lies outside of what is searched widens it.
        folder: Of the study; made if missing, continued if it holds the same search.
        trials: Budget, counted over all calls.
        episodes: Scenarios of each trial, the first of the tuning list.
        seed: Names the search's random numbers.
        num_threads: Threads that step the robots; they do not change results.
        command: What was typed, for the head of BEST_FILE.
        report: Takes one line whenever a trial is the best so far.

    Returns:
        The best trial.

    Raises:
        UserError: Optuna is missing, the folder holds another search, or the list is shorter.
    """
    contender = tunable(name)
    space = _space(contender, config)
    scenarios = load_list(config.sim, "tuning", count=episodes, num_threads=num_threads)
    task = {
        "controller": name,
        "seed": seed,
        "episodes": episodes,
        "sim": config_json(config.sim),
        "first": json.dumps(asdict(config.controllers) | {"planner": asdict(config.planner)}),
        "space": json.dumps({key: asdict(search) for key, search in space.items()}),
        "list_sha256": scenarios.sha256,
    }
    study = _open(folder, task)
    if len(_told(study)) > trials:
        raise UserError(f"{folder}: holds {len(_told(study))} trials already, more than {trials}")
    while (number := len(told := _told(study))) < trials:
        lowest = min((other.value for other in told if other.value is not None), default=math.inf)
        trial = _ask(study, space, config, seed, number)
        begin = process_time()
        evaluation = _drive(contender, config, trial, scenarios, num_threads)
        if study.trials[trial.number].state.is_finished():
            raise UserError(f"{folder}: another process searches there, too")
        trial.set_user_attr("cpu_s", process_time() - begin)
        if evaluation is None:
            study.tell(trial, state=_failed())
            continue
        trial.set_user_attr("scores", evaluation.summary.to_json())
        cost = penalised_time(evaluation, config.task.time_limit)
        study.tell(trial, cost)
        if cost < lowest:
            report(_line(number, trials, cost, evaluation.summary))
            _write(folder, _best(study, space, config), name, space, config, trials, scenarios, seed, command)
    best = _best(study, space, config)
    _write(folder, best, name, space, config, trials, scenarios, seed, command)
    return best


def _space(contender: Contender, config: Config) -> Space:
    """What is searched of the contender's settings, and of its planner's; it holds the settings as configured."""
    tables = [str(contender.pilot)] + ["planner"] * (contender.planner is not None)
    space = {}
    for table in tables:
        for key, search in searched(type(getattr(config, table))).items():
            # `pursuit` has a look-ahead distance of its own.
            own = (table, key, contender.pilot) == ("planner", "lookahead", "pursuit")
            # Without limits every speed is reached at once, and this setting does nothing.
            idle = (table, key) == ("dwa", "interval") and not config.robot.acceleration_max
            if own or idle:
                continue
            value = getattr(getattr(config, table), key)
            if search.log and value <= 0:
                raise UserError(f"{table}.{key} = {value}: a search by powers cannot begin there; choose one above 0")
            number = type(value)
            low, high = number(min(search.low, value)), number(max(search.high, value))
            space[f"{table}.{key}"] = replace(search, low=low, high=high)
    return space


def _drive(
    contender: Contender, config: Config, trial: optuna.Trial, scenarios: ScenarioList, num_threads: int
) -> Evaluation | None:
    """Drives the list with the settings of a trial; nothing if they exclude each other."""
    try:
        tried = _with(config, trial.params)
        plans = list(contender.plans(scenarios.scenarios, config.sim, tried.planner))
        drive = contender.driver(scenarios.scenarios, plans, config.sim, tried.controllers, tried.planner)
    except UserError as error:
        trial.set_user_attr("refused", str(error))
        return None
    return measure(drive, scenarios, config.sim, num_threads=num_threads)


def _open(folder: Path, task: dict[str, Any]) -> optuna.Study:
    try:
        import optuna
        from sqlalchemy.exc import DatabaseError
    except ImportError:
        raise UserError("tune: needs Optuna: pip install 'navrl[tune]'") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    if folder.is_dir() and any(folder.iterdir()) and not (folder / STUDY_FILE).exists():
        raise UserError(f"{folder}: is not empty and holds no search")
    folder.mkdir(parents=True, exist_ok=True)
    storage = f"sqlite:///{(folder / STUDY_FILE).absolute()}"
    try:
        study = optuna.create_study(study_name="tune", storage=storage, direction="minimize", load_if_exists=True)
    except DatabaseError as error:
        raise UserError(f"{folder / STUDY_FILE}: cannot be used: {error.orig}") from None
    for key, value in task.items():
        held = study.user_attrs.get(key, value)
        if held != value:
            where, held, value = _first_difference(key, held, value)
            raise UserError(f"{folder}: holds a search with another {where}: {shown(held)}, not {shown(value)}")
        study.set_user_attr(key, value)
    return study


def _first_difference(key: str, held: object, value: object) -> tuple[str, object, object]:
    """Name and values of the first setting in which two tasks differ, which may be JSON objects."""
    if isinstance(held, str) and isinstance(value, str) and held.startswith("{") and value.startswith("{"):
        held, value, key = json.loads(held), json.loads(value), ""
    while isinstance(held, dict) and isinstance(value, dict):
        inner = next(name for name in {**held, **value} if held.get(name) != value.get(name))
        key, held, value = f"{key}.{inner}".removeprefix("."), held.get(inner), value.get(inner)
    return key, held, value


def _failed() -> optuna.trial.TrialState:
    import optuna

    return optuna.trial.TrialState.FAIL


def _told(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    """The trials that count: those that were driven, and those that were refused."""
    trials = study.get_trials(deepcopy=False)
    return [trial for trial in trials if trial.value is not None or "refused" in trial.user_attrs]


def _ask(study: optuna.Study, space: Space, config: Config, seed: int, number: int) -> optuna.Trial:
    """The next trial: it depends on the seed and the trials that are done, not on interruptions."""
    import optuna

    # Trials that were cut short teach nothing.
    for cut in study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.RUNNING,)):
        study.tell(cut.number, state=_failed())
    waiting = study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.WAITING,))
    if number == 0 and not waiting:
        study.enqueue_trial(_values(config, space))
    study.sampler = optuna.samplers.TPESampler(seed=seed * SEED_STRIDE + number)
    return study.ask({key: _distribution(search) for key, search in space.items()})


def _distribution(search: Search) -> optuna.distributions.BaseDistribution:
    import optuna

    if isinstance(search.low, int) and isinstance(search.high, int):
        return optuna.distributions.IntDistribution(search.low, search.high, log=search.log)
    return optuna.distributions.FloatDistribution(search.low, search.high, log=search.log)


def _values(config: Config, space: Space) -> dict[str, float]:
    """The settings of a configuration that are searched."""
    return {key: getattr(getattr(config, key.partition(".")[0]), key.partition(".")[2]) for key in space}


def _with(config: Config, values: dict[str, float]) -> Config:
    for path, value in values.items():
        table, _, key = path.partition(".")
        # Four digits say all that a search can know.
        rounded = value if isinstance(value, int) else float(f"{value:.4g}")
        config = replace(config, **{table: replace(getattr(config, table), **{key: rounded})})
    return config


def _best(study: optuna.Study, space: Space, config: Config) -> Tuned:
    told = _told(study)
    driven = [trial for trial in told if trial.value is not None]
    if not driven:
        raise UserError(f"tune: no trial could be driven: {told[-1].user_attrs['refused']}")
    best = study.best_trial
    assert best.value is not None
    every = study.get_trials(deepcopy=False)
    return Tuned(
        config=_with(config, best.params),
        trial=[trial.number for trial in told].index(best.number),
        cost_s=best.value,
        scores=best.user_attrs["scores"],
        refused=sum(trial.value is None for trial in told),
        at_ends=[key for key, search in space.items() if _at_end(best.params[key], search)],
        cut=len(every) - len(told),
        # A trial that was refused may have been cut short after that was noted.
        cpu_s=sum(trial.user_attrs.get("cpu_s", 0.0) for trial in told),
    )


def _at_end(value: float, search: Search) -> bool:
    low, high, place = ((math.log(x) if search.log else x) for x in (search.low, search.high, value))
    return not END <= (place - low) / (high - low) <= 1 - END


def _write(
    folder: Path,
    best: Tuned,
    name: str,
    space: Space,
    config: Config,
    trials: int,
    scenarios: ScenarioList,
    seed: int,
    command: str,
) -> None:
    """Writes the best settings, and above them how they were found."""
    world = config.world.name + (f" with {config.world.boxes} boxes" if config.world.name == "boxes" else "")
    level = "real" if at_level(config, "real") == config else "ideal"
    low, high = best.scores["success_ci95"]
    first = _values(config, space)
    lines = [
        command or f"navrl.tune.tune({name!r}, ...)",
        f"trial {best.trial} of {trials}, {best.cpu_s:.0f} s of CPU, seed {seed}, each on the first {len(scenarios)}"
        " scenarios of the tuning list of",
        f"{world}, level {level}: success {best.scores['success_rate']:.4f} [{low:.4f}, {high:.4f}],"
        f" SPL {best.scores['spl']:.3f}, cost {best.cost_s:.2f} s",
        f"not counted: {best.cut} cut short; refused as settings that exclude each other: {best.refused}",
        "it began with, and searched:",
        *(f"  {key} = {first[key]}, {s.low} to {s.high}{' by powers' * s.log}" for key, s in space.items()),
        *(f"at the end of what was searched: {key}" for key in best.at_ends),
    ]
    head = "".join(f"# {line}\n" for line in lines)
    tables = {key.partition(".")[0]: None for key in space}
    found = tables_to_toml({table: asdict(getattr(best.config, table)) for table in tables})
    write_file(folder / BEST_FILE, (head + found).encode())


def _line(number: int, trials: int, cost: float, scores: Scores) -> str:
    success = f"success {100 * scores.success_rate:.1f} %, SPL {scores.spl:.3f}"
    return f"trial {number} of {trials}: {success}, cost {cost:.2f} s  best"
