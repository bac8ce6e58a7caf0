"""A small learner to test, and TD3 written plainly: networks apart, Adam as its paper prints it, loops over batches."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from navrl.config import Config, LearnerConfig, LidarConfig, NetworksConfig
from navrl.encoding import encoded_size
from navrl.replay import Replay, row_width
from navrl.streams import stream
from navrl.target_bounds import target_bounds
from navrl.td3 import TD3

BINS, SEED = 6, 3
KERNEL = "auto"
"""What computes the updates of a small learner, unless a test says otherwise."""


def small_config(networks: NetworksConfig | None = None, **learner: object) -> Config:
    """A small learner with the defaults' options."""
    return Config(
        lidar=LidarConfig(bins=BINS),
        networks=networks or NetworksConfig(hidden_sizes=(12, 10)),
        learner=LearnerConfig(**{"batch_size": 7, "kernel": KERNEL, **learner}),  # type: ignore[arg-type]
    )


def made_up_replay(config: Config, rows: int = 50) -> Replay:
    """Made-up rows; a fifth of them terminal."""
    generator = np.random.default_rng(1)
    replay = Replay(64, row_width(encoded_size(BINS, config.networks.encoding)))
    numbers = generator.normal(0.0, 1.0, (rows, replay.width)).astype(np.float32)
    numbers[:, -1] = np.where(generator.random(rows) < 0.2, 0.0, 0.95)
    replay.add(numbers)
    return replay


def small_learner(config: Config, dtype: torch.dtype = torch.float32) -> TD3:
    """A learner of its own made-up rows."""
    return TD3(config, made_up_replay(config), seed=SEED, dtype=dtype)


class PlainCritic(nn.Module):
    """One critic of equation 7 from separate linear layers."""

    def __init__(self, state: dict[str, NDArray[np.generic]], name: str, number: int, *, frozen: bool) -> None:
        super().__init__()
        layers = sum(key.startswith(f"{name}.weights.") for key in state)
        weights = [torch.from_numpy(state[f"{name}.weights.{i}"][number]) for i in range(layers)]
        biases = [torch.from_numpy(state[f"{name}.biases.{i}"][number, 0]) for i in range(layers)]
        self.w = nn.ParameterList(weight.clone() for weight in weights)
        self.b = nn.ParameterList(bias.clone() for bias in biases)
        self.w_action = nn.Parameter(torch.from_numpy(state[f"{name}.action_weight"][number]).T.clone())
        self.frozen = frozen

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Q of one observation and one action."""
        w_state, w_action, bias = self.w[1], self.w_action, self.b[1]
        if self.frozen:
            w_state, w_action, bias = w_state.detach(), w_action.detach(), bias.detach()
        hidden = (self.w[0] @ observation + self.b[0]).relu()
        hidden = (w_state @ hidden + w_action @ action + bias).relu()
        for w, b in list(zip(self.w, self.b, strict=True))[2:-1]:
            hidden = (w @ hidden + b).relu()
        return (self.w[-1] @ hidden + self.b[-1])[0]


class PlainActor(nn.Module):
    """The actor of equation 8, one observation at a time."""

    def __init__(self, state: dict[str, NDArray[np.generic]], name: str) -> None:
        super().__init__()
        layers = sum(key.startswith(f"{name}.hidden.") for key in state) // 2
        names = [f"{name}.hidden.{i}" for i in range(layers)] + [f"{name}.output"]
        self.w = nn.ParameterList(torch.from_numpy(state[f"{n}.weight"]).clone() for n in names)
        self.b = nn.ParameterList(torch.from_numpy(state[f"{n}.bias"]).clone() for n in names)

    def forward(self, observation: Tensor) -> Tensor:
        """What goes into tanh."""
        hidden = observation
        for w, b in list(zip(self.w, self.b, strict=True))[:-1]:
            hidden = (w @ hidden + b).relu()
        return self.w[-1] @ hidden + self.b[-1]


class PlainAdam:
    """Adam as its paper prints it."""

    def __init__(self, parameters: list[nn.Parameter], lr: float) -> None:
        self.parameters, self.lr, self.t = parameters, lr, 0
        self.m = [torch.zeros_like(p) for p in parameters]
        self.v = [torch.zeros_like(p) for p in parameters]

    def step(self, loss: Tensor) -> None:
        """One step down the gradient of `loss`; parameters that it does not depend on stay."""
        self.t += 1
        gradients = torch.autograd.grad(loss, self.parameters, allow_unused=True)
        for p, m, v, g in zip(self.parameters, self.m, self.v, gradients, strict=True):
            if g is not None:
                m.copy_(0.9 * m + 0.1 * g)
                v.copy_(0.999 * v + 0.001 * g * g)
                with torch.no_grad():
                    p -= self.lr * (m / (1 - 0.9**self.t)) / ((v / (1 - 0.999**self.t)).sqrt() + 1e-8)


class PlainTD3:
    """The update with separate networks and loops over the batch, from the state of a learner."""

    def __init__(self, config: Config, replay: Replay, state: dict[str, NDArray[np.generic]]) -> None:
        self.config, self.options, self.replay = config, config.learner, replay
        self.twin = self.options.algorithm == "td3"
        frozen, critics = config.networks.frozen_combined, range(2 if self.twin else 1)
        self.critics = [PlainCritic(state, "critic", i, frozen=frozen) for i in critics]
        self.critic_targets = [PlainCritic(state, "critic_target", i, frozen=frozen) for i in critics]
        self.actor, self.actor_target = PlainActor(state, "actor"), PlainActor(state, "actor_target")
        parameters = [p for critic in self.critics for p in critic.parameters()]
        self.critic_adam = PlainAdam(parameters, self.options.critic_lr)
        self.actor_adam = PlainAdam(list(self.actor.parameters()), self.options.actor_lr)
        self.indices, self.mirror, self.noise = (
            stream(SEED, name) for name in ("replay_indices", "mirror", "target_noise")
        )
        self.updates = 0

    def row(self, index: int, *, mirrored: bool) -> tuple[Tensor, ...]:
        """Observation, action, successor, return and bootstrap factor of a row, perhaps mirrored."""
        row = torch.from_numpy(self.replay.rows[index]).double()
        size = encoded_size(BINS, self.config.networks.encoding)
        parts = list(row.split([size, 2, size, 1, 1]))
        if mirrored:
            for i in (0, 2):
                rest = parts[i][BINS:].clone()
                rest[[1, -1]] *= -1.0
                parts[i] = torch.cat([parts[i][:BINS].flip(0), rest])
            parts[1] = parts[1] * torch.tensor([1.0, -1.0], dtype=torch.float64)
        return tuple(parts)

    def update(self) -> None:
        """One update."""
        options, size = self.options, self.options.batch_size
        indices = self.indices.integers(self.replay.size, size=size)
        flips = self.mirror.random(size, np.float32) < 0.5 if options.mirror else np.zeros(size, bool)
        sigma = options.policy_noise if self.twin else 0.0
        noise = self.noise.standard_normal((size, 2), np.float32) * np.float32(sigma) if sigma else np.zeros((size, 2))
        rows = [self.row(i, mirrored=bool(f)) for i, f in zip(indices, flips, strict=True)]
        low, high = target_bounds(self.config)
        loss = torch.zeros((), dtype=torch.float64)
        for (s, a, s2, reward, bootstrap), n in zip(rows, torch.from_numpy(noise).double(), strict=True):
            with torch.no_grad():
                clipped = n.clamp(-options.noise_clip, options.noise_clip)
                a2 = (self.actor_target(s2).tanh() + clipped).clamp(-1.0, 1.0)
                y = reward[0] + bootstrap[0] * min(critic(s2, a2) for critic in self.critic_targets)
                if options.clip_targets:
                    y = y.clamp(low, high)
            for critic in self.critics:
                loss = loss + (critic(s, a) - y) ** 2 / size
        self.critic_adam.step(loss)
        self.updates += 1
        if self.updates % (options.policy_delay if self.twin else 1) == 0:
            self.update_actor([row[0] for row in rows])

    def update_actor(self, observations: list[Tensor]) -> None:
        """The delayed part."""
        loss = torch.zeros((), dtype=torch.float64)
        for s in observations:
            z = self.actor(s)
            loss = loss - self.critics[0](s, z.tanh()) / len(observations)
            loss = loss + self.options.pretanh_penalty * (z**2).mean() / len(observations)
        self.actor_adam.step(loss)
        pairs = [(self.actor_target, self.actor), *zip(self.critic_targets, self.critics, strict=True)]
        for target, online in pairs:
            for p_target, p in zip(target.parameters(), online.parameters(), strict=True):
                p_target.data = self.options.tau * p.data + (1 - self.options.tau) * p_target.data
