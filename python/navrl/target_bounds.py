"""How large a target of the critics can be: what `learner.clip_targets` clips to."""

from __future__ import annotations

from navrl.config import Config


def target_bounds(config: Config) -> tuple[float, float]:
    """Bounds of an episode's discounted, scaled return that the reward settings imply.

    A step that does not end the episode earns between -omega_max - 1/2 (turning in place at an obstacle, equations 3
    and 5) and v_max, or -1 and 1/2 in the form "halves", and the progress of one straight step either way. After k such
    steps a goal or a collision may follow, with the same progress, and the goal's delayed reward (equation 4); with k
    at most the time limit, the extremes lie at k = 0 or at the end, for each further step changes the sum by gamma^k
    times a constant.

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
    steps = round(config.task.time_limit / config.task.period)
    delayed = reward.goal * sum(1.0 / i for i in range(1, learner.delayed_steps + 1))
    goal = reward.goal + delayed + progress
    collision = reward.collision - progress

    def discounted(step: float, end: float, count: int) -> float:
        # sum over k < count of gamma^k step, then gamma^count end
        return step * (1.0 - learner.gamma**count) / (1.0 - learner.gamma) + learner.gamma**count * end

    high = max(goal, discounted(best, goal, steps - 1), discounted(best, 0.0, steps))
    low = min(collision, discounted(worst, collision, steps - 1), discounted(worst, 0.0, steps))
    return learner.reward_scale * low, learner.reward_scale * high
