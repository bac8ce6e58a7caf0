"""Exploration: Gaussian noise per robot (equation 11 or a fixed spread) and forced consistent actions (equation 12).

    Exploration(config, num_envs=, seed=)
        .explore(policy_actions (N, 2), observations (N, bins + 4) raw, step) -> actions (N, 2) float32
        .end_episodes(ended (N,) bool)                        after the simulator's step
        .sigma(step) -> (N,) float32;  .random(step) -> bool  whether the policy is not asked yet
        .state() -> dict[str, ndarray];  .restore(state)

Actions are pairs in [-1, 1] (equation 1), noise has the same unit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navrl.config import ExplorationConfig
from navrl.encoding import GOAL_AND_COMMAND
from navrl.streams import restore_stream, stream, stream_state


class Exploration:
    """Turns the policy's actions into training actions.

    All robots share one stream, in the order of robots and steps. What a step draws depends on the seed, the number of
    robots and the steps before it, and never on observations, actions or ends of episodes: one robot's fate does not
    shift another's noise. With another number of robots, robot k meets other noise.
    """

    def __init__(self, config: ExplorationConfig, *, num_envs: int, seed: int) -> None:
        """Starts with no forced action.

        Args:
            config: Schedules and forced actions.
            num_envs: Robots.
            seed: Seed of the run.
        """
        self.config, self.num_envs = config, num_envs
        self._generator = stream(seed, "exploration")
        self._forced_left = np.zeros(num_envs, np.int64)
        self._forced_actions = np.zeros((num_envs, 2), np.float32)
        # One robot alone takes the middle of the spread.
        low, high = config.sigma_min, config.sigma_max
        spread = np.linspace(low, high, num_envs) if num_envs > 1 else np.array([(low + high) / 2])
        self._spread = spread.astype(np.float32)

    def sigma(self, step: int) -> NDArray[np.float32]:
        """Standard deviation of the noise.

        Args:
            step: Environment steps made so far by all robots together.

        Returns:
            (num_envs,) float32, in units of the action.
        """
        config = self.config
        if config.schedule == "spread":
            return self._spread
        # Eq. 11: sigma falls linearly from sigma_start to sigma_end over sigma_steps
        share = min(step / config.sigma_steps, 1.0)
        sigma = config.sigma_start + (config.sigma_end - config.sigma_start) * share
        return np.full(self.num_envs, sigma, np.float32)

    def random(self, step: int) -> bool:
        """Whether actions are still uniform random numbers after `step` environment steps."""
        return step < self.config.random_steps

    def explore(
        self, policy_actions: NDArray[np.float32], observations: NDArray[np.float32], step: int
    ) -> NDArray[np.float32]:
        """The actions to take.

        Args:
            policy_actions: (num_envs, 2) in [-1, 1]; of no effect during the random steps.
            observations: (num_envs, bins + 4) raw observations: ranges in metres first.
            step: Environment steps made so far by all robots together.

        Returns:
            (num_envs, 2) float32 in [-1, 1].
        """
        shape = (self.num_envs, 2)
        if self.random(step):
            actions = self._generator.uniform(-1.0, 1.0, shape).astype(np.float32)
        else:
            # Eq. 11: a = clip(mu(s) + N(0, sigma), -1, 1)
            noise = self._generator.standard_normal(shape, np.float32) * self.sigma(step)[:, None]
            actions = np.clip(policy_actions + noise, -1.0, 1.0)
        if self.config.forced:
            self._force(actions, observations)
        return actions

    def end_episodes(self, ended: NDArray[np.bool_]) -> None:
        """Ends the forced actions of robots whose episode ended: (num_envs,) bool."""
        self._forced_left[ended] = 0

    def _force(self, actions: NDArray[np.float32], observations: NDArray[np.float32]) -> None:
        """Starts and continues forced consistent actions, overwriting `actions` where one is active."""
        config = self.config
        u = self._generator.random(self.num_envs)
        steps = self._generator.integers(config.forced_steps_min, config.forced_steps_max + 1, self.num_envs)
        turns = self._generator.uniform(-1.0, 1.0, self.num_envs)
        bins = observations.shape[1] - GOAL_AND_COMMAND
        # The front three fifths of the bins: 4..15 of 20
        nearest = observations[:, bins // 5 : bins - bins // 5].min(axis=1)
        # Eq. 12: u > 0.85, an obstacle under 0.6 m in front and none active: 8 to 15 steps of (-1, random turn)
        start = (u > 1.0 - config.forced_probability) & (nearest < config.forced_range) & (self._forced_left == 0)
        self._forced_left[start] = steps[start]
        self._forced_actions[start, 0] = -1.0
        self._forced_actions[start, 1] = turns[start]
        active = self._forced_left > 0
        actions[active] = self._forced_actions[active]
        self._forced_left[active] -= 1

    def state(self) -> dict[str, NDArray[np.generic]]:
        """The random stream and the forced actions under way, as copies."""
        return {
            "generator": stream_state(self._generator),
            "forced_left": self._forced_left.copy(),
            "forced_actions": self._forced_actions.copy(),
        }

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Puts back what `state` returned.

        Raises:
            ValueError: If it belongs to another number of robots or another seed.
        """
        if state["forced_left"].shape != self._forced_left.shape:
            raise ValueError(f"saved for {len(state['forced_left'])} robots, this run has {self.num_envs}")
        restore_stream(self._generator, state["generator"].astype(np.uint64))
        self._forced_left[:] = state["forced_left"]
        self._forced_actions[:] = state["forced_actions"]
