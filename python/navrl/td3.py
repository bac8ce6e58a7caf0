"""TD3, with DDPG as its one-critic case (equations 9 and 10).

    TD3(config, replay, seed=, dtype=torch.float32)
        .update(count) -> UpdateMetrics            `count` updates; counted in .updates and .actor_updates
        .begin_step()                              of all robots
        .act(encoded (N, inputs)) -> (N, 2)        the actor as it was then, which explores, also beside updates
        .policy -> Actor                           what is evaluated and kept: the averaged actor, or the actor itself
        .policy_weights() -> dict[str, ndarray]    its tensors, copied, by the names of navrl.networks.Actor
        .set_room(free);  .busy                   of a second thread of updates
        .set_progress(fraction)                    share of the run that is over, for the step sizes
        .state() -> dict[str, ndarray];  .restore(state)
    with flushed_denormals(): ...                  around whatever updates

Determinism: the bits depend on the calls, the processor model, the builds, the kernel and, with torch's, the thread
count, not on how updates are grouped into calls; and on whether denormal numbers are flushed to zero.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from navrl._navsim import UpdateRecord
from navrl.config import Config, NetworksConfig
from navrl.encoding import encoded_size
from navrl.gradients import ActorPass, CriticPass, pack, unpack
from navrl.mirror import ACTIONS, mirror_actions, mirror_encoded
from navrl.native import Draws, NativeLearner, Trained, kernel_of, learn_threads
from navrl.networks import Actor, TwinCritic
from navrl.replay import Arrays, NonFiniteError, Replay, row_width
from navrl.streams import restore_stream, stream, stream_state
from navrl.target_bounds import target_bounds
from navrl.update_metrics import UpdateMetrics, native_metrics, torch_metrics

__all__ = ["BLOCK", "TD3", "UpdateMetrics", "flushed_denormals"]

BLOCK = 64
"""Most updates whose rows are gathered together; bounds the memory of a call."""


@contextmanager
def flushed_denormals(flushed: bool = True) -> Iterator[None]:
    """Flushes denormal numbers to zero, or not, in this thread and in those that start meanwhile; then as before.

    The moments of dead units decay into numbers that are an order of magnitude slower otherwise. Networks are made
    inside too, for torch may start its threads there.

    Args:
        flushed: False keeps denormal numbers, where only a part of the work flushes none.
    """
    before = sys.float_info.min / 2.0 == 0.0
    torch.set_flush_denormal(flushed)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


@dataclass(frozen=True)
class Batch:
    """What one update draws."""

    rows: Tensor
    """(batch_size, width) float32 of replay, half of them mirrored where that is on."""
    target_noise: Tensor
    """(batch_size, 2) float32: clip(N(0, policy_noise), +-noise_clip)."""


class TD3:
    """Networks, targets, optimisers and the update."""

    def __init__(
        self, config: Config, replay: Replay, *, seed: int | None = None, dtype: torch.dtype = torch.float32
    ) -> None:
        """Draws the first weights.

        Args:
            config: Networks, learner, rewards and the lidar's bins.
            replay: Where batches come from; rows as wide as the encoding needs.
            seed: Seed of all draws, `config.training.seed` if None.
            dtype: Of networks and arithmetic; rows stay float32.

        Raises:
            ValueError: If the rows of `replay` have another width.
        """
        self.config, self.replay, self.dtype = config.learner, replay, dtype
        seed = config.training.seed if seed is None else seed
        self.inputs = encoded_size(config.lidar.bins, config.networks.encoding)
        if replay.width != row_width(self.inputs):
            raise ValueError(f"replay has rows of {replay.width} columns, expected {row_width(self.inputs)}")
        # DDPG is the one-critic case: no target noise, no minimum, an actor step with every update.
        twin = self.config.algorithm == "td3"
        self.policy_delay = self.config.policy_delay if twin else 1
        self.policy_noise = self.config.policy_noise if twin else 0.0
        self._build(config.networks, num_critics=2 if twin else 1, generator=stream(seed, "networks"))
        self.bounds = target_bounds(config) if self.config.clip_targets else None
        self._mirror = _row_mirror(config) if self.config.mirror else None
        self._streams = {name: stream(seed, name) for name in ("replay_indices", "mirror", "target_noise")}
        self.updates = 0
        self.actor_updates = 0
        self.progress = 0.0
        native = kernel_of(config) == "native"
        self._native = self._native_learner(learn_threads(config)) if native else None

    def _build(self, networks: NetworksConfig, *, num_critics: int, generator: np.random.Generator) -> None:
        """Makes networks, targets, optimisers and the memory of a batch."""
        self.actor = Actor(self.inputs, networks, generator).to(self.dtype)
        self.critic = TwinCritic(self.inputs, networks, generator, num_critics=num_critics).to(self.dtype)
        self.actor_target, self.averaged_actor = copy.deepcopy(self.actor), copy.deepcopy(self.actor)
        self._acting_actor = copy.deepcopy(self.actor)
        self.critic_target = copy.deepcopy(self.critic)
        self._actor, self._critic = pack(self.actor), pack(self.critic)
        self._averaged, self._acting = pack(self.averaged_actor).detach(), pack(self._acting_actor).detach()
        self._online = [self._actor.detach(), self._critic.detach()]
        self._targets = [pack(self.actor_target).detach(), pack(self.critic_target).detach()]
        self.actor_optimizer = _adam(self._actor, self.config.actor_lr)
        self.critic_optimizer = _adam(self._critic, self.config.critic_lr)
        size = self.config.batch_size
        self._actor_pass, self._actor_target_pass = ActorPass(self.actor, size), ActorPass(self.actor_target, size)
        self._critic_pass = CriticPass(self.critic, size)
        self._first_critic_pass = CriticPass(self.critic, size, critics=1)
        self._critic_target_pass = CriticPass(self.critic_target, size)
        # Every batch is copied to the same place, so that its bits never depend on where it was gathered.
        self._rows = torch.empty(size, self.replay.width, dtype=self.dtype)
        columns = torch.split(self._rows, [self.inputs, ACTIONS, self.inputs, 1, 1], dim=1)
        self._observations, self._actions, self._successors = columns[:3]
        self._returns, self._bootstrap = columns[3][:, 0], columns[4][:, 0]

    def _native_learner(self, threads: int) -> NativeLearner:
        """The native kernel, to work in the memory of the networks and optimisers."""
        parts = zip(
            (self.actor, self.critic),
            self._online,
            self._targets,
            (self.actor_optimizer, self.critic_optimizer),
            strict=True,
        )
        actor, critic = (
            Trained(network, online, target, next(iter(optimizer.state.values())))
            for network, online, target, optimizer in parts
        )
        return NativeLearner(
            self.config,
            actor=actor,
            critic=critic,
            policy_delay=self.policy_delay,
            bounds=self.bounds,
            mirror=self._mirror,
            threads=threads,
        )

    def set_room(self, free: bool) -> None:
        """Tells, from any thread, whether there is a processor for a second thread of updates; at first there is.

        Args:
            free: True also lets one help with updates that have begun.
        """
        if self._native is not None:
            self._native.set_room(free)

    @property
    def busy(self) -> bool:
        """Whether updates are made by one thread for a while, because two have waited for each other."""
        return self._native is not None and self._native.busy

    @property
    def policy(self) -> Actor:
        """The averaged actor, or the actor itself where averaging is off."""
        return self.averaged_actor if self.config.averaging_rate > 0 else self.actor

    def policy_weights(self) -> dict[str, NDArray[np.float32]]:
        """Copies of the policy's tensors, float32, by the names of `navrl.networks.Actor`."""
        return {name: tensor.float().numpy().copy() for name, tensor in self.policy.state_dict().items()}

    def act(self, encoded: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions without noise of the actor as it was when the step began; another thread may make updates meanwhile.

        Args:
            encoded: (N, inputs) encoded observations.

        Returns:
            (N, 2) float32 in [-1, 1].
        """
        if self._native is not None:
            return self._native.act(self._acting.numpy(), encoded)
        with torch.no_grad():
            actions: Tensor = self._acting_actor(torch.tensor(encoded, dtype=self.dtype))
        return actions.float().numpy()

    def update(self, count: int) -> UpdateMetrics:
        """Makes `count` updates.

        Args:
            count: Updates, at least 1.

        Returns:
            Their metrics.

        Raises:
            ValueError: If replay is empty, or `count` less than 1.
            NonFiniteError: If a loss or a parameter is NaN or infinite after the call, or with the native kernel before
                it. The networks are of no more use then; what was saved before the call is sound, for every call
                before this one ended finite.
        """
        if self.replay.size == 0:
            raise ValueError("no rows in replay to learn from")
        if count < 1:
            raise ValueError(f"count = {count}: expected at least 1 update")
        if self._native is not None:
            return self._update_natively(self._native, count)
        errors, values, actor_losses, outputs = [], [], [], []
        for batch in self._batches(count):
            self._rows.copy_(batch.rows)
            value, error = self._update_critics(self._target(batch.target_noise))
            values.append(value)
            errors.append(error)
            self.updates += 1
            if self.updates % self.policy_delay == 0:
                loss, output = self._update_actor()
                actor_losses.append(loss)
                outputs.append(output)
                self.actor_updates += 1
                # Eq. 10: theta' <- tau theta + (1 - tau) theta'
                torch._foreach_lerp_(self._targets, self._online, self.config.tau)
        self._refuse_non_finite(errors)
        return torch_metrics(values, errors, actor_losses, outputs)

    def _update_natively(self, native: NativeLearner, count: int) -> UpdateMetrics:
        """Makes `count` updates as `update` does, on the native kernel."""
        records: list[UpdateRecord] = []
        rates = (self.actor_optimizer.param_groups[0]["lr"], self.critic_optimizer.param_groups[0]["lr"])
        for draws in self._draws(count, min(BLOCK, native.updates_per_call)):
            records += native.update(self.replay.rows, draws, rates=rates, updates=self.updates)
            self.updates += len(draws.indices)
            self.actor_updates = self.updates // self.policy_delay
        return native_metrics(records)

    def _target(self, noise: Tensor) -> Tensor:
        """The targets (B,) of the batch; `noise` (B, 2) is clip(N(0, sigma), +-c)."""
        # Eq. 9: y = R + gamma^m (1 - terminated) min(Q1', Q2')(s', clip(mu'(s') + clip(N(0, sigma), +-c), +-1))
        actions = torch.tanh(self._actor_target_pass.forward(self._successors)).add_(noise).clamp_(-1.0, 1.0)
        value = self._critic_target_pass.forward(self._successors, actions).amin(0)
        target = torch.addcmul(self._returns, self._bootstrap, value)
        return target if self.bounds is None else target.clamp_(*self.bounds)

    def _update_critics(self, target: Tensor) -> tuple[Tensor, Tensor]:
        """One step of the critics; returns their values (num_critics, B) before it, and the errors."""
        values = self._critic_pass.forward(self._observations, self._actions).clone()
        error = values - target
        # L = sum over the critics of the mean over the batch of (Q - y)^2, so dL/dQ = 2 (Q - y) / B
        self._critic_pass.backward(error * (2.0 / len(target)))
        self.critic_optimizer.step()
        return values, error

    def _update_actor(self) -> tuple[Tensor, Tensor]:
        """One step of the actor; returns its loss () and the inputs of its tanh (B, 2) before it."""
        penalty, size = self.config.pretanh_penalty, self.config.batch_size
        outputs = self._actor_pass.forward(self._observations).clone()
        actions = torch.tanh(outputs)
        values = self._first_critic_pass.forward(self._observations, actions)
        # L = mean of -Q1(s, mu(s)) + penalty * mean of z^2 with mu = tanh(z), where the penalty keeps tanh from
        # saturating; so dL/dz = -dQ1/da (1 - mu^2) / B + penalty * z / B, with two outputs z a row
        loss = penalty * outputs.square().mean() - values.mean()
        gradient = self._first_critic_pass.action_gradient(torch.full_like(values, -1.0 / size))
        gradient.mul_(1.0 - actions.square()).add_(outputs, alpha=penalty / size)
        self._actor_pass.backward(gradient)
        self.actor_optimizer.step()
        return loss, outputs

    def begin_step(self) -> None:
        """Keeps the actor as it is now to act, and moves the averaged one by `averaging_rate` of its way to it."""
        self._acting.copy_(self._actor.detach())
        if self.config.averaging_rate > 0:
            self._averaged.lerp_(self._actor.detach(), self.config.averaging_rate)

    def set_progress(self, fraction: float) -> None:
        """Sets the step sizes: linear from full to `final_lr_fraction` over the run.

        Args:
            fraction: Share of the run that is over, in [0, 1].
        """
        self.progress = fraction
        share = 1.0 - (1.0 - self.config.final_lr_fraction) * fraction
        self.critic_optimizer.param_groups[0]["lr"] = self.config.critic_lr * share
        self.actor_optimizer.param_groups[0]["lr"] = self.config.actor_lr * share

    def _draws(self, count: int, block: int) -> Iterator[Draws]:
        """Draws for `count` updates, for at most `block` of them at a time."""
        for first in range(0, count, block):
            shape = (min(block, count - first), self.config.batch_size)
            indices = self._streams["replay_indices"].integers(self.replay.size, size=shape)
            mirrored = np.zeros(shape, np.bool_)
            if self._mirror is not None:
                mirrored = self._streams["mirror"].random(indices.size, np.float32).reshape(shape) < 0.5
            yield Draws(indices, mirrored, self._target_noise((*shape, ACTIONS)))

    def _batches(self, count: int) -> Iterator[Batch]:
        """Draws `count` batches, `BLOCK` at a time."""
        for draws in self._draws(count, BLOCK):
            rows = self.replay.sample(draws.indices.ravel())
            if self._mirror is not None:
                mirrored, (permutation, signs) = draws.mirrored.ravel(), self._mirror
                rows[mirrored] = rows[mirrored][:, permutation] * signs
            batches = torch.from_numpy(rows.reshape(*draws.indices.shape, -1))
            yield from map(Batch, batches, torch.from_numpy(draws.noise))

    def _target_noise(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Draws clip(N(0, policy_noise), +-noise_clip), or zeros where it is off."""
        if self.policy_noise == 0.0:
            return np.zeros(shape, np.float32)
        noise: NDArray[np.float32] = self._streams["target_noise"].standard_normal(shape, np.float32)
        noise *= self.policy_noise
        return noise.clip(-self.config.noise_clip, self.config.noise_clip)

    def _refuse_non_finite(self, errors: list[Tensor]) -> None:
        """Raises NonFiniteError if an error of the critics or a parameter is NaN or infinite."""
        norms = torch.stack(torch._foreach_norm([*errors, self._critic, self._actor]))
        if not norms.isfinite().all():
            first = self.updates - len(errors) + 1
            names = [f"the critics' error in update {first + i}" for i in range(len(errors))]
            bad = int(torch.nonzero(~norms.isfinite())[0, 0])
            name = [*names, "a parameter of the critics", "a parameter of the actor"][bad]
            raise NonFiniteError(f"{name} is not finite")

    def state(self) -> Arrays:
        """Everything that the next update depends on but replay: copies by name, for a bitwise continuation."""
        arrays: Arrays = {name: tensor.numpy().copy() for name, tensor in self._tensors().items()}
        arrays |= {f"streams.{name}": stream_state(generator) for name, generator in self._streams.items()}
        counts = {"updates": self.updates, "actor_updates": self.actor_updates}
        arrays |= {name: np.array(value, np.uint64) for name, value in counts.items()}
        arrays["progress"] = np.array(self.progress, np.float64)
        return arrays

    def restore(self, state: Arrays) -> None:
        """Puts back what `state` returned.

        Args:
            state: Arrays by name.

        Raises:
            ValueError: If an array is missing or of another shape, or a stream belongs to another seed; nothing has
                changed then, unless a stream is at fault.
        """
        tensors = self._tensors()
        for name, tensor in tensors.items():
            saved = state[name].shape if name in state else None
            if saved != tuple(tensor.shape):
                raise ValueError(f"saved {name} has shape {saved}, this run needs {tuple(tensor.shape)}")
        others = [*(f"streams.{name}" for name in self._streams), "updates", "actor_updates", "progress"]
        missing = [name for name in others if name not in state]
        if missing:
            raise ValueError(f"saved state lacks {missing[0]}")
        for name, generator in self._streams.items():
            restore_stream(generator, state[f"streams.{name}"].astype(np.uint64))
        for name, tensor in tensors.items():
            tensor.copy_(torch.from_numpy(np.asarray(state[name])))
        self.updates, self.actor_updates = int(state["updates"]), int(state["actor_updates"])
        self.set_progress(float(state["progress"]))

    def _tensors(self) -> dict[str, Tensor]:
        """Parameters, Adam's moments and step counts by name; writing to them changes the learner."""
        tensors: dict[str, Tensor] = {}
        for kind in ("actor", "critic", "actor_target", "critic_target", "averaged_actor"):
            network: nn.Module = getattr(self, kind)
            tensors |= {f"{kind}.{name}": parameter.detach() for name, parameter in network.named_parameters()}
        for kind, network, vector, optimizer in (
            ("actor", self.actor, self._actor, self.actor_optimizer),
            ("critic", self.critic, self._critic, self.critic_optimizer),
        ):
            state = optimizer.state[vector]
            tensors[f"{kind}_adam.step"] = state["step"]
            for moment in ("exp_avg", "exp_avg_sq"):
                parts = unpack(state[moment], network)
                tensors |= {f"{kind}_adam.{moment}.{name}": part for name, part in parts.items()}
        return tensors


def _row_mirror(config: Config) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Permutation and signs (width,) of a row of replay: both observations and the action; the rest stays."""
    encoded = mirror_encoded(config.lidar.bins, config.networks.encoding)
    parts = [encoded, mirror_actions(), encoded]
    offsets = np.cumsum([0, *(len(part.signs) for part in parts)])
    rest = np.arange(offsets[-1], offsets[-1] + 2)
    permutation = [part.permutation + offset for part, offset in zip(parts, offsets, strict=False)]
    signs = [part.signs for part in parts]
    return np.concatenate([*permutation, rest]), np.concatenate([*signs, np.ones(2, np.float32)])


def _adam(vector: nn.Parameter, lr: float) -> torch.optim.Adam:
    """Adam whose moments exist from the start, so that a saved state has the same names at any time."""
    optimizer = torch.optim.Adam([vector], lr=lr, fused=True)
    optimizer.state[vector] = {
        "step": torch.zeros((), dtype=torch.float32),
        "exp_avg": torch.zeros_like(vector),
        "exp_avg_sq": torch.zeros_like(vector),
    }
    return optimizer
