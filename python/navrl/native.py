"""Updates and actions on the native kernel, with the draws, tensors and equations of `navrl.td3`.

    kernel_of(config) -> "native" | "torch"           what computes the updates of a configuration
    learn_threads(config) -> int                      in how many threads
    Draws(indices, mirrored, noise)                   what some updates draw
    NativeLearner(...)
        .update(replay, draws, rates=, updates=) -> a record for each update
        .act(actor, encoded (N, inputs)) -> (N, 2)
        .set_room(room)                              of a second thread of updates

Torch's tensors remain the only copy of parameters and moments: the kernel works in their memory, several updates in
one call, without the interpreter's lock, in one thread or two with the same bits. Its results differ from torch's by
rounding alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from navrl import _navsim
from navrl.config import Config, LearnerConfig
from navrl.machine import cores
from navrl.networks import Actor, TwinCritic
from navrl.replay import NonFiniteError

WORK_FOR_TWO = 500_000
"""Multiplications between hidden layers, for a batch, from which on two threads are faster than one."""
WORK_PER_CALL = 1_000_000_000
"""Most multiplications of a call, unless one update needs more: some hundredths of a second."""


def kernel_of(config: Config) -> Literal["native", "torch"]:
    """What computes the updates: "auto" is the native kernel."""
    return "torch" if config.learner.kernel == "torch" else "native"


def learn_threads(config: Config) -> int:
    """Threads of the update: as set, at most two with the native kernel.

    By default one with torch and two with that kernel, but one where two would meet too often.
    """
    if kernel_of(config) == "torch":
        return config.threads.learn or 1
    hidden, batch = config.networks.hidden_sizes, config.learner.batch_size
    work = batch * sum(units * above for units, above in pairwise(hidden))
    own = cores() if work >= WORK_FOR_TWO else 1
    return min(config.threads.learn or own, 2)


@dataclass(frozen=True)
class Draws:
    """What n updates draw."""

    indices: NDArray[np.int64]
    """(n, batch_size) places in replay."""
    mirrored: NDArray[np.bool_]
    """(n, batch_size) which of the rows are mirrored."""
    noise: NDArray[np.float32]
    """(n, batch_size, 2) clip(N(0, policy_noise), +-noise_clip)."""


@dataclass(frozen=True)
class Trained:
    """A network and what an update of it changes: packed vectors (`navrl.gradients.pack`)."""

    network: nn.Module
    """Its parameters are views of `online`."""
    online: Tensor
    """(size,) the parameters."""
    target: Tensor
    """(size,) the target's parameters."""
    adam: dict[str, Tensor]
    """Adam's step, exp_avg and exp_avg_sq."""

    @property
    def vectors(self) -> list[NDArray[np.floating]]:
        """Parameters, target and moments, in torch's memory."""
        tensors = (self.online, self.target, self.adam["exp_avg"], self.adam["exp_avg_sq"])
        return [tensor.numpy() for tensor in tensors]


class NativeLearner:
    """Updates of the networks of one learner in their own memory, and its actor's actions."""

    def __init__(
        self,
        config: LearnerConfig,
        *,
        actor: Trained,
        critic: Trained,
        policy_delay: int,
        bounds: tuple[float, float] | None,
        mirror: tuple[NDArray[np.intp], NDArray[np.float32]] | None,
        threads: int,
    ) -> None:
        """Takes memory for a batch.

        Args:
            config: batch_size, tau and pretanh_penalty.
            actor: The actor.
            critic: One critic or two.
            policy_delay: Updates of the critics per update of the actor and the targets.
            bounds: Of the targets, if they are clipped.
            mirror: Permutation and signs of a row of replay, if rows are mirrored.
            threads: 1 or 2; never changes results.
        """
        assert isinstance(actor.network, Actor)
        assert isinstance(critic.network, TwinCritic)
        self._vectors = {"actor": actor.vectors, "critic": critic.vectors}
        self._steps = [trained.adam["step"].numpy() for trained in (actor, critic)]
        self._policy_delay = policy_delay
        sizes = [len(vectors[0]) for vectors in self._vectors.values()]
        self.updates_per_call = max(1, WORK_PER_CALL // (4 * config.batch_size * sum(sizes)))
        """Updates that one call should make at most."""
        linears = [*actor.network.hidden, actor.network.output]
        critic_layers = zip(critic.network.weights, critic.network.biases, strict=True)
        self.busy = False
        """Whether updates are made by one thread for a while, because the machine is busy."""
        self._kernel = _navsim.Learner(
            double=actor.online.dtype == torch.float64,
            actor=[_place(linear.weight, linear.bias) for linear in linears],
            critic=[_place(weight, bias) for weight, bias in critic_layers],
            action_weight=int(critic.network.action_weight.storage_offset()),
            critics=len(critic.network.action_weight),
            batch=config.batch_size,
            sizes=sizes,
            policy_delay=policy_delay,
            tau=config.tau,
            pretanh_penalty=config.pretanh_penalty,
            bounds=bounds or (-inf, inf),
            frozen_combined=not critic.network.action_weight.requires_grad,
            mirror=None if mirror is None else (mirror[0].tolist(), mirror[1].tolist()),
            threads=threads,
        )

    def update(
        self, replay: NDArray[np.float32], draws: Draws, *, rates: tuple[float, float], updates: int
    ) -> list[_navsim.UpdateRecord]:
        """Makes the updates of some draws.

        Args:
            replay: (rows, width) float32.
            draws: Their draws.
            rates: Adam's step sizes of actor and critics.
            updates: Updates so far.

        Returns:
            One for each update.

        Raises:
            NonFiniteError: In a row, a parameter, a moment or the noise; nothing has changed then. Or in what was
                computed from them, for they overflowed; the networks are of no more use then.
        """
        try:
            records, self.busy = self._kernel.update(
                **self._vectors,
                rates=rates,
                steps=(updates // self._policy_delay, updates),
                replay=replay,
                indices=draws.indices.ravel(),
                mirrored=draws.mirrored.ravel(),
                noise=draws.noise.ravel(),
            )
        except ArithmeticError as error:
            raise NonFiniteError(str(error)) from None
        updates += len(records)
        self._steps[0][()], self._steps[1][()] = updates // self._policy_delay, updates
        return records

    def set_room(self, room: bool) -> None:
        """Tells, from any thread, whether there is a processor for a second thread of updates; at first there is."""
        self._kernel.set_room(room)

    def act(self, actor: NDArray[np.floating], encoded: NDArray[np.float32]) -> NDArray[np.float32]:
        """An actor's actions, also beside updates of another one.

        Args:
            actor: (size,) its parameters, packed as those that are updated.
            encoded: (N, inputs) float32.

        Returns:
            (N, 2) float32 in [-1, 1]; those of a row do not depend on the others.
        """
        return self._kernel.act(actor=actor, observations=np.ascontiguousarray(encoded))


def _place(weight: nn.Parameter, bias: nn.Parameter) -> tuple[int, int, int, int]:
    """Inputs, outputs, and the places of weight and bias in the packed vector, of the first critic where there are."""
    outputs, inputs = weight.shape[-2:]
    return inputs, outputs, int(weight.storage_offset()), int(bias.storage_offset())
