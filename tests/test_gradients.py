"""Hand-written passes against autograd on the same networks."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from navrl.config import NetworksConfig
from navrl.gradients import ALIGNED, ActorPass, CriticPass, pack, unpack
from navrl.networks import Actor, TwinCritic
from navrl.streams import stream

INPUTS = 9
SIZES = [(8, 6), (5, 4, 3), (32, 16), (6, 7, 8, 9)]


def _batch(size: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(size)
    encoded = torch.randn(size, INPUTS + 3, generator=generator, dtype=torch.float64)
    # Rows with other columns between them, as in a packed batch
    return encoded[:, :INPUTS], torch.rand(size, 2, generator=generator, dtype=torch.float64)


def _gradients(loss: Tensor, network: torch.nn.Module) -> list[Tensor]:
    """By autograd, without touching the parameters' own."""
    return list(torch.autograd.grad(loss, [p for p in network.parameters() if p.requires_grad]))


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("batch_size", [1, 5, 40])
def test_actor_pass(sizes: tuple[int, ...], batch_size: int) -> None:
    config = NetworksConfig(hidden_sizes=sizes, initialization="torch")
    actor = Actor(INPUTS, config, stream(0, "test")).double()
    pack(actor)
    encoded, upper = _batch(batch_size)
    own = ActorPass(actor, batch_size)
    for _ in range(2):
        outputs = actor.pre_tanh(encoded)
        torch.testing.assert_close(own.forward(encoded), outputs)
        own.backward(upper.clone())
        for expected, p in zip(_gradients((outputs * upper).sum(), actor), actor.parameters(), strict=True):
            torch.testing.assert_close(p.grad, expected)


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("batch_size", [1, 5, 40])
@pytest.mark.parametrize("num_critics", [1, 2, 3])
@pytest.mark.parametrize("frozen", [False, True])
def test_critic_pass(sizes: tuple[int, ...], batch_size: int, num_critics: int, frozen: bool) -> None:
    config = NetworksConfig(hidden_sizes=sizes, initialization="torch", frozen_combined=frozen)
    critic = TwinCritic(INPUTS, config, stream(0, "test"), num_critics=num_critics).double()
    pack(critic)
    encoded, actions = _batch(batch_size)
    upper = torch.randn(num_critics, batch_size, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    values = critic(encoded, actions)
    own = CriticPass(critic, batch_size)
    torch.testing.assert_close(own.forward(encoded, actions), values)
    own.backward(upper.clone())
    trained = [p for p in critic.parameters() if p.requires_grad]
    assert len(trained) == 2 * len(sizes) + (0 if frozen else 3)
    for expected, p in zip(_gradients((values * upper).sum(), critic), trained, strict=True):
        torch.testing.assert_close(p.grad, expected)
    if frozen:
        assert not any(p.grad.any() for p in critic.parameters() if not p.requires_grad and p.grad is not None)


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("critics", [1, 2])
def test_action_gradient(sizes: tuple[int, ...], critics: int) -> None:
    """Of the first critics; parameters' gradients stay as they were."""
    critic = TwinCritic(INPUTS, NetworksConfig(hidden_sizes=sizes), stream(0, "test")).double()
    vector = pack(critic)
    encoded, actions = _batch(5)
    actions.requires_grad_(True)
    values = critic(encoded, actions)[:critics]
    own = CriticPass(critic, 5, critics=critics)
    upper = torch.full_like(values, -0.2)
    torch.testing.assert_close(own.forward(encoded, actions.detach()), values)
    (expected,) = torch.autograd.grad((values * upper).sum(), actions)
    torch.testing.assert_close(own.action_gradient(upper), expected)
    assert vector.grad is not None
    assert not vector.grad.any()


def test_pack_keeps_values_and_shares_memory() -> None:
    actor = Actor(INPUTS, NetworksConfig(hidden_sizes=(5, 3)), stream(0, "test"))
    before = {name: p.detach().clone() for name, p in actor.named_parameters()}
    vector = pack(actor)
    assert all(torch.equal(p, before[name]) for name, p in actor.named_parameters())
    with torch.no_grad():
        vector.mul_(2.0)
    parts = unpack(vector.detach(), actor)
    for name, p in actor.named_parameters():
        assert torch.equal(p, 2.0 * before[name])
        assert torch.equal(parts[name], p)
        assert p.data_ptr() % (4 * ALIGNED) == vector.data_ptr() % (4 * ALIGNED)
        assert p.grad is not None
        p.grad.fill_(1.0)
    assert vector.grad is not None
    assert vector.grad.sum() == sum(p.numel() for p in actor.parameters())
