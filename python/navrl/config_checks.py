"""Settings that exclude each other: what no range of a single setting can say.

Each check reads as `require(condition, key, value, what is allowed)`; the first that fails is the error.
"""

from typing import TYPE_CHECKING

from navrl.errors import ConfigError

if TYPE_CHECKING:
    from navrl.config import Config, LidarConfig, SimConfig

# Goals lie at least this far from the start (m): a smaller range of goals would never yield one.
LEAST_GOAL_DISTANCE = {"td3": 1.0, "boxes": 2.0, "open8": 1.0}
MOST_STEPS = 1_000_000


def require(condition: bool, key: str, value: object, allowed: str) -> None:
    """Raises ConfigError with the setting, its value and what is allowed, unless the condition holds."""
    if not condition:
        shown = f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else value
        raise ConfigError(f"{key} = {shown}: must be {allowed}", key=key)


def check_sim(config: "SimConfig | Config") -> None:
    """Checks the tables of the simulator against each other.

    Raises:
        ConfigError: with the first combination that cannot be.
    """
    world, lidar, task = config.world, config.lidar, config.task
    least = LEAST_GOAL_DISTANCE.get(world.name, 0.0)
    start = world.goal_range_start
    require(
        start >= least, "world.goal_range_start", start, f"at least {least} m, the least goal distance of this world"
    )
    require(
        world.goal_range_max >= start,
        "world.goal_range_max",
        world.goal_range_max,
        f"at least goal_range_start = {start}",
    )
    require(
        lidar.range_min < lidar.range_max, "lidar.range_min", lidar.range_min, f"below range_max = {lidar.range_max}"
    )
    require(
        lidar.bins <= lidar.beams, "lidar.bins", lidar.bins, f"at most beams = {lidar.beams}: every bin needs a beam"
    )
    steps = task.time_limit / task.period
    require(
        0.5 <= steps <= MOST_STEPS,
        "task.time_limit",
        task.time_limit,
        f"1 to {MOST_STEPS:,} periods of {task.period} s".replace(",", "_"),
    )
    if task.collision == "sensor":
        require(
            nearest < task.sensor_range < farthest,
            "task.sensor_range",
            task.sensor_range,
            f"between the lidar's range_min = {nearest} and range_max = {farthest}",
        )


def check_config(config: "Config") -> None:
    """Checks all tables against each other.

    Raises:
        ConfigError: with the first combination that cannot be.
    """
    check_sim(config)
    _check_length(config)
    _check_exploration(config)
    _check_learner(config)


def _check_length(config: "Config") -> None:
    training = config.training
    require(training.steps > 0 or training.episodes > 0, "training.steps", 0, "> 0 unless training.episodes is set")
    if training.update_schedule == "per_episode":
        require(training.num_envs == 1, "training.num_envs", training.num_envs, '1 with update_schedule "per_episode"')


def _check_exploration(config: "Config") -> None:
    noise = config.exploration
    if noise.schedule == "spread":
        require(
            noise.sigma_min <= noise.sigma_max,
            "exploration.sigma_min",
            noise.sigma_min,
            f"at most sigma_max = {noise.sigma_max}",
        )
    else:
        require(
            noise.sigma_end <= noise.sigma_start,
            "exploration.sigma_end",
            noise.sigma_end,
            f"at most sigma_start = {noise.sigma_start}",
        )
    require(
        noise.forced_steps_min <= noise.forced_steps_max,
        "exploration.forced_steps_min",
        noise.forced_steps_min,
        f"at most forced_steps_max = {noise.forced_steps_max}",
    )
    if noise.forced:
        lidar = config.lidar
        require(
            lidar.range_min < noise.forced_range <= lidar.range_max,
            "exploration.forced_range",
            noise.forced_range,
            f"above the lidar's range_min = {lidar.range_min} and at most its range_max = {lidar.range_max}",
        )


def _check_learner(config: "Config") -> None:
    learner, capacity = config.learner, config.replay.capacity
    require(
        capacity >= learner.batch_size,
        "replay.capacity",
        capacity,
        f"at least learner.batch_size = {learner.batch_size}",
    )
    # Every robot may end its episode in the same step and then hands in all rows that were still waiting.
    waiting = config.training.num_envs * (learner.n_step + learner.delayed_steps)
    require(
        capacity >= waiting,
        "replay.capacity",
        capacity,
        f"at least num_envs x (n_step + delayed_steps) = {waiting}, the rows that one step may add",
    )
    if learner.mirror:
        _check_mirror(config.lidar)


def _check_mirror(lidar: "LidarConfig") -> None:
    allowed = "false for a lidar that is not symmetric"
    require(
        lidar.mount[1] == 0.0 and lidar.mount[2] == 0.0,
        "learner.mirror",
        True,
        f"{allowed}: lidar.mount has y = {lidar.mount[1]}, yaw = {lidar.mount[2]}",
    )
    # A beam exactly between two bins counts for the left one only, so its mirror image would differ.
    between = any((2 * beam + 1) * lidar.bins % (2 * lidar.beams) == 0 for beam in range(lidar.beams))
    require(
        not between,
        "learner.mirror",
        True,
        f"{allowed}: of {lidar.beams} beams one lies exactly between two of {lidar.bins} bins",
    )
