"""Settings that exclude each other: what no range of a single setting can say.

Each line of the checks reads: refuse this key, unless it is as allowed.
"""

from math import sqrt
from operator import attrgetter
from typing import TYPE_CHECKING

from navrl.errors import ConfigError, shown
from navrl.symmetry import why_asymmetric

if TYPE_CHECKING:
    from navrl.config import Config, SimConfig

LEAST_GOAL_DISTANCE = {"td3": 1.0, "boxes": 2.0, "open8": 1.0, "walls": 1.0, "mixed": 2.0}
"""How far goals lie from the start at least (m). World files may differ: the core checks them when it reads them."""
MOST_STEPS = 1_000_000


def _require(config: "SimConfig | Config", key: str, allowed: bool, expected: str, *others: str) -> None:
    """Refuses the setting `key` unless it is allowed; `others` are the settings that it clashes with."""
    if not allowed:
        raise ConfigError(f"{key} = {shown(attrgetter(key)(config))}: must be {expected}", keys=(key, *others))


def check_sim(config: "SimConfig | Config") -> None:
    """Checks the tables of the simulator against each other.

    Raises:
        ConfigError: with the first combination that cannot be.
    """
    world, lidar, task = config.world, config.lidar, config.task
    start, most = world.goal_range_start, world.goal_range_max
    # A goal at the end of both axes' range is sqrt(2) times as far.
    least = LEAST_GOAL_DISTANCE.get(world.name, 0.0)
    expected = f"above {least / sqrt(2):.4f}: in this world goals are at least {least} m away"
    _require(config, "world.goal_range_start", start * sqrt(2) > least, expected, "world.name")
    expected = f"at least goal_range_start = {start}"
    _require(config, "world.goal_range_max", most >= start, expected, "world.goal_range_start")

    nearest, farthest = lidar.range_min, lidar.range_max
    _require(config, "lidar.range_min", nearest < farthest, f"below range_max = {farthest}", "lidar.range_max")
    expected = f"at most beams = {lidar.beams}: every bin needs a beam"
    _require(config, "lidar.bins", lidar.bins <= lidar.beams, expected, "lidar.beams")

    periods = task.time_limit / task.period
    expected = f"1 to {MOST_STEPS} periods of {task.period} s"
    _require(config, "task.time_limit", 0.5 <= periods <= MOST_STEPS, expected, "task.period")
    if task.collision == "sensor":
        seen = nearest < task.sensor_range < farthest
        expected = f"between lidar.range_min = {nearest} and lidar.range_max = {farthest}"
        others = ("task.collision", "lidar.range_min", "lidar.range_max")
        _require(config, "task.sensor_range", seen, expected, *others)


def check_config(config: "Config") -> None:
    """Checks all tables against each other.

    Raises:
        ConfigError: with the first combination that cannot be.
    """
    check_sim(config)
    _check_length(config)
    _check_exploration(config)
    _check_replay(config)
    if config.learner.mirror:
        _check_mirror(config)


def _check_length(config: "Config") -> None:
    training = config.training
    ends = training.steps > 0 or training.episodes > 0
    expected = "at least 1, unless training.episodes is set"
    _require(config, "training.steps", ends, expected, "training.episodes")
    if training.update_schedule == "per_episode":
        expected = '1 with update_schedule = "per_episode"'
        _require(config, "training.num_envs", training.num_envs == 1, expected, "training.update_schedule")


def _check_exploration(config: "Config") -> None:
    noise, lidar = config.exploration, config.lidar
    if noise.schedule == "spread":
        rising = noise.sigma_min <= noise.sigma_max
        expected = f"at most sigma_max = {noise.sigma_max}"
        _require(config, "exploration.sigma_min", rising, expected, "exploration.sigma_max")
    else:
        falling = noise.sigma_end <= noise.sigma_start
        expected = f"at most sigma_start = {noise.sigma_start}"
        _require(config, "exploration.sigma_end", falling, expected, "exploration.sigma_start")
    if noise.forced:
        rising = noise.forced_steps_min <= noise.forced_steps_max
        expected = f"at most forced_steps_max = {noise.forced_steps_max}"
        _require(config, "exploration.forced_steps_min", rising, expected, "exploration.forced_steps_max")
        seen = lidar.range_min < noise.forced_range <= lidar.range_max
        expected = f"above lidar.range_min = {lidar.range_min} and at most lidar.range_max = {lidar.range_max}"
        _require(config, "exploration.forced_range", seen, expected, "lidar.range_min", "lidar.range_max")


def _check_replay(config: "Config") -> None:
    learner, capacity = config.learner, config.replay.capacity
    expected = f"at least learner.batch_size = {learner.batch_size}"
    _require(config, "replay.capacity", capacity >= learner.batch_size, expected, "learner.batch_size")
    # Every robot may end its episode in the same step and then hands in all rows that were still waiting.
    waiting = config.training.num_envs * (learner.n_step + learner.delayed_steps)
    expected = f"at least num_envs x (n_step + delayed_steps) = {waiting}, the rows that one step may add"
    others = ("training.num_envs", "learner.n_step", "learner.delayed_steps")
    _require(config, "replay.capacity", capacity >= waiting, expected, *others)


def _check_mirror(config: "Config") -> None:
    lidar = config.lidar
    why = why_asymmetric(lidar.beams, lidar.bins, lidar.mount)
    others = ("lidar.mount", "lidar.beams", "lidar.bins")
    _require(config, "learner.mirror", why is None, f"false where a scan has no mirror image: {why}", *others)
