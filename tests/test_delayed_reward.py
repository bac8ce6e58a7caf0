"""Equation 4 inside n-step returns; the equation itself is in test_equations.py."""

from __future__ import annotations

import numpy as np
import pytest

from navrl.delayed_reward import delayed_returns, delayed_reward


def test_one_step_returns_are_the_equation() -> None:
    returns = delayed_returns(gamma=0.9, n_step=1, goal_reward=100.0, delayed_steps=4)
    assert returns.tolist() == pytest.approx([0.0, 100.0, 50.0, 100.0 / 3.0, 25.0])


def test_returns_by_hand() -> None:
    """n-step 2, gamma 1/2, r_g 12, over 3 steps: shares 12, 6, 4 on the last three steps before the goal."""
    returns = delayed_returns(gamma=0.5, n_step=2, goal_reward=12.0, delayed_steps=3)
    # Rows that begin 0, 1, 2, 3, 4 steps before the goal: nothing | 12 | 6 + 12/2 | 4 + 6/2 | 0 + 4/2
    assert returns.tolist() == pytest.approx([0.0, 12.0, 12.0, 7.0, 2.0])


def test_rows_further_back_are_never_changed() -> None:
    """A row that begins n_step + delayed_steps or more steps before the goal holds no step that shares in it."""
    for n_step in (1, 3, 8):
        for delayed_steps in (0, 1, 10):
            returns = delayed_returns(gamma=0.9, n_step=n_step, goal_reward=1.0, delayed_steps=delayed_steps)
            assert len(returns) == n_step + delayed_steps
            first = n_step + delayed_steps
            assert not any(delayed_reward(first - k, 1.0, delayed_steps) for k in range(n_step))
            assert (returns[-1] > 0.0) == (delayed_steps > 0)


def test_off_adds_nothing() -> None:
    assert not np.any(delayed_returns(gamma=0.9, n_step=5, goal_reward=100.0, delayed_steps=0))
