"""The update against a plain, slow formulation of its own, and what a learner promises beside its numbers."""

from __future__ import annotations

from dataclasses import replace
from math import isnan

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from navrl.batch import BatchSim
from navrl.config import Config, LearnerConfig, NetworksConfig, RewardConfig, RobotConfig, SimConfig, TaskConfig
from navrl.delayed_reward import delayed_reward
from navrl.encoding import encoded_size
from navrl.mirror import mirror_actions, mirror_encoded
from navrl.replay import NonFiniteError, Replay, row_width
from navrl.streams import stream
from navrl.target_bounds import most_steps, target_bounds
from navrl.td3 import BLOCK, TD3, flushed_denormals
from plain_td3 import BINS, SEED, PlainActor, PlainCritic, PlainTD3, made_up_replay, small_config, small_learner


@pytest.fixture(params=["native", "torch"], autouse=True)
def kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every test, for both."""
    name: str = request.param
    monkeypatch.setattr("plain_td3.KERNEL", name)
    return name


def _assert_same(plain: PlainTD3, td3: TD3) -> None:
    """All networks agree to 1e-9 of their size."""
    state = td3.state()
    for name, actor in (("actor", plain.actor), ("actor_target", plain.actor_target)):
        for p, expected in zip(actor.parameters(), PlainActor(state, name).parameters(), strict=True):
            torch.testing.assert_close(p, expected, rtol=1e-9, atol=1e-10)
    for name, critics in (("critic", plain.critics), ("critic_target", plain.critic_targets)):
        for number, critic in enumerate(critics):
            same = PlainCritic(state, name, number, frozen=False)
            for p, expected in zip(critic.parameters(), same.parameters(), strict=True):
                torch.testing.assert_close(p, expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("algorithm", ["td3", "ddpg"])
@pytest.mark.parametrize(
    ("networks", "learner"),
    [
        ({}, {}),
        ({"hidden_sizes": (9, 8, 5)}, {"policy_delay": 2}),
        ({"hidden_sizes": (5, 6, 7, 8)}, {"policy_delay": 1, "batch_size": 1}),
        ({"encoding": "raw", "initialization": "torch"}, {"mirror": False, "policy_delay": 2, "policy_noise": 0.2}),
        ({"initialization": "torch", "frozen_combined": True}, {"tau": 0.3}),
        ({}, {"pretanh_penalty": 0.0, "policy_noise": 0.0}),
        ({}, {"pretanh_penalty": 2.0, "noise_clip": 0.02, "gamma": 0.5}),
        ({}, {"clip_targets": True, "reward_scale": 1e-3}),
    ],
)
def test_update_equals_the_plain_formulation(
    algorithm: str, networks: dict[str, object], learner: dict[str, object]
) -> None:
    sizes = {"hidden_sizes": (12, 10), **networks}
    config = small_config(NetworksConfig(**sizes), algorithm=algorithm, **learner)  # type: ignore[arg-type]
    td3 = small_learner(config, torch.float64)
    plain = PlainTD3(config, td3.replay, td3.state())
    _assert_same(plain, td3)
    for _ in range(15):
        plain.update()
    td3.update(15)
    _assert_same(plain, td3)


def test_clipped_targets_differ_from_free_ones() -> None:
    """The case above clips for real."""
    config = small_config(clip_targets=True, reward_scale=1e-3)
    free = small_config(clip_targets=False, reward_scale=1e-3)
    assert small_learner(config).update(3) != small_learner(free).update(3)


def test_metrics_are_those_of_the_plain_formulation() -> None:
    config = small_config(policy_delay=2)
    td3 = small_learner(config, torch.float64)
    plain = PlainTD3(config, td3.replay, td3.state())
    indices = stream(SEED, "replay_indices").integers(50, size=7)
    flips = stream(SEED, "mirror").random(7, np.float32) < 0.5
    rows = [plain.row(i, mirrored=bool(f)) for i, f in zip(indices, flips, strict=True)]
    values = [critic(row[0], row[1]).item() for critic in plain.critics for row in rows]
    metrics = td3.update(1)
    assert metrics.average_q == pytest.approx(np.mean(values))
    assert metrics.maximum_q == pytest.approx(max(values))
    assert isnan(metrics.actor_loss)
    assert isnan(metrics.saturated_share)
    loss = metrics.critic_loss
    assert loss == pytest.approx(_critic_loss(plain, rows))
    # The second update steps the actor, with the critic after its own second step.
    plain.update()
    indices, mirror = stream(SEED, "replay_indices"), stream(SEED, "mirror")
    index = indices.integers(50, size=(2, 7))[1]
    flips = mirror.random(14, np.float32)[7:] < 0.5
    observations = [plain.row(i, mirrored=bool(f))[0] for i, f in zip(index, flips, strict=True)]
    before = [plain.actor(s).detach() for s in observations]
    plain.update()
    metrics = td3.update(1)
    penalty = config.learner.pretanh_penalty
    expected = [
        (penalty * (z**2).mean() - plain.critics[0](s, z.tanh())).item()
        for s, z in zip(observations, before, strict=True)
    ]
    assert metrics.actor_loss == pytest.approx(np.mean(expected))
    assert metrics.saturated_share == 0.0


def _critic_loss(plain: PlainTD3, rows: list[tuple[Tensor, ...]]) -> float:
    """Sum over the critics of the mean squared error before the first update."""
    noise = stream(SEED, "target_noise").standard_normal((len(rows), 2), np.float32)
    noise *= np.float32(plain.options.policy_noise)
    losses = []
    for (s, a, s2, reward, bootstrap), n in zip(rows, torch.from_numpy(noise).double(), strict=True):
        a2 = (plain.actor_target(s2).tanh() + n).clamp(-1.0, 1.0)
        y = (reward[0] + bootstrap[0] * min(critic(s2, a2) for critic in plain.critic_targets)).item()
        losses.append(sum((critic(s, a).item() - y) ** 2 for critic in plain.critics))
    return float(np.mean(losses))


def test_saturated_share_counts_outputs_beyond_0_99() -> None:
    td3 = small_learner(small_config(policy_delay=1, pretanh_penalty=0.0))
    for actor in (td3.actor, td3.actor_target):
        with torch.no_grad():
            actor.output.weight.zero_()
            # tanh(2.7) = 0.991, tanh(-2.6) = -0.989
            actor.output.bias.copy_(torch.tensor([2.7, -2.6]))
    assert td3.update(1).saturated_share == 0.5


def test_pretanh_penalty_brings_a_saturated_actor_back() -> None:
    """Without it the gradient of a saturated output vanishes; with it the inputs of tanh shrink."""
    inputs = {}
    for penalty in (0.0, 1.0):
        td3 = small_learner(small_config(policy_delay=1, pretanh_penalty=penalty, actor_lr=1e-2))
        with torch.no_grad():
            td3.actor.output.bias.fill_(20.0)
        td3.update(200)
        inputs[penalty] = td3.actor.pre_tanh(torch.from_numpy(td3.replay.rows[:, : td3.inputs])[:20]).abs().mean()
    assert inputs[0.0] > 15.0
    assert inputs[1.0] < 0.75 * inputs[0.0]


def test_frozen_combined_layer_never_changes() -> None:
    frozen = small_learner(small_config(NetworksConfig(hidden_sizes=(12, 10), frozen_combined=True)))
    trained = small_learner(small_config())
    for td3, same in ((frozen, True), (trained, False)):
        before = td3.state()
        td3.update(10)
        after = td3.state()
        for name in ("critic.weights.1", "critic.action_weight", "critic.biases.1"):
            assert np.array_equal(before[name], after[name]) == same
        for name in ("critic.weights.0", "critic.weights.2", "critic.biases.2"):
            assert not np.array_equal(before[name], after[name])


def test_mirrored_row_is_what_a_mirrored_world_would_store() -> None:
    """A learner that draws every row mirrored learns what one does from mirrored rows."""
    config = small_config(mirror=False)
    td3, mirrored = small_learner(config), small_learner(small_config())
    encoded, action = mirror_encoded(BINS, "inverse"), mirror_actions()
    size, rows = td3.inputs, td3.replay.rows
    for start in (0, size + 2):
        rows[:, start : start + size] = rows[:, start : start + size][:, encoded.permutation] * encoded.signs
    rows[:, size : size + 2] *= action.signs

    class AlwaysMirror:
        """Draws that are all below one half."""

        def random(self, count: int, dtype: type) -> NDArray[np.float32]:
            return np.zeros(count, dtype)

    mirrored._streams["mirror"] = AlwaysMirror()  # type: ignore[assignment]
    td3.update(6)
    mirrored.update(6)
    for a, b in zip(td3._online, mirrored._online, strict=True):
        assert torch.equal(a, b)


def test_half_of_the_rows_are_mirrored() -> None:
    config = small_config(batch_size=1000)
    td3 = TD3(config, made_up_replay(config), seed=SEED)
    plain = TD3(replace(config, learner=replace(config.learner, mirror=False)), made_up_replay(config), seed=SEED)
    pairs = zip(td3._batches(10), plain._batches(10), strict=True)
    changed = [(mirrored.rows != drawn.rows).any(1).float().mean() for mirrored, drawn in pairs]
    # Five standard errors of 10,000 draws: 0.025
    assert float(torch.stack(changed).mean()) == pytest.approx(0.5, abs=0.025)


def _assert_bitwise(a: TD3, b: TD3) -> None:
    first, second = a.state(), b.state()
    assert list(first) == list(second)
    for name, array in first.items():
        assert array.dtype == second[name].dtype, name
        assert array.tobytes() == second[name].tobytes(), name


@pytest.mark.parametrize("algorithm", ["td3", "ddpg"])
@pytest.mark.parametrize("batch_size", [1, 7, 64])
def test_restored_learner_continues_bitwise(algorithm: str, batch_size: int) -> None:
    config = small_config(algorithm=algorithm, batch_size=batch_size)
    td3 = small_learner(config)
    td3.set_progress(0.3)
    td3.update(5)
    td3.begin_step()
    saved = {name: array.copy() for name, array in td3.state().items()}
    td3.update(4)
    restored = small_learner(config)
    restored.update(2)
    restored.restore(saved)
    metrics = restored.update(4)
    _assert_bitwise(td3, restored)
    td3.begin_step()
    restored.begin_step()
    # A new process at the end is in the state of the old one, and goes on alike.
    assert td3.update(3) == restored.update(3)
    _assert_bitwise(td3, restored)
    assert metrics.average_q != 0.0


def test_grouping_of_updates_into_calls_changes_nothing() -> None:
    one, many = small_learner(small_config()), small_learner(small_config())
    one.update(BLOCK + 13)
    for count in (1, 2, 3, 1, 5, 30, BLOCK - 29):
        many.update(count)
    _assert_bitwise(one, many)


def test_state_is_a_copy() -> None:
    td3 = small_learner(small_config())
    before = td3.state()
    kept = {name: array.tobytes() for name, array in before.items()}
    td3.update(3)
    assert all(array.tobytes() == kept[name] for name, array in before.items())


def test_restore_refuses_other_shapes_and_seeds_untouched() -> None:
    td3 = small_learner(small_config())
    other = small_learner(small_config(NetworksConfig(hidden_sizes=(12, 11))))
    before = {name: array.tobytes() for name, array in td3.state().items()}
    with pytest.raises(ValueError, match=r"shape \(11, 12\), this run needs \(10, 12\)"):
        td3.restore(other.state())
    missing = td3.state()
    del missing["critic_adam.step"]
    with pytest.raises(ValueError, match=r"critic_adam\.step has shape None"):
        td3.restore(missing)
    with pytest.raises(ValueError, match="another seed"):
        td3.restore(TD3(small_config(), td3.replay, seed=SEED + 1).state())
    assert {name: array.tobytes() for name, array in td3.state().items()} == before


def test_seeds_differ_and_repeat() -> None:
    config = small_config()
    same, again = TD3(config, made_up_replay(config), seed=1), TD3(config, made_up_replay(config), seed=1)
    other = TD3(config, made_up_replay(config), seed=2)
    for td3 in (same, again, other):
        td3.update(3)
    _assert_bitwise(same, again)
    assert not torch.equal(same._online[0], other._online[0])


def test_global_random_state_is_left_alone() -> None:
    torch.manual_seed(0)
    before = torch.get_rng_state()
    td3 = small_learner(small_config())
    td3.update(2)
    assert torch.equal(before, torch.get_rng_state())


@pytest.mark.parametrize("column", [0, 6, -2])
def test_not_a_number_in_replay_stops_the_update(column: int, kernel: str) -> None:
    td3 = small_learner(small_config(batch_size=64))
    td3.update(2)
    td3.replay.rows[: td3.replay.size, column] = np.nan
    seen = "of replay is not finite in column" if kernel == "native" else "the critics' error in update 3 is not finite"
    with pytest.raises(NonFiniteError, match=seen):
        td3.update(2)


@pytest.mark.parametrize(
    ("network", "torch_sees", "native_sees"),
    [
        ("actor", "a parameter of the actor", "entry 0 of the actor's parameters"),
        ("critic", "critics", "entry 0 of the critic's parameters"),
    ],
)
def test_infinite_parameter_stops_the_update(network: str, torch_sees: str, native_sees: str, kernel: str) -> None:
    td3 = small_learner(small_config(policy_delay=1000))
    with torch.no_grad():
        next(getattr(td3, network).parameters())[0, 0] = float("inf")
    with pytest.raises(NonFiniteError, match=native_sees if kernel == "native" else torch_sees):
        td3.update(1)


def test_denormals_are_flushed_where_asked_and_nowhere_else() -> None:
    """Otherwise the moments of dead units decay into them and slow every update down."""
    small = torch.full((64,), 2e-38)

    def kept() -> bool:
        return bool((small * 0.01).all())

    small_learner(small_config()).update(1)
    assert kept()
    with flushed_denormals():
        assert not kept()
        with flushed_denormals(False):
            assert kept()
        assert not kept()
        with flushed_denormals():
            pass
        assert not kept()
    assert kept()
    with pytest.raises(ZeroDivisionError), flushed_denormals():
        raise ZeroDivisionError
    assert kept()


def test_no_rows_no_update() -> None:
    config = small_config()
    td3 = TD3(config, Replay(8, row_width(encoded_size(BINS, "inverse"))))
    with pytest.raises(ValueError, match="no rows"):
        td3.update(1)
    with pytest.raises(ValueError, match="rows of 5 columns, expected 28"):
        TD3(config, Replay(8, 5))


def test_step_sizes_fall_linearly() -> None:
    td3 = small_learner(small_config(critic_lr=1e-2, actor_lr=1e-3, final_lr_fraction=0.2))
    for progress, share in ((0.0, 1.0), (0.5, 0.6), (1.0, 0.2)):
        td3.set_progress(progress)
        assert td3.critic_optimizer.param_groups[0]["lr"] == pytest.approx(1e-2 * share)
        assert td3.actor_optimizer.param_groups[0]["lr"] == pytest.approx(1e-3 * share)


def test_averaged_actor_is_the_policy() -> None:
    td3 = small_learner(small_config(averaging_rate=0.25, policy_delay=1))
    start = td3.policy_weights()
    td3.update(5)
    online = {name: tensor.numpy().copy() for name, tensor in td3.actor.state_dict().items()}
    assert all(np.array_equal(array, start[name]) for name, array in td3.policy_weights().items())
    td3.begin_step()
    for name, array in td3.policy_weights().items():
        np.testing.assert_allclose(array, 0.25 * online[name] + 0.75 * start[name], atol=1e-6)
    off = small_learner(small_config(averaging_rate=0.0))
    off.update(3)
    off.begin_step()
    assert off.policy is off.actor


def test_the_actor_acts_as_it_was_when_the_step_began() -> None:
    td3 = small_learner(small_config())
    td3.update(6)
    td3.begin_step()
    encoded = np.random.default_rng(0).normal(size=(9, td3.inputs)).astype(np.float32)
    actions = td3.act(encoded)
    assert actions.dtype == np.float32
    expected = np.tanh(td3.actor.pre_tanh(torch.from_numpy(encoded)).detach().numpy())
    np.testing.assert_allclose(actions, expected, atol=1e-6)
    td3.update(6)
    assert td3.act(encoded).tobytes() == actions.tobytes()
    td3.begin_step()
    assert td3.act(encoded).tobytes() != actions.tobytes()


def test_target_bounds_of_the_paper_by_hand() -> None:
    """500 steps of at most 0.5 and at least -1.5 a step; 499 of them and the goal with its delayed reward."""
    paper = RewardConfig(goal=100.0, collision=-100.0, progress=0.0)
    learner = LearnerConfig(gamma=0.0, n_step=1, delayed_steps=10, reward_scale=1.0)
    shares = 100.0 * sum(1.0 / i for i in range(1, 11))
    # Only the next step counts: the last one before the goal has its motion and all of the goal's reward.
    assert target_bounds(Config(reward=paper, learner=learner)) == pytest.approx((-100.0, 100.0 + 0.5))
    far = replace(learner, gamma=1.0 - 1e-9)
    bounds = (-499 * 1.5 - 100.0, 499 * 0.5 + 100.0 + shares)
    assert target_bounds(Config(reward=paper, learner=far)) == pytest.approx(bounds, rel=1e-5)
    # Never a goal: the most comes from driving until the time limit.
    poor = replace(paper, goal=0.0)
    assert target_bounds(Config(reward=poor, learner=far))[1] == pytest.approx(250.0, rel=1e-5)
    # halves: 1/2 and -1 a step; progress of 0.05 m a step at 10 per metre; half of it all
    halves = replace(paper, form="halves", progress=10.0)
    config = Config(reward=halves, learner=replace(far, reward_scale=0.5, delayed_steps=0))
    bounds = (0.5 * (-499 * 1.5 - 100.5), 0.5 * (499 * 1.0 + 100.5))
    assert target_bounds(config) == pytest.approx(bounds, rel=1e-5)


@pytest.mark.parametrize("delayed", [0, 4, 100])
def test_target_bounds_hold_for_discounted_episodes(delayed: int) -> None:
    """Extremes at any length, found by trying all of them, reward by reward."""
    config = Config(
        robot=RobotConfig(v_max=1.5, omega_max=0.7),
        task=TaskConfig(time_limit=3.0, period=0.1),
        reward=RewardConfig(goal=5.0, collision=-2.0, progress=4.0),
        learner=LearnerConfig(gamma=0.9, reward_scale=2.0, delayed_steps=delayed),
    )
    best, worst = 1.5 + 4.0 * 0.15, -0.7 - 0.5 - 4.0 * 0.15

    def returns(step: float, end: float, shared: float) -> list[float]:
        ended = []
        for n in range(30):
            rewards = [*(step + shared * delayed_reward(n - k, 5.0, delayed) for k in range(n)), end]
            ended.append(sum(0.9**k * reward for k, reward in enumerate(rewards)))
        return [*ended, sum(0.9**k * step for k in range(30))]

    expected = (2.0 * min(returns(worst, -2.0 - 0.6, 0.0)), 2.0 * max(returns(best, 5.0 + 0.6, 1.0)))
    assert target_bounds(config) == pytest.approx(expected)


@pytest.mark.parametrize(("time_limit", "steps"), [(0.05, 1), (0.1, 1), (0.25, 3), (0.34, 3)])
def test_most_steps_are_those_of_the_simulator(time_limit: float, steps: int) -> None:
    task = TaskConfig(time_limit=time_limit, period=0.1)
    sim = BatchSim(SimConfig(task=task), num_envs=1, autoreset=False)
    made = 0
    while not sim.truncated[0]:
        sim.step(np.array([[-1.0, 0.0]], np.float32))
        made += 1
    assert most_steps(task) == made == steps
