"""TD3, with DDPG as its one-critic case (equations 9 and 10).

    TD3(config, replay, seed=, dtype=torch.float32)
        .update(count) -> UpdateMetrics            `count` updates; counted in .updates and .actor_updates
        .act(encoded (N, inputs)) -> (N, 2)        the actor, which explores;  numpy in, numpy out
        .policy -> Actor                           what is evaluated and kept: the averaged actor, or the actor itself
        .policy_weights() -> dict[str, ndarray]    its tensors, copied, by the names of navrl.networks.Actor
        .average_actor()                           once per vector step
        .set_progress(fraction)                    share of the run that is over, for the step sizes
        .state() -> dict[str, ndarray];  .restore(state)
    target_bounds(config) -> (low, high)

Determinism: the bits depend on the calls, the processor model, the builds and the thread count, not on how updates are
grouped into calls. `update` leaves denormals flushed to zero in the calling thread and in threads started from it.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from navrl.config import Config, NetworksConfig
from navrl.networks import ACTIONS, Actor, TwinCritic, encoded_size, mirror_actions, mirror_encoded
from navrl.replay import Arrays, NonFiniteError, Replay, row_width
from navrl.streams import restore_stream, stream, stream_state

SATURATED = 2.6466524
"""|input of the actor's tanh| beyond which an output counts as saturated: |output| > 0.99, gradient under 0.02."""

BLOCK = 64
"""Most updates whose rows are gathered together; bounds the memory of a call."""


@dataclass(frozen=True)
class UpdateMetrics:
    """Means over the updates of one call."""

    critic_loss: float
    """Mean squared error of the critics' values, summed over the critics."""
    average_q: float
    """Mean value of the sampled actions over batch and critics, scaled as rewards are."""
    maximum_q: float
    """Largest such value."""
    actor_loss: float
    """Minus the first critic's mean value of the actor's actions, plus the penalty; NaN without an actor step."""
    saturated_share: float
    """Share of the actor's outputs beyond 0.99 in size; NaN without an actor step."""


class Batch(NamedTuple):
    """What one update learns from."""

    observations: Tensor
    """(B, inputs) encoded."""
    actions: Tensor
    """(B, 2)."""
    successors: Tensor
    """(B, inputs) encoded."""
    returns: Tensor
    """(B,) R: the n-step return, scaled."""
    bootstrap: Tensor
    """(B,) gamma^m, or 0 after a terminal step."""
    noise: Tensor
    """(B, 2) clipped noise on the target's actions."""


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
        torch.set_flush_denormal(True)
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

    def _build(self, networks: NetworksConfig, *, num_critics: int, generator: np.random.Generator) -> None:
        """Makes networks, targets and optimisers."""
        self.actor = Actor(self.inputs, networks, generator).to(self.dtype)
        self.critic = TwinCritic(self.inputs, networks, generator, num_critics=num_critics).to(self.dtype)
        self.actor_target = copy.deepcopy(self.actor).requires_grad_(False)
        self.critic_target = copy.deepcopy(self.critic).requires_grad_(False)
        self.averaged_actor = copy.deepcopy(self.actor).requires_grad_(False)
        self.critic_optimizer = _adam(self.critic, self.config.critic_lr)
        self.actor_optimizer = _adam(self.actor, self.config.actor_lr)
        self._online = [*self.critic.parameters(), *self.actor.parameters()]
        self._targets = [*self.critic_target.parameters(), *self.actor_target.parameters()]

    @property
    def policy(self) -> Actor:
        """The averaged actor, or the actor itself where averaging is off."""
        return self.averaged_actor if self.config.averaging_rate > 0 else self.actor

    def policy_weights(self) -> dict[str, NDArray[np.float32]]:
        """Copies of the policy's tensors, float32, by the names of `navrl.networks.Actor`."""
        return {name: tensor.float().numpy().copy() for name, tensor in self.policy.state_dict().items()}

    def act(self, encoded: NDArray[np.float32]) -> NDArray[np.float32]:
        """The actor's actions, without noise.

        Args:
            encoded: (N, inputs) encoded observations.

        Returns:
            (N, 2) float32 in [-1, 1].
        """
        with torch.no_grad():
            return self.actor(torch.tensor(encoded, dtype=self.dtype)).float().numpy()

    def update(self, count: int) -> UpdateMetrics:
        """Makes `count` updates.

        Args:
            count: Updates, at least 1.

        Returns:
            Their metrics.

        Raises:
            ValueError: If replay is empty.
            NonFiniteError: If a loss or a parameter is NaN or infinite after the call. The networks are of no more use
                then; what was saved before the call is sound, for every call before this one ended finite.
        """
        if self.replay.size == 0:
            raise ValueError("no rows in replay to learn from")
        critic_losses, values, actor_losses, pre_tanh = [], [], [], []
        for batch in self._batches(count):
            self.updates += 1
            loss, value = self._update_critics(batch)
            critic_losses.append(loss)
            values.append(value)
            if self.updates % self.policy_delay == 0:
                self.actor_updates += 1
                loss, outputs = self._update_actor(batch.observations)
                actor_losses.append(loss)
                pre_tanh.append(outputs)
                # Eq. 10: theta' <- tau theta + (1 - tau) theta'
                torch._foreach_lerp_(self._targets, self._online, self.config.tau)
        self._refuse_non_finite(critic_losses)
        values_tensor = torch.stack(values)
        return UpdateMetrics(
            critic_loss=_mean(critic_losses),
            average_q=float(values_tensor.mean()),
            maximum_q=float(values_tensor.max()),
            actor_loss=_mean(actor_losses),
            saturated_share=_mean([(outputs.abs() > SATURATED).to(self.dtype) for outputs in pre_tanh]),
        )

    def _update_critics(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """One step of the critics; returns the loss () and the values (num_critics, B) before it."""
        with torch.no_grad():
            # Eq. 9: y = R + gamma^m (1 - terminated) min(Q1', Q2')(s', clip(mu'(s') + clip(N(0, sigma), +-c), +-1))
            actions = (self.actor_target(batch.successors) + batch.noise).clamp_(-1.0, 1.0)
            value = self.critic_target(batch.successors, actions).amin(0)
            target = torch.addcmul(batch.returns, batch.bootstrap, value)
            if self.bounds is not None:
                target.clamp_(*self.bounds)
        values: Tensor = self.critic(batch.observations, batch.actions)
        # Sum over the critics of the mean over the batch of (Q - y)^2
        loss = (values - target).square().sum() / len(target)
        self.critic_optimizer.zero_grad()
        loss.backward()
        self.critic_optimizer.step()
        return loss.detach(), values.detach()

    def _update_actor(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """One step of the actor; returns the loss () and the inputs of its tanh (B, 2) before it."""
        outputs = self.actor.pre_tanh(observations)
        # Mean of -Q1(s, mu(s)), and the penalty that keeps tanh from saturating
        loss = -self.critic.first(observations, torch.tanh(outputs)).mean()
        if self.config.pretanh_penalty > 0:
            loss = loss + self.config.pretanh_penalty * outputs.square().mean()
        self.actor_optimizer.zero_grad()
        loss.backward()
        self.actor_optimizer.step()
        return loss.detach(), outputs.detach()

    def average_actor(self) -> None:
        """Moves the averaged actor by `averaging_rate` of its way to the actor."""
        if self.config.averaging_rate > 0:
            averaged, actor = list(self.averaged_actor.parameters()), list(self.actor.parameters())
            with torch.no_grad():
                torch._foreach_lerp_(averaged, actor, self.config.averaging_rate)

    def set_progress(self, fraction: float) -> None:
        """Sets the step sizes: linear from full to `final_lr_fraction` over the run.

        Args:
            fraction: Share of the run that is over, in [0, 1].
        """
        self.progress = fraction
        share = 1.0 - (1.0 - self.config.final_lr_fraction) * fraction
        self.critic_optimizer.param_groups[0]["lr"] = self.config.critic_lr * share
        self.actor_optimizer.param_groups[0]["lr"] = self.config.actor_lr * share

    def _batches(self, count: int) -> Iterator[Batch]:
        """Draws and gathers the rows of `count` updates, `BLOCK` updates at a time."""
        for first in range(0, count, BLOCK):
            yield from self._block(min(BLOCK, count - first))

    def _block(self, count: int) -> Iterator[Batch]:
        """Draws and gathers the rows of `count` updates at once."""
        shape = (count, self.config.batch_size)
        indices = self._streams["replay_indices"].integers(self.replay.size, size=shape)
        rows = torch.empty(*shape, self.replay.width)
        array = rows.view(-1, self.replay.width).numpy()
        self.replay.sample(indices.ravel(), out=array)
        if self._mirror is not None:
            mirrored = self._streams["mirror"].random(indices.size, np.float32) < 0.5
            permutation, signs = self._mirror
            array[mirrored] = array[mirrored][:, permutation] * signs
        parts = rows.to(self.dtype).split([self.inputs, ACTIONS, self.inputs, 1, 1], dim=2)
        observations, actions, successors, returns, bootstrap = parts
        noise = torch.from_numpy(self._target_noise((*shape, ACTIONS))).to(self.dtype)
        for i in range(count):
            # Copies, so that a batch lies in memory the same way wherever in the block it stands.
            yield Batch(
                observations[i].contiguous(),
                actions[i].contiguous(),
                successors[i].contiguous(),
                returns[i, :, 0],
                bootstrap[i, :, 0],
                noise[i],
            )

    def _target_noise(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Draws clip(N(0, policy_noise), +-noise_clip), or zeros where it is off."""
        if self.policy_noise == 0.0:
            return np.zeros(shape, np.float32)
        noise = self._streams["target_noise"].standard_normal(shape, np.float32) * np.float32(self.policy_noise)
        return np.clip(noise, -self.config.noise_clip, self.config.noise_clip)

    def _refuse_non_finite(self, losses: list[Tensor]) -> None:
        """Raises NonFiniteError if a loss or a parameter is NaN or infinite."""
        norms = torch.stack([*losses, *torch._foreach_norm(self._online)])
        if not norms.isfinite().all():
            names = [f"critic loss of update {self.updates - len(losses) + 1 + i}" for i in range(len(losses))]
            for kind, network in (("critic", self.critic), ("actor", self.actor)):
                names += [f"{kind} {name}" for name, _ in network.named_parameters()]
            bad = int(torch.nonzero(~norms.isfinite())[0, 0])
            raise NonFiniteError(f"{names[bad]} is not finite after {self.updates} updates")

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
        for name, generator in self._streams.items():
            restore_stream(generator, state[f"streams.{name}"].astype(np.uint64))
        with torch.no_grad():
            for name, tensor in tensors.items():
                tensor.copy_(torch.from_numpy(np.asarray(state[name])))
        self.updates, self.actor_updates = int(state["updates"]), int(state["actor_updates"])
        self.set_progress(float(state["progress"]))

    def _tensors(self) -> dict[str, Tensor]:
        """Parameters and Adam's moments and step counts by name; writing to them changes the learner."""
        networks = {
            "actor": self.actor,
            "critic": self.critic,
            "actor_target": self.actor_target,
            "critic_target": self.critic_target,
            "averaged_actor": self.averaged_actor,
        }
        tensors = {f"{n}.{name}": p.detach() for n, network in networks.items() for name, p in network.named_parameters()}
        for n, network, optimizer in (
            ("actor_adam", self.actor, self.actor_optimizer),
            ("critic_adam", self.critic, self.critic_optimizer),
        ):
            for name, parameter in network.named_parameters():
                for key, tensor in optimizer.state.get(parameter, {}).items():
                    tensors[f"{n}.{name}.{key}"] = tensor
        return tensors


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
    collision = reward.collision - 0.5 - progress

    def discounted(step: float, end: float, count: int) -> float:
        # sum over k < count of gamma^k step, then gamma^count end
        return step * (1.0 - learner.gamma**count) / (1.0 - learner.gamma) + learner.gamma**count * end

    high = max(goal, discounted(best, goal, steps - 1), discounted(best, 0.0, steps))
    low = min(collision, discounted(worst, collision, steps - 1), discounted(worst, 0.0, steps))
    return learner.reward_scale * low, learner.reward_scale * high


def _row_mirror(config: Config) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Permutation and signs (width,) of a row of replay: both observations and the action; the rest stays."""
    encoded = mirror_encoded(config.lidar.bins, config.networks.encoding)
    parts = [encoded, mirror_actions(), encoded]
    offsets = np.cumsum([0, *(len(part.signs) for part in parts)])
    rest = np.arange(offsets[-1], offsets[-1] + 2)
    permutation = [part.permutation + offset for part, offset in zip(parts, offsets, strict=False)]
    signs = [part.signs for part in parts]
    return np.concatenate([*permutation, rest]), np.concatenate([*signs, np.ones(2, np.float32)])


def _adam(network: nn.Module, lr: float) -> torch.optim.Adam:
    """Adam whose moments exist from the start, so that a saved state has the same names at any time."""
    parameters = [parameter for parameter in network.parameters() if parameter.requires_grad]
    optimizer = torch.optim.Adam(parameters, lr=lr, fused=True)
    for parameter in parameters:
        optimizer.state[parameter] = {
            "step": torch.zeros((), dtype=torch.float32),
            "exp_avg": torch.zeros_like(parameter),
            "exp_avg_sq": torch.zeros_like(parameter),
        }
    return optimizer


def _mean(tensors: list[Tensor]) -> float:
    """Mean over all elements; NaN of none."""
    return float(torch.stack(tensors).mean()) if tensors else float("nan")
