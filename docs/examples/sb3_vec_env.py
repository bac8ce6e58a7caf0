# ruff: noqa: ANN001, ANN002, ANN003, ANN201, ANN204, D102
"""A navrl vector environment as Stable-Baselines3 wants it."""

import numpy as np
from gymnasium.spaces import Box
from stable_baselines3.common.vec_env import VecEnv

from navrl.encoding import encode_observations, encoded_size


class Sb3VecEnv(VecEnv):
    """Wraps a NavigationVectorEnv in mode SAME_STEP; observations come encoded, rewards scaled."""

    def __init__(self, env, reward_scale=0.065):
        self.env, self.reward_scale = env, reward_scale
        size = encoded_size(env.config.lidar.bins, "inverse")
        super().__init__(env.num_envs, Box(-np.inf, np.inf, (size,), np.float32), env.single_action_space)

    def reset(self):
        seed = self._seeds[0]  # one seed names the episodes of all robots
        self._reset_seeds()
        return encode_observations(self.env.reset(seed=seed)[0], "inverse")

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        observations, rewards, terminated, truncated, infos = self.env.step(self.actions)
        details = [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(terminated | truncated):
            details[k]["terminal_observation"] = encode_observations(infos["final_obs"][k], "inverse")
            details[k]["TimeLimit.truncated"] = bool(truncated[k])
            details[k]["is_success"] = bool(infos["is_success"][k])
        scaled = (self.reward_scale * rewards).astype(np.float32)
        return encode_observations(observations, "inverse"), scaled, terminated | truncated, details

    def close(self):
        self.env.close()

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False for _ in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        raise NotImplementedError("the robots share one environment: set it up before it is wrapped")

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError("the robots share one environment: call its methods directly")
