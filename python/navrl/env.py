"""Gymnasium environments on the batched simulator: one robot, or many with each of the three autoreset modes.

    import gymnasium, navrl.env
    gymnasium.make("navrl/TD3World-v0")
    gymnasium.make_vec("navrl/Boxes-v0", num_envs=256, autoreset_mode=AutoresetMode.SAME_STEP)

Actions and observations are those of equations 1 and 2. An episode ends terminated at the goal or by a collision,
truncated at the time limit, which the environments keep themselves. The infos hold `outcome` (0 running, 1 goal,
2 collision, 3 time-out) and `is_success`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from numbers import Integral
from typing import Any, SupportsInt

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from navrl.batch import BatchSim
from navrl.config import SimConfig, WorldConfig

WORLDS_BY_ID = {"navrl/TD3World-v0": "td3", "navrl/Boxes-v0": "boxes", "navrl/Open8-v0": "open8"}
"""World of each registered environment."""
GOAL = 1
"""Outcome of an episode that reached its goal."""
DISTANCE_MAX = 2000.0 * math.sqrt(2.0)
"""Largest distance (m) in a world, whose coordinates lie within +-1,000 m."""

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


def observation_space(config: SimConfig) -> Box:
    """Limits of an observation (equation 2).

    Args:
        config: Robot and lidar.

    Returns:
        Box of `bins` + 4 float32.
    """
    bins, pi = config.lidar.bins, float(np.float32(math.pi))
    low = np.array([0.0] * bins + [0.0, -pi, 0.0, -1.0], np.float32)
    high = np.array([config.lidar.range_max] * bins + [DISTANCE_MAX, pi, 1.0, 1.0], np.float32)
    return Box(low, high, dtype=np.float32)


def action_space() -> Box:
    """Limits of an action (equation 1): a1 drives, a2 turns."""
    return Box(-1.0, 1.0, (2,), np.float32)


def _with_world(config: SimConfig | None, world: str | None, kind: type) -> SimConfig:
    """The configuration with the world of an id; one that speaks of the world itself has to agree."""
    config = SimConfig() if config is None else config
    if world is None or world == config.world.name:
        return config
    if config.world != WorldConfig():
        clash = f'world = "{world}", but the configuration has world.name = "{config.world.name}"'
        raise ValueError(f"{clash}; to drive there, use navrl.env.{kind.__name__}, which needs no id")
    return dataclasses.replace(config, world=dataclasses.replace(config.world, name=world))


def _whole(seed: SupportsInt | None) -> int | None:
    """A seed as Gymnasium wants it: numpy's whole numbers are no int."""
    return None if seed is None else int(seed)


def _checked_action(action: object) -> Floats:
    checked = np.asarray(action, np.float32)
    if checked.shape != (2,):
        raise ValueError(f"action: expected shape (2,), got {checked.shape}")
    if not np.isfinite(checked).all():
        raise ValueError(f"action: expected finite numbers, got {checked.tolist()}")
    return checked


class _Camera:
    """Pictures of the robots of a simulator, with the way that each has driven in its episode."""

    def __init__(self, config: SimConfig) -> None:
        self._config = config
        self._paths: list[list[tuple[float, float]]] = []

    def follow(self, simulator: BatchSim, begun: Mask) -> None:
        """Notes where the robots are; those with `begun` have just started an episode."""
        places = simulator.poses[:, :2].tolist()
        self._paths = self._paths or [[] for _ in places]
        for path, place, first in zip(self._paths, places, begun, strict=True):
            if first:
                path.clear()
            path.append((place[0], place[1]))

    def picture(self, simulator: BatchSim, k: int) -> NDArray[np.uint8]:
        """RGB picture (height, width, 3) of robot k."""
        from navrl.drawing.render import Moment, Room
        from navrl.metrics import OUTCOMES

        v, omega = (float(speed) for speed in simulator.velocities[k])
        moment = Moment(
            pose=simulator.poses[k].copy(),
            ranges=simulator.ranges[k].copy(),
            path=np.array(self._paths[k]),
            step=len(self._paths[k]) - 1,
            v=v,
            omega=omega,
            outcome=OUTCOMES.get(int(simulator.outcome[k]), "running"),
        )
        return np.asarray(Room(simulator.scenario(k), self._config).draw(moment))


class NavigationEnv(gymnasium.Env[Any, Any]):
    """One robot that drives to a goal, a new one in each episode."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - Gymnasium's own form

    def __init__(
        self, config: SimConfig | None = None, *, world: str | None = None, render_mode: str | None = None
    ) -> None:
        """Makes the environment; the simulator starts at the first reset.

        Args:
            config: World, robot, lidar, task and reward; the defaults if None.
            world: Name of the world, for a configuration that says nothing of it.
            render_mode: None or "rgb_array".

        Raises:
            ValueError: Another render mode, or a configuration with another world.
        """
        self.config = _with_world(config, world, NavigationEnv)
        self.render_mode = _checked_render_mode(render_mode)
        self.metadata = {**self.metadata, "render_fps": round(1 / self.config.task.period)}
        self.observation_space = observation_space(self.config)
        self.action_space = action_space()
        self._simulator: BatchSim | None = None
        self._camera = _Camera(self.config) if render_mode else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Starts the next episode.

        Args:
            seed: Starts over with the episodes of this seed.
            options: Unused.

        Returns:
            Observation (bins + 4,) float32, and infos.
        """
        seed = _whole(seed)
        super().reset(seed=seed)
        if seed is not None or self._simulator is None:
            chosen = int(self.np_random.integers(2**63)) if seed is None else seed
            self._simulator = BatchSim(self.config, num_envs=1, seed=chosen, autoreset=False)
        else:
            self._simulator.reset()
        if self._camera:
            self._camera.follow(self._simulator, np.ones(1, np.bool_))
        return self._simulator.observations[0].copy(), self._infos(self._simulator)

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Drives one control period.

        Args:
            action: (2,) in [-1, 1].

        Returns:
            Observation (bins + 4,) float32, reward, terminated, truncated, infos.

        Raises:
            ValueError: An action of another shape, NaN or infinity; nothing has moved then.
        """
        simulator = self._started()
        simulator.step(_checked_action(action).reshape(1, 2))
        if self._camera:
            self._camera.follow(simulator, np.zeros(1, np.bool_))
        return (
            simulator.observations[0].copy(),
            float(simulator.rewards[0]),
            bool(simulator.terminated[0]),
            bool(simulator.truncated[0]),
            self._infos(simulator),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """The room as RGB (height, width, 3) in render mode "rgb_array", otherwise None."""
        return self._camera.picture(self._started(), 0) if self._camera else None

    def _started(self) -> BatchSim:
        if self._simulator is None:
            raise gymnasium.error.ResetNeeded("call reset before step and render")
        return self._simulator

    def _infos(self, simulator: BatchSim) -> dict[str, Any]:
        outcome = int(simulator.outcome[0])
        return {"outcome": outcome, "is_success": outcome == GOAL}


class NavigationVectorEnv(VectorEnv[Any, Any, NDArray[Any]]):
    """Many robots, each in a world of its own, stepped together."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - Gymnasium's own form

    def __init__(
        self,
        num_envs: int = 1,
        config: SimConfig | None = None,
        *,
        world: str | None = None,
        num_threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        """Makes the environment; the simulator starts at the first reset.

        Args:
            num_envs: Number of robots.
            config: World, robot, lidar, task and reward; the defaults if None.
            world: Name of the world, for a configuration that says nothing of it.
            num_threads: Threads that step the robots; they do not change results.
            autoreset_mode: What follows the end of an episode. NEXT_STEP: the next step ignores the action and returns
                the first observation of the next episode, with reward 0. SAME_STEP: the same step returns it, and the
                infos hold the last one as `final_obs`. DISABLED: the robot stands still, with reward 0, until
                `reset(options={"reset_mask": ...})`.
            render_mode: None or "rgb_array".

        Raises:
            ValueError: Another mode, or a configuration with another world.
        """
        self.num_envs = num_envs
        self.config = _with_world(config, world, NavigationVectorEnv)
        self.render_mode = _checked_render_mode(render_mode)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {
            **self.metadata,
            "render_fps": round(1 / self.config.task.period),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_observation_space = observation_space(self.config)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._num_threads = num_threads
        self._simulator: BatchSim | None = None
        self._finished = np.zeros(num_envs, np.bool_)
        self._camera = _Camera(self.config) if render_mode else None

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Starts the next episode of all robots, or of some.

        Args:
            seed: Starts over with the episodes of this seed, or of this list of seeds as a whole.
            options: {"reset_mask": (num_envs,) bool} restricts the reset to these robots.

        Returns:
            Observations (num_envs, bins + 4) float32, and infos.

        Raises:
            ValueError: A mask of another shape or dtype, or together with a seed, or before the first reset.
        """
        begun = np.ones(self.num_envs, np.bool_)
        mask = (options or {}).get("reset_mask")
        if mask is not None:
            begun = self._checked_mask(mask, seed)
            self._started().reset(begun)
        elif seed is not None or self._simulator is None:
            self._simulator = self._start(seed)
        else:
            self._simulator.reset()
        simulator = self._started()
        self._finished[begun] = False
        self._follow(simulator, begun)
        return simulator.observations.copy(), _vector_infos(simulator, begun)

    def step(self, actions: Floats) -> tuple[Floats, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Drives every robot for one control period.

        Args:
            actions: (num_envs, 2) in [-1, 1].

        Returns:
            Observations (num_envs, bins + 4) float32, rewards, terminated, truncated (num_envs,), infos.
        """
        simulator = self._started()
        simulator.step(np.asarray(actions, np.float32))
        begun = np.zeros(self.num_envs, np.bool_)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and self._finished.any():
            # These stood still in the step above, whatever their action.
            begun = self._finished.copy()
            simulator.reset(begun)
        terminated, truncated = simulator.terminated.copy(), simulator.truncated.copy()
        self._finished = terminated | truncated
        infos = _vector_infos(simulator, np.ones(self.num_envs, np.bool_))
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            begun = self._finished
            if begun.any():
                infos |= {"final_obs": simulator.final_observations.copy(), "_final_obs": begun.copy()}
                infos |= {"final_info": _vector_infos(simulator, begun), "_final_info": begun.copy()}
        self._follow(simulator, begun)
        return simulator.observations.copy(), simulator.rewards.astype(np.float64), terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One RGB picture (height, width, 3) a robot in render mode "rgb_array", otherwise None."""
        if self._camera is None:
            return None
        return tuple(self._camera.picture(self._started(), k) for k in range(self.num_envs))

    def _start(self, seed: int | Sequence[int] | None) -> BatchSim:
        if seed is None:
            chosen = int(self.np_random.integers(2**63))
        elif isinstance(seed, (int, Integral)):
            chosen = int(seed)
            self._np_random, self._np_random_seed = gymnasium.utils.seeding.np_random(chosen)
        else:
            chosen = int(np.random.SeedSequence(list(seed)).generate_state(1, np.uint64)[0])
        autoreset = self.autoreset_mode is AutoresetMode.SAME_STEP
        return BatchSim(
            self.config, num_envs=self.num_envs, seed=chosen, num_threads=self._num_threads, autoreset=autoreset
        )

    def _started(self) -> BatchSim:
        if self._simulator is None:
            raise gymnasium.error.ResetNeeded("call reset of all robots before step, render and masked resets")
        return self._simulator

    def _follow(self, simulator: BatchSim, begun: Mask) -> None:
        if self._camera:
            self._camera.follow(simulator, begun)

    def _checked_mask(self, mask: object, seed: object) -> Mask:
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            got = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
            raise ValueError(f"options['reset_mask']: expected a bool array of shape ({self.num_envs},), got {got}")
        if seed is not None:
            raise ValueError("options['reset_mask']: a seed names the episodes of all robots; give one or the other")
        return mask.copy()


def _checked_render_mode(render_mode: str | None) -> str | None:
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f'render_mode = "{render_mode}": expected None or "rgb_array"')
    return render_mode


def _vector_infos(simulator: BatchSim, known: Mask) -> dict[str, Any]:
    """Infos of the step just made, with Gymnasium's mask beside each: which robots an entry is about."""
    outcome = simulator.outcome.copy()
    infos: dict[str, Any] = {"outcome": outcome, "is_success": outcome == GOAL}
    return infos | {f"_{key}": known.copy() for key in infos}


def _register() -> None:
    """Makes the environments known to Gymnasium, once."""
    for environment_id, world in WORLDS_BY_ID.items():
        if environment_id not in gymnasium.registry:
            gymnasium.register(
                id=environment_id,
                entry_point="navrl.env:NavigationEnv",
                vector_entry_point="navrl.env:NavigationVectorEnv",
                kwargs={"world": world},
            )


_register()
