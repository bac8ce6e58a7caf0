"""How large a target of the critics can be: what `learner.clip_targets` clips to."""

from __future__ import annotations

from math import inf

from navrl.config import Config, TaskConfig
from navrl.delayed_reward import delayed_reward


def target_bounds(config: Config) -> tuple[float, float]:
    """Bounds of an episode's discounted, scaled return that the reward settings imply.

    A step that does not end the episode earns between -omega_max - 1/2 (turning in place at an obstacle, equations 3
    and 5) and v_max, or -1 and 1/2 in the form "halves", and the progress of one straight step either way. After k such
    steps, k from 0 to the time limit, a goal or a collision may follow with the same progress; the steps before a goal
    share its reward (equation 4).

    Args:
        config: Robot, task, reward and learner.

    Returns:
        (low, high), scaled by `reward_scale`.
    """
    robot, reward, learner = config.robot, config.reward, config.learner
    halves = reward.form == "halves"
    progress = reward.progress * robot.v_max * config.task.period
    best = (0.5 if halves else robot.v_max) + progress
    worst = (-0.5 if halves else -robot.omega_max) - 0.5 - progress
    high, low = -inf, inf
    # After k steps: gamma^k, the sum of gamma^j over j < k, and what the steps before a goal would share.
    discount, motion, shared = 1.0, 0.0, 0.0
    for k in range(most_steps(config.task)):
        high = max(high, best * motion + reward.goal * shared + discount * (reward.goal + progress))
        low = min(low, worst * motion + discount * (reward.collision - progress))
        motion += discount
        discount *= learner.gamma
        shared = learner.gamma * shared + delayed_reward(k + 1, 1.0, learner.delayed_steps)
    high, low = max(high, best * motion), min(low, worst * motion)
    return learner.reward_scale * low, learner.reward_scale * high


def most_steps(task: TaskConfig) -> int:
    """Steps after which the time limit cuts an episode, as the simulator rounds: halves up."""
    return int(task.time_limit / task.period + 0.5)
