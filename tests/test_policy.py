"""Policies: the same bits for any batch, the rules for real scans, files that tell when they are bad."""

import json
import math
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from navrl import _navsim
from navrl.config import Config, LidarConfig, NetworksConfig, RobotConfig, WorldConfig
from navrl.mirror import mirror_actions, mirror_encoded
from navrl.policy import Policy, PolicyDescription, PolicyError, load_policy, save_policy
from navrl.policy_description import digest

INF, NAN = math.inf, math.nan


def described(**changes: object) -> PolicyDescription:
    """The default robot's policy but for some keys."""
    return replace(PolicyDescription.from_config(Config()), **changes)  # type: ignore[arg-type]


def random_policy(description: PolicyDescription | None = None, seed: int = 0) -> Policy:
    description = description or described()
    generator = np.random.default_rng(seed)
    sizes = description.layer_sizes
    weights = {}
    for i, (inputs, outputs) in enumerate(pairwise(sizes)):
        name = "output" if i == len(sizes) - 2 else f"hidden.{i}"
        weights[f"{name}.weight"] = (generator.standard_normal((outputs, inputs)) / inputs**0.5).astype(np.float32)
        weights[f"{name}.bias"] = (0.1 * generator.standard_normal(outputs)).astype(np.float32)
    return Policy(weights, description)


def random_observations(count: int, bins: int = 20) -> NDArray[np.float32]:
    generator = np.random.default_rng(1)
    columns = [
        generator.uniform(0, 10, (count, bins)),
        generator.uniform(0.3, 12, (count, 1)),
        generator.uniform(-3.14, 3.14, (count, 1)),
        generator.uniform(0, 1, (count, 1)),
        generator.uniform(-1, 1, (count, 1)),
    ]
    return np.concatenate(columns, axis=1).astype(np.float32)


# Acting


def one_unit(column: int, *, turn_bias: float, symmetric: bool) -> Policy:
    """u = relu(2 x + 0.5) of one of 26 inputs; u + 0.25 and -u + turn_bias go into the tanh."""
    weight = np.zeros((1, 26), np.float32)
    weight[0, column] = 2.0
    weights = {
        "hidden.0.weight": weight,
        "hidden.0.bias": np.array([0.5], np.float32),
        "output.weight": np.array([[1.0], [-1.0]], np.float32),
        "output.bias": np.array([0.25, turn_bias], np.float32),
    }
    return Policy(weights, described(hidden_sizes=(1,), symmetric=symmetric))


def test_actions_by_hand() -> None:
    """One hidden unit that sees only the goal's distance: d / 5 - 1 in column 20."""
    policy = one_unit(20, turn_bias=0.0, symmetric=False)
    observation = np.ones(24, np.float32)
    observation[20] = 6.0
    # relu(2 (6/5 - 1) + 0.5) = 0.9
    assert policy.act(observation) == pytest.approx([math.tanh(1.15), math.tanh(-0.9)], abs=1e-6)
    observation[20] = 1.0
    # relu(2 (1/5 - 1) + 0.5) = 0
    assert policy.act(observation) == pytest.approx([math.tanh(0.25), 0.0], abs=1e-6)


def test_symmetric_actions_by_hand() -> None:
    """One hidden unit that sees only the rightmost bin: 1 / (range + 0.3) - 1 in column 0."""
    policy = one_unit(0, turn_bias=0.5, symmetric=True)
    observation = np.full(24, 0.7, np.float32)
    observation[0], observation[19] = 0.2, 9.7
    # relu(2 (1/0.5 - 1) + 0.5) = 2.5 and, mirrored, relu(2 (1/10 - 1) + 0.5) = 0: outputs 2.75, -2 and 0.25, 0.5
    expected = [math.tanh((2.75 + 0.25) / 2), math.tanh((-2.0 - 0.5) / 2)]
    assert policy.act(observation) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("encoding", ["inverse", "raw"])
def test_a_symmetric_policy_answers_the_mirrored_way_to_what_is_mirrored(encoding: str) -> None:
    policy = random_policy(described(encoding=encoding, hidden_sizes=(33, 20), symmetric=True))
    observations = random_observations(150)
    mirrored = observations[:, [*range(19, -1, -1), 20, 21, 22, 23]]
    mirrored[:, [21, 23]] *= -1
    actions, others = policy.act(observations), policy.act(mirrored)
    assert np.array_equal(others, actions * np.array([1.0, -1.0], np.float32))
    plain = random_policy(replace(policy.description, symmetric=False))
    assert np.abs(plain.act(mirrored) - plain.act(observations) * np.array([1.0, -1.0])).max() > 0.01


@pytest.mark.parametrize("encoding", ["inverse", "raw"])
@pytest.mark.parametrize("hidden_sizes", [(128, 128), (800, 600), (7,), (33, 5, 64)])
def test_a_row_has_the_same_bits_in_every_batch(encoding: str, hidden_sizes: tuple[int, ...]) -> None:
    policy = random_policy(described(encoding=encoding, hidden_sizes=hidden_sizes))
    observations = random_observations(531)
    together = policy.act(observations)
    assert np.array_equal(np.stack([policy.act(row) for row in observations[::15]]), together[::15])
    # Around the blocks of rows that go through the network together.
    for first, count in ((0, 1), (1, 16), (5, 17), (63, 2), (3, 64), (2, 65), (255, 2), (3, 256)):
        assert np.array_equal(policy.act(observations[first : first + count]), together[first : first + count])


@pytest.mark.parametrize("instructions", ["baseline", "avx2"])
def test_a_row_has_the_same_bits_in_every_batch_with_other_instructions(instructions: str) -> None:
    if instructions == "avx2" and _navsim.isa() == "baseline":
        pytest.skip("needs a processor with AVX2")
    this = f"{__file__}::test_a_row_has_the_same_bits_in_every_batch"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", this]
    environment = os.environ | {"NAVRL_ISA": instructions}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


def test_threads_can_share_a_policy() -> None:
    policy, observations = random_policy(described()), random_observations(500)
    expected = policy.act(observations)
    with ThreadPoolExecutor(4) as pool:
        for actions in pool.map(lambda _: policy.act(observations), range(40)):
            assert np.array_equal(actions, expected)


def test_acting_agrees_with_the_networks_actor() -> None:
    torch = pytest.importorskip("torch")
    from navrl.encoding import encode_observations
    from navrl.networks import Actor

    config = NetworksConfig(hidden_sizes=(64, 48))
    actor = Actor(26, config, np.random.default_rng(3))
    weights = {name: tensor.detach().numpy() for name, tensor in actor.named_parameters()}
    observations = random_observations(50)
    encoded = encode_observations(observations, "inverse")
    mirror, turn = mirror_encoded(20, "inverse"), mirror_actions()
    with torch.no_grad():
        outputs = actor.pre_tanh(torch.from_numpy(encoded)).numpy()
        others = actor.pre_tanh(torch.from_numpy(encoded[:, mirror.permutation] * mirror.signs)).numpy()
    for symmetric, expected in ((False, outputs), (True, (outputs + others * turn.signs) / 2)):
        policy = Policy(weights, described(hidden_sizes=(64, 48), symmetric=symmetric))
        np.testing.assert_allclose(policy.act(observations), np.tanh(expected), atol=1e-5)


def test_shapes_of_actions() -> None:
    policy = random_policy()
    observations = random_observations(3)
    assert policy.act(observations[0]).shape == (2,)
    assert policy.act(observations).shape == (3, 2)
    assert policy.act(observations[:0]).shape == (0, 2)
    assert policy.act(observations).dtype == np.float32


@pytest.mark.parametrize(
    ("observations", "message"),
    [
        (np.zeros(23, np.float32), r"expected \(24,\) or \(N, 24\) float32, got \(23,\)"),
        (np.zeros((2, 25), np.float32), r"got \(2, 25\)"),
        (np.zeros((1, 2, 24), np.float32), r"got \(1, 2, 24\)"),
        (np.zeros(24), "float64"),
        (np.float32(1.0), r"got \(\) float32"),
        (np.full(24, NAN, np.float32), "row 0, column 0 is not a finite number"),
    ],
)
def test_bad_observations_are_refused(observations: NDArray[np.float32], message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        random_policy().act(observations)
    assert "\n" not in str(error.value)


def test_the_bad_number_is_named() -> None:
    observations = random_observations(40)
    observations[17, 5] = INF
    with pytest.raises(ValueError, match="row 17, column 5"):
        random_policy().act(observations)


@pytest.mark.parametrize(
    ("name", "tensor", "message"),
    [
        ("hidden.0.weight", np.zeros((128, 25), np.float32), r"hidden.0.weight: expected \(128, 26\) float32"),
        ("hidden.0.bias", np.zeros(128), "hidden.0.bias: .* got .* float64"),
        ("output.bias", np.full(2, NAN, np.float32), "output.bias: holds NaN or infinity"),
        ("layer", np.zeros(1, np.float32), "tensors: expected"),
    ],
)
def test_weights_that_do_not_fit_are_refused(name: str, tensor: NDArray[np.float32], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Policy(random_policy().weights | {name: tensor}, described())


# Commands


class Recorder(Policy):
    """A policy that keeps what `command` made of the scan."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        self.seen = observations
        return super().act(observations)


def recorder(description: PolicyDescription | None = None) -> Recorder:
    description = description or described()
    return Recorder(random_policy(description).weights, description)


STEP = math.pi / 180
OWN_SCAN = (-0.5 * math.pi + 0.5 * STEP, STEP)
"""angle_min and angle_increment of the default lidar."""


def test_the_command_is_that_of_equations_2_and_6() -> None:
    policy = recorder()
    ranges = np.random.default_rng(0).uniform(0.5, 9.0, 180).astype(np.float32)
    v, omega = policy.command(ranges, *OWN_SCAN, (3.0, 4.0), (0.25, -0.5))
    assert np.array_equal(policy.seen[:20], ranges.reshape(20, 9).min(axis=1))
    assert policy.seen[20:] == pytest.approx([5.0, math.atan2(4.0, 3.0), 0.5, -0.5])
    a1, a2 = policy.act(policy.seen)
    assert (v, omega) == pytest.approx((0.5 * (a1 + 1) / 2, 1.0 * a2))


def test_speeds_beyond_the_limits_count_as_the_limits() -> None:
    policy = recorder()
    policy.command(np.full(180, 5.0), *OWN_SCAN, (3.0, 0.0), (-0.1, 1.7))
    assert policy.seen[22:].tolist() == [0.0, 1.0]


def test_a_goal_exactly_behind_stays_within_float32_pi() -> None:
    policy = recorder()
    policy.command(np.full(180, 5.0), *OWN_SCAN, (-3.0, 0.0), (0.0, 0.0))
    assert policy.seen[21] == np.float32(math.pi)
    policy.command(np.full(180, 5.0), *OWN_SCAN, (-3.0, -0.0), (0.0, 0.0))
    assert policy.seen[21] == -np.float32(math.pi)


@pytest.mark.parametrize(
    ("readings", "bin_value"),
    [
        ([INF] * 9, 10.0),
        ([25.0] * 9, 10.0),
        ([-INF] + [3.0] * 8, 0.0),
        ([0.0] + [3.0] * 8, 0.0),
        ([0.05] + [3.0] * 8, 0.2),
        ([NAN] + [3.0] * 8, 3.0),
        ([-1.0] + [3.0] * 8, 3.0),
        ([NAN] * 8 + [4.0], 4.0),
        ([NAN] * 8 + [INF], 10.0),
        ([NAN] * 9, 0.0),
        ([-1.0] * 9, 0.0),
    ],
)
def test_what_becomes_of_readings(readings: list[float], bin_value: float) -> None:
    policy = recorder(described(range_min=0.2))
    ranges = np.full(180, 5.0)
    ranges[9:18] = readings
    policy.command(ranges, *OWN_SCAN, (3.0, 0.0), (0.0, 0.0))
    assert policy.seen[1] == np.float32(bin_value)
    assert policy.seen[[0, 2]].tolist() == [5.0, 5.0]


def test_a_scan_without_a_valid_beam_stops_the_robot() -> None:
    policy = random_policy()
    assert policy.command(np.full(180, NAN), *OWN_SCAN, (3.0, 0.0), (0.5, 0.0)) == (0.0, 0.0)
    # Valid beams behind the robot, outside the policy's view, do not count.
    ranges = np.full(360, NAN)
    ranges[:90] = 5.0
    assert policy.command(ranges, -math.pi + 0.5 * STEP, STEP, (3.0, 0.0), (0.5, 0.0), rebin=True) == (0.0, 0.0)


def test_the_robot_stops_within_the_goal_radius() -> None:
    policy = random_policy()
    assert policy.command(np.full(180, 5.0), *OWN_SCAN, (0.2, 0.2), (0.5, 0.0)) == (0.0, 0.0)
    assert policy.command(np.full(180, 5.0), *OWN_SCAN, (0.3, 0.2), (0.5, 0.0)) != (0.0, 0.0)


def test_another_lidar_is_refused_unless_told_to_rebin() -> None:
    policy = recorder()
    ranges = np.full(360, 5.0)
    with pytest.raises(
        ValueError, match=r"scan of 360 beams .* has 180 from -1.562 rad in steps of 0.01745 rad; rebin=True"
    ):
        policy.command(ranges, 0.0, STEP, (3.0, 0.0), (0.0, 0.0))
    with pytest.raises(ValueError, match="rebin=True"):
        policy.command(ranges[:180], -0.4 * math.pi, STEP, (3.0, 0.0), (0.0, 0.0))
    policy.command(ranges, 0.0, STEP, (3.0, 0.0), (0.0, 0.0), rebin=True)
    assert policy.seen[:20].tolist() == [5.0] * 20


def test_a_clockwise_scan_of_the_own_lidar_is_the_same_scan() -> None:
    policy = recorder()
    ranges = np.random.default_rng(0).uniform(0.5, 9.0, 180)
    policy.command(ranges, *OWN_SCAN, (3.0, 0.0), (0.0, 0.0))
    seen = policy.seen
    policy.command(ranges[::-1], -OWN_SCAN[0], -STEP, (3.0, 0.0), (0.0, 0.0))
    assert np.array_equal(policy.seen, seen)


@pytest.mark.parametrize("start", [0.0, -math.pi, 1.0])
@pytest.mark.parametrize("direction", [1, -1])
def test_beams_are_pooled_by_angle_wherever_the_scan_begins(start: float, direction: int) -> None:
    """A full turn of 720 beams whose ranges tell their angle: r = 2 + angle within the frontal half."""
    angles = start + direction * (np.arange(720) + 0.5) * math.pi / 360
    wrapped = np.arctan2(np.sin(angles), np.cos(angles))
    ranges = np.where(np.abs(wrapped) < math.pi / 2, 2.0 + wrapped, 0.1)
    policy = recorder()
    policy.command(ranges, angles[0], angles[1] - angles[0], (3.0, 0.0), (0.0, 0.0), rebin=True)
    # The nearest beam of bin k is the rightmost one in it, at most half a degree from the bin's right border.
    borders = 2.0 - math.pi / 2 + np.arange(20) * math.pi / 20
    assert np.all(policy.seen[:20] >= borders)
    assert np.all(policy.seen[:20] <= borders + 0.5 * STEP + 1e-6)


def test_bins_that_a_narrow_scan_does_not_see_are_never_clear() -> None:
    policy = recorder()
    ranges = np.full(60, 5.0)
    policy.command(ranges, -math.pi / 6, math.pi / 180, (3.0, 0.0), (0.0, 0.0), rebin=True)
    assert policy.seen[:6].tolist() == [0.0] * 6
    assert policy.seen[7:13].tolist() == [5.0] * 6
    assert policy.seen[14:20].tolist() == [0.0] * 6


def test_the_simulators_own_beams_fall_into_its_own_bins() -> None:
    """Beam i belongs to bin floor((2 i + 1) bins / (2 beams)), also where bins and beams do not divide."""
    for beams, bins in ((180, 20), (181, 20), (37, 7), (360, 24), (5, 2)):
        for fov in (math.pi, 1.5 * math.pi, 2 * math.pi):
            policy = recorder(described(beams=beams, bins=bins, fov=fov, symmetric=False))
            width = fov / beams
            ranges = np.random.default_rng(beams).uniform(0.5, 9.0, beams).astype(np.float32)
            policy.command(ranges, -0.5 * fov + 0.5 * width, width, (3.0, 0.0), (0.0, 0.0))
            members = (2 * np.arange(beams) + 1) * bins // (2 * beams)
            expected = [ranges[members == k].min() for k in range(bins)]
            assert np.array_equal(policy.seen[:bins], expected), (beams, bins, fov)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((2, 90)), *OWN_SCAN, (1.0, 0.0), (0.0, 0.0)), "ranges: expected one row"),
        (([], *OWN_SCAN, (1.0, 0.0), (0.0, 0.0)), "ranges: expected one row"),
        (([None] * 180, *OWN_SCAN, (1.0, 0.0), (0.0, 0.0)), "ranges: expected one row of numbers, got object"),
        ((np.ones(180), NAN, STEP, (1.0, 0.0), (0.0, 0.0)), "angle_min = nan"),
        ((np.ones(180), OWN_SCAN[0], 0.0, (1.0, 0.0), (0.0, 0.0)), "angle_increment = 0"),
        ((np.ones(180), *OWN_SCAN, (NAN, 0.0), (0.0, 0.0)), "goal_in_robot: expected two finite numbers"),
        ((np.ones(180), *OWN_SCAN, (1.0, 0.0, 0.0), (0.0, 0.0)), "goal_in_robot: expected two"),
        ((np.ones(180), *OWN_SCAN, (1.0, 0.0), (0.0, INF)), "last_command: expected two finite numbers"),
    ],
)
def test_bad_arguments_of_command_are_refused(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        random_policy().command(*arguments)  # type: ignore[arg-type]


# Files


def test_a_saved_policy_acts_the_same(tmp_path: Path) -> None:
    description = described(
        hidden_sizes=(16, 8),
        footprint={"kind": "rectangle", "length": 0.5, "width": 0.4},
        mount=(0.1, 0.0, 0.0),
        scores={"list": "test", "success_rate": 0.99, "success_ci95": [0.98, 1.0]},
    )
    policy = random_policy(description)
    save_policy(tmp_path / "run" / "policy", policy.weights, description)
    for folder in (tmp_path / "run", tmp_path / "run" / "policy", str(tmp_path / "run")):
        loaded = load_policy(folder)
        assert loaded.description == description
        assert np.array_equal(loaded.act(random_observations(5)), policy.act(random_observations(5)))
    assert sorted(p.name for p in (tmp_path / "run" / "policy").iterdir()) == ["actor.safetensors", "policy.json"]


def test_keys_of_policy_json(tmp_path: Path) -> None:
    save_policy(tmp_path, random_policy().weights, described())
    record = json.loads((tmp_path / "policy.json").read_text())
    assert set(record) >= {
        "schema", "encoding", "hidden_sizes", "v_max", "omega_max", "beams", "fov", "range_max", "bins", "period_s",
        "footprint", "scores",
    }  # fmt: skip


def test_scores_say_in_which_world(tmp_path: Path) -> None:
    assert PolicyDescription.from_config(Config(), {"spl": 0.8}).scores == {"world": "td3", "spl": 0.8}
    assert PolicyDescription.from_config(Config()).scores is None
    (tmp_path / "office.json").write_text("{}")
    office = Config(world=WorldConfig(name=str(tmp_path / "office.json")))
    assert PolicyDescription.from_config(office, {"spl": 0.8}).scores == {"world": "office.json", "spl": 0.8}


def test_a_description_leads_back_to_the_configuration() -> None:
    config = Config(
        robot=RobotConfig(footprint="rectangle", v_max=0.26, omega_max=1.8, acceleration_max=1.0),
        lidar=LidarConfig(beams=360, fov=2 * math.pi, range_min=0.12, range_max=3.5, bins=24, mount=(-0.03, 0.0, 0.0)),
        networks=NetworksConfig(hidden_sizes=(32, 16), encoding="raw"),
    )
    description = PolicyDescription.from_config(config)
    assert (description.hidden_sizes, description.encoding) == ((32, 16), "raw")
    sim = description.sim_config()
    assert (sim.lidar, sim.task) == (config.lidar, config.task)
    assert sim.robot == replace(config.robot, radius=RobotConfig().radius)


def test_a_description_keeps_the_faults_of_lidar_and_robot(tmp_path: Path) -> None:
    lidar = LidarConfig(noise_per_meter=0.01, resolution=0.005, drop_probability=0.02)
    robot = RobotConfig(delay_steps=2, odometry_noise=0.03)
    description = PolicyDescription.from_config(Config(lidar=lidar, robot=robot))
    save_policy(tmp_path, random_policy(description).weights, description)
    sim = load_policy(tmp_path).description.sim_config()
    assert (sim.lidar, sim.robot) == (lidar, robot)
    # A policy may have been described before there were faults and symmetry.
    sim = load_policy("default").description.sim_config()
    assert (sim.lidar, sim.robot) == (LidarConfig(), RobotConfig())


def test_saving_replaces_the_older_policy(tmp_path: Path) -> None:
    save_policy(tmp_path, random_policy(seed=1).weights, described())
    newer = random_policy(described(hidden_sizes=(8,)), seed=2)
    save_policy(tmp_path, newer.weights, newer.description)
    assert np.array_equal(load_policy(tmp_path).act(random_observations(3)), newer.act(random_observations(3)))


@pytest.mark.parametrize("renames", [0, 1, 2])
def test_a_save_that_is_cut_short_leaves_a_whole_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, renames: int
) -> None:
    """Three renames change the folder: the new weights beside the old, the description, the weights into place."""
    older, newer = random_policy(seed=1), random_policy(seed=2)
    save_policy(tmp_path, older.weights, older.description)
    done: list[Path] = []
    replace_file = os.replace

    def failing(source: Path, target: Path) -> None:
        if len(done) == renames:
            raise OSError("no space left on device")
        done.append(target)
        replace_file(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(OSError, match="no space left"):
        save_policy(tmp_path, newer.weights, newer.description)
    expected = newer if renames == 2 else older
    assert np.array_equal(load_policy(tmp_path).act(random_observations(3)), expected.act(random_observations(3)))


def flip_bit(file: Path, position: int) -> None:
    content = bytearray(file.read_bytes())
    content[position] ^= 1
    file.write_bytes(bytes(content))


@pytest.mark.parametrize("footprint", [None, 5, "x", []])
def test_a_footprint_of_another_type_is_named(tmp_path: Path, footprint: object) -> None:
    save_policy(tmp_path, random_policy().weights, described())
    file = tmp_path / "policy.json"
    record = json.loads(file.read_text()) | {"footprint": footprint}
    file.write_text(json.dumps(record | {"sha256": digest(record)}))
    with pytest.raises(PolicyError, match=r"policy\.json: "):
        load_policy(tmp_path)


def test_one_flipped_bit_in_the_weights_is_found(tmp_path: Path) -> None:
    save_policy(tmp_path, random_policy().weights, described())
    flip_bit(tmp_path / "actor.safetensors", -1000)
    with pytest.raises(PolicyError, match=r"actor.safetensors: damaged: its sha256 is .*, policy.json says"):
        load_policy(tmp_path)


def test_every_flipped_bit_in_the_description_is_found(tmp_path: Path) -> None:
    save_policy(tmp_path, random_policy().weights, described())
    file = tmp_path / "policy.json"
    content = file.read_bytes()
    for position in range(0, len(content), 7):
        # White space between the keys carries nothing.
        if content[position : position + 1].isspace():
            continue
        flip_bit(file, position)
        with pytest.raises(PolicyError, match=r"policy\.json"):
            load_policy(tmp_path)
        file.write_bytes(content)


def test_a_truncated_file_is_found(tmp_path: Path) -> None:
    save_policy(tmp_path, random_policy().weights, described())
    for name in ("actor.safetensors", "policy.json"):
        content = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(content[: len(content) // 2])
        with pytest.raises(PolicyError, match=name):
            load_policy(tmp_path)
        (tmp_path / name).write_bytes(content)


def test_what_is_no_policy_is_named(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="nowhere: no such folder"):
        load_policy(tmp_path / "nowhere")
    with pytest.raises(PolicyError, match="neither a policy folder"):
        load_policy(tmp_path)
    save_policy(tmp_path, random_policy().weights, described())
    (tmp_path / "actor.safetensors").unlink()
    with pytest.raises(PolicyError, match=r"actor\.safetensors: missing"):
        load_policy(tmp_path)
    record = json.loads((tmp_path / "policy.json").read_text())
    (tmp_path / "policy.json").write_text(json.dumps(record | {"schema": 99}))
    with pytest.raises(PolicyError, match="schema 99, but this navrl reads schema 1"):
        load_policy(tmp_path)
    (tmp_path / "policy.json").write_text("[]")
    with pytest.raises(PolicyError, match="not the description of a policy"):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"v_max": 0.0}, "v_max = 0.0: expected > 0"),
        ({"bins": 200}, "beams = 180: expected at least bins = 200"),
        ({"fov": 7.0}, "fov = 7.0: expected at most 2 pi"),
        ({"footprint": {"kind": "disc"}}, "footprint = .*: expected a disc or a rectangle"),
        ({"encoding": "other"}, 'encoding = "other": expected "inverse" or "raw"'),
        ({"mount": (0.0, 0.0)}, r"mount = \[0.0, 0.0\]: expected \[x, y, yaw\]"),
        ({"symmetric": "false"}, 'symmetric = "false": expected true or false'),
        ({"symmetric": 1}, "symmetric = 1: expected true or false"),
        ({"v_max": None}, "v_max = .*: expected a finite number"),
        ({"noise": NAN}, "noise = nan: expected a finite number"),
        ({"beams": 10**400}, "beams = .*: expected a whole number"),
        ({"bins": True}, "bins = true: expected a whole number"),
        ({"hidden_sizes": (16.0, 17.0)}, "hidden_sizes = .*: expected widths"),
        ({"beams": 181, "symmetric": True}, "symmetric = true: expected false where .* lies exactly between two"),
        ({"mount": (0.0, 0.2, 0.0), "symmetric": True}, "the lidar is mounted at y = 0.2"),
    ],
)
def test_descriptions_of_no_robot_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        described(**change)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_acts_while_another_thread_did() -> None:
    """What a thread had in its hands as its process was forked is not waited for in the child."""
    policy = random_policy()
    many, done = random_observations(4000), threading.Event()

    def act() -> None:
        while not done.is_set():
            policy.act(many)

    thread = threading.Thread(target=act)
    thread.start()
    try:
        for _ in range(5):
            child = os.fork()
            if child == 0:
                signal.alarm(20)
                policy.act(many[:1])
                os._exit(0)
            assert os.waitpid(child, 0)[1] == 0
    finally:
        done.set()
        thread.join()


def test_nothing_heavy_is_imported() -> None:
    code = (
        "import sys, navrl.policy; heavy = {'torch', 'pydantic', 'gymnasium'} & set(sys.modules);"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
