"""The batched simulator and its scenarios: the Rust core with the configuration's defaults."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from navrl import _navsim
from navrl._navsim import Scenario
from navrl.config import SimConfig

if TYPE_CHECKING:
    from typing import Literal, Self

    Split = Literal["train", "tuning", "validation", "test", "final"]

__all__ = ["BatchSim", "Scenario", "config_json", "draw_list"]


def config_json(config: SimConfig) -> str:
    """The configuration with every key of every table, as the core reads it."""
    return json.dumps(asdict(config))


class BatchSim(_navsim.BatchSim):
    """Many robots, each with a world of its own, stepped together.

    Robot k meets the same worlds and the same noise whatever the number of robots and threads. Results are read-only
    arrays that every call writes in place: copy what you want to keep. With the bins and beams of the configuration:

    * ``observations (num_envs, bins + 4) float32``: bins (m), goal distance (m), goal angle (rad), previous command as
      shares of its limits (equation 2);
    * ``rewards (num_envs,) float32``: equations 3 and 5 and the progress term of the step just made, unscaled;
    * ``terminated``, ``truncated (num_envs,) bool``, ``outcome (num_envs,) uint8``: 0 running, 1 goal, 2 collision,
      3 time-out, of the step just made;
    * ``final_observations (num_envs, bins + 4) float32``: the true successor of the step just made, also when the
      episode goes on;
    * ``poses (num_envs, 3) float64`` (m, m, rad), ``goals (num_envs, 2) float64`` (m): the situation now;
    * ``odometry (num_envs, 3) float64``: where each robot believes to be, its pose unless ``robot.odometry_noise`` is
      set; ``clearances (num_envs,) float32``: distance (m, at most 1,000) from its footprint to the nearest obstacle
      now; both are copies, made when they are read;
    * ``ranges (num_envs, beams) float32`` (m): what the lidar sees now, NaN for a lost beam; written by every call from
      the first time on that this attribute is read, since most users need the bins only;
    * ``velocities (num_envs, 2) float64`` (m/s, rad/s), ``episode_returns``, ``episode_steps``, ``episode_path`` (m),
      ``episode_clearance`` (m), ``episodes``: of the step just made and the episode that it belongs to. Returns are
      those of the paper's reward, whatever the configuration trains on.

    Args:
        config: World, robot, lidar, task and reward.
        num_envs: Number of robots.
        seed: Names the random streams; different seeds share none.
        num_threads: Threads of this simulator, of which the calling one is the first.
        autoreset: True: a step that ends an episode begins the next one in the same call, so that ``observations`` is
            its first. False: a finished robot stays as it is, with reward 0, until ``reset``.
        scenarios: Robot k runs scenario k (modulo their number) instead of drawing one at each reset.
        first: These are the robots ``first`` to ``first + num_envs - 1`` of a larger simulator and meet what they would
            meet there; ``scenarios`` are those of this part.

    Raises:
        ValueError: A number out of range, or a world that cannot hold the robot.
    """

    def __new__(
        cls,
        config: SimConfig | None = None,
        *,
        num_envs: int,
        seed: int = 0,
        num_threads: int = 1,
        autoreset: bool = True,
        scenarios: Sequence[Scenario] | None = None,
        first: int = 0,
    ) -> Self:
        """Sets up the robots and begins their episode 0."""
        text = config_json(SimConfig() if config is None else config)
        given = None if scenarios is None else list(scenarios)
        return super().__new__(cls, text, num_envs, seed, num_threads, autoreset, given, first)


def draw_list(config: SimConfig, split: Split, count: int, *, first: int = 0, seed: int = 0) -> list[Scenario]:
    """Scenarios ``first`` to ``first + count - 1`` of a split of the configured world, with goals over the full range.

    Raises:
        ValueError: A world that cannot hold the robot.
    """
    return _navsim.draw_list(config_json(config), split, first, count, seed)
