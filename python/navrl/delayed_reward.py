"""The delayed attributed reward (equation 4): steps before a goal share its reward.

    delayed_reward(steps_before_goal, goal_reward, delayed_steps) -> float
    delayed_returns(gamma, n_step, goal_reward, delayed_steps) -> (n_step + delayed_steps,) float64

The first is the equation, the second what it adds to n-step returns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def delayed_reward(steps_before_goal: int, goal_reward: float, delayed_steps: int) -> float:
    """What a step earns for the goal that ends its episode later.

    Args:
        steps_before_goal: i, steps from this one to the one that reaches the goal; 0 is that step itself.
        goal_reward: r_g, unscaled.
        delayed_steps: n; 0 turns the delayed reward off.

    Returns:
        The addition to the step's reward, unscaled; 0 for the goal step, which has r_g already.
    """
    # Eq. 4: r[t-i] += r_g / i, i = 1..n
    return goal_reward / steps_before_goal if 1 <= steps_before_goal <= delayed_steps else 0.0


def delayed_returns(*, gamma: float, n_step: int, goal_reward: float, delayed_steps: int) -> NDArray[np.float64]:
    """What equation 4 adds to the n-step return of a row.

    Args:
        gamma: Discount per step.
        n_step: Most rewards in a return.
        goal_reward: r_g, unscaled.
        delayed_steps: n of equation 4.

    Returns:
        (n_step + delayed_steps,) float64, unscaled: entry j is the addition for the row whose first step lies j steps
        before the goal step. Rows further back are complete before a goal could change them.
    """
    return np.array(
        [
            sum(
                gamma**k * delayed_reward(before - k, goal_reward, delayed_steps)
                for k in range(min(n_step, before + 1))
            )
            for before in range(n_step + delayed_steps)
        ]
    )
