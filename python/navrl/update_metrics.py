"""What updates tell of themselves.

UpdateMetrics                                               means over the updates of one call
torch_metrics(values, errors, actor_losses, outputs); native_metrics(records) -> UpdateMetrics
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, nan

import torch
from torch import Tensor

from navrl._navsim import SATURATED, UpdateRecord


@dataclass(frozen=True)
class UpdateMetrics:
    """Means over the updates of one call, or over its actor steps."""

    critic_loss: float
    """Mean squared error of the critics' values, summed over the critics."""
    average_q: float
    """Mean value of the sampled actions over batch and critics, scaled as rewards are."""
    maximum_q: float
    """Largest such value."""
    actor_updates: int
    """Actor steps among the updates."""
    actor_loss: float
    """Minus the first critic's mean value of the actor's actions, plus the penalty; NaN without an actor step."""
    saturated_share: float
    """Share of the actor's outputs beyond 0.99 in size; NaN without an actor step."""


def torch_metrics(
    values: list[Tensor], errors: list[Tensor], actor_losses: list[Tensor], outputs: list[Tensor]
) -> UpdateMetrics:
    """Metrics of torch's updates.

    Args:
        values: Per update (num_critics, B) the critics' values.
        errors: Per update (num_critics, B) their errors.
        actor_losses: Per actor step () its loss.
        outputs: Per actor step (B, 2) the inputs of the actor's tanh.
    """
    all_values, no_actor_step = torch.stack(values), not actor_losses
    return UpdateMetrics(
        critic_loss=float(torch.stack(errors).square().mean(2).sum(1).mean()),
        average_q=float(all_values.mean()),
        maximum_q=float(all_values.max()),
        actor_updates=len(actor_losses),
        actor_loss=nan if no_actor_step else float(torch.stack(actor_losses).mean()),
        saturated_share=nan if no_actor_step else float((torch.stack(outputs).abs() > SATURATED).double().mean()),
    )


def native_metrics(records: list[UpdateRecord]) -> UpdateMetrics:
    """Metrics of the native kernel's updates.

    Args:
        records: One for each update, at least one.
    """
    actor_steps = [record for record in records if not isnan(record.actor_loss)]
    return UpdateMetrics(
        critic_loss=_mean([record.critic_loss for record in records]),
        average_q=_mean([record.average_q for record in records]),
        maximum_q=max(record.maximum_q for record in records),
        actor_updates=len(actor_steps),
        actor_loss=_mean([record.actor_loss for record in actor_steps]),
        saturated_share=_mean([record.saturated_share for record in actor_steps]),
    )


def _mean(numbers: list[float]) -> float:
    """Their mean, NaN of none."""
    return sum(numbers) / len(numbers) if numbers else nan
