"""Configuration: defaults and presets, where a value comes from, and the way to a file and back."""

import dataclasses
import json
import math
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from conftest import Writer
from navrl import _navsim
from navrl.config import Config, SimConfig
from navrl.config.controllers import TUNABLE
from navrl.config.files import PRESETS, ROBOTS, Option, load_config, to_toml
from navrl.config.levels import REAL
from navrl.config.ranges import allowed, choices, keys
from navrl.config.reference import reference
from navrl.errors import ConfigError

REPOSITORY = Path(__file__).parents[1]
BUILT_IN = '"td3", "boxes", "open8", "walls", "mixed" or the path of an existing .json file'


# What is accepted


def test_the_defaults_are_the_fast_preset() -> None:
    assert load_config() == load_config(preset="fast") == Config()


def test_defaults_agree_with_the_design() -> None:
    config = Config()
    assert (config.training.num_envs, config.training.steps, config.training.updates_per_step) == (256, 1_000_000, 4.67)
    assert config.networks.hidden_sizes == (128, 128)
    assert (config.learner.batch_size, config.learner.n_step, config.learner.policy_delay) == (96, 11, 3)
    assert (config.learner.critic_lr, config.learner.actor_lr, config.learner.tau) == (2.5e-3, 7.5e-4, 0.035)
    assert math.isclose(1 / (1 - config.learner.gamma), 215, rel_tol=1e-12)
    assert (config.reward.goal, config.reward.collision, config.reward.progress) == (100.0, -445.0, 35.0)
    assert (config.lidar.beams, config.lidar.bins, config.lidar.fov, config.lidar.range_max) == (180, 20, math.pi, 10.0)


def test_the_core_tests_and_benches_use_these_defaults() -> None:
    text = (REPOSITORY / "crates" / "navsim" / "tests" / "defaults.json").read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(json.dumps(dataclasses.asdict(SimConfig())))


def test_the_paper_preset_is_the_papers() -> None:
    config = load_config(preset="paper")
    assert config.networks.hidden_sizes == (800, 600)
    assert (config.training.num_envs, config.training.episodes, config.training.steps) == (1, 800, 0)
    assert config.training.update_schedule == "per_episode"
    learner = config.learner
    assert (learner.batch_size, learner.critic_lr, learner.actor_lr, learner.tau) == (40, 1e-3, 1e-3, 0.005)
    assert (learner.policy_delay, learner.gamma, learner.n_step, learner.delayed_steps) == (2, 0.99999, 1, 10)
    assert (learner.policy_noise, learner.noise_clip, learner.reward_scale) == (0.2, 0.5, 1.0)
    assert (learner.mirror, learner.pretanh_penalty, learner.averaging_rate) == (False, 0.0, 0.0)
    assert (config.reward.goal, config.reward.collision, config.reward.progress) == (100.0, -100.0, 0.0)
    noise = config.exploration
    assert (noise.schedule, noise.sigma_start, noise.sigma_end, noise.sigma_steps) == ("linear", 1.0, 0.1, 500_000)
    assert (noise.forced, noise.forced_probability, noise.forced_range) == (True, 0.15, 0.6)
    assert (noise.forced_steps_min, noise.forced_steps_max) == (8, 15)
    assert (config.validation.every_steps, config.validation.scenarios) == (5000, 100)
    assert config.world.goal_range_start == 5.0


@pytest.mark.parametrize("name", [name for name in PRESETS if name != "fast"])
def test_a_preset_holds_only_what_differs_from_the_defaults(name: str) -> None:
    preset = tomllib.loads(files("navrl").joinpath("presets", f"{name}.toml").read_text(encoding="utf-8"))
    defaults = tomllib.loads(to_toml(Config()))
    same = [
        f"{table}.{key}"
        for table, values in preset.items()
        for key, value in values.items()
        if value == defaults[table][key]
    ]
    # The footprint of a robot is stated even where it is the default: a robot's file speaks for itself.
    assert [key for key in same if key != "robot.footprint"] == []


@pytest.mark.parametrize(("robot", "v_max", "omega_max"), [(ROBOTS[0], 0.22, 2.84), (ROBOTS[1], 0.26, 1.82)])
def test_robots_have_their_published_limits_and_lidar(robot: str, v_max: float, omega_max: float) -> None:
    config = load_config(preset="paper", robot=robot)
    assert (config.robot.v_max, config.robot.omega_max) == (v_max, omega_max)
    assert (config.lidar.beams, config.lidar.range_min, config.lidar.range_max) == (360, 0.12, 3.5)
    assert config.lidar.fov == 2 * math.pi
    assert config.learner.batch_size == 40


def test_an_int_serves_as_float(config_file: Writer) -> None:
    config = load_config(config_file("[robot]\nradius = 1\n"))
    assert isinstance(config.robot.radius, float)
    assert config.robot.radius == 1.0


def test_configurations_are_immutable_values() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Config().learner.tau = 0.5  # type: ignore[misc]
    assert hash(Config()) == hash(Config())


def test_sim_is_what_the_core_reads() -> None:
    config = load_config(preset="paper", robot=ROBOTS[1])
    record = dataclasses.asdict(config.sim)
    assert list(record) == ["world", "robot", "lidar", "task", "reward"]
    assert json.loads(json.dumps(record))["lidar"]["mount"] == [-0.064, 0.0, 0.0]


# Where a value comes from


def test_precedence_is_defaults_preset_robot_file_options(config_file: Writer) -> None:
    file = config_file("[learner]\ntau = 0.3\nbatch_size = 30\n[robot]\nv_max = 0.3\n")
    options = [Option("--learner.tau", "learner.tau", "0.4")]
    config = load_config(file, preset="paper", robot=ROBOTS[0], options=options)
    assert config.learner.tau == 0.4
    assert config.learner.batch_size == 30
    assert config.robot.v_max == 0.3
    assert config.robot.omega_max == 2.84
    assert config.learner.n_step == 1
    assert config.replay.capacity == 1_000_000


def test_the_level_stands_beneath_a_file_but_for_what_it_is(config_file: Writer) -> None:
    real = load_config(level="real")
    assert (real.robot.delay_steps, real.lidar.noise) == (REAL["robot"]["delay_steps"], REAL["lidar"]["noise"])
    assert real.planner.margin != Config().planner.margin
    file = config_file("[robot]\ndelay_steps = 3\nv_max = 0.4\n[planner]\nmargin = 0.15\n[dwa]\nmargin = 0.07\n")
    config = load_config(file, level="real", options=[Option("--dwa.speed", "dwa.speed", "3")])
    assert (config.robot.delay_steps, config.robot.v_max) == (1, 0.4)
    assert (config.planner.margin, config.dwa.margin, config.dwa.speed) == (0.15, 0.07, 3.0)
    assert config.dwa.horizon == real.dwa.horizon != Config().dwa.horizon
    with pytest.raises(ConfigError, match=r"^--robot\.delay_steps: is set by --level real$"):
        load_config(level="real", options=[Option("--robot.delay_steps", "robot.delay_steps", "1")])
    with pytest.raises(ConfigError, match="--level"):
        load_config(level="dream")  # type: ignore[arg-type]


def test_the_settings_of_a_level_are_classical_ones_only() -> None:
    tables = tomllib.loads(files("navrl").joinpath("presets", "real.toml").read_text(encoding="utf-8"))
    assert set(tables) <= {*TUNABLE, "planner"}


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("learner.algorithm", "ddpg", "ddpg"),
        ("learner.algorithm", '"ddpg"', "ddpg"),
        ("learner.mirror", "false", False),
        ("networks.hidden_sizes", "[64, 32]", (64, 32)),
        ("reward.collision", "-3", -3.0),
        ("training.steps", "2_000", 2000),
        ("learner.gamma", "5e-1", 0.5),
    ],
)
def test_options_are_toml_values_and_bare_words_strings(key: str, text: str, value: object) -> None:
    table, name = key.split(".")
    config = load_config(options=[Option(f"--{key}", key, text)])
    assert getattr(getattr(config, table), name) == value


def test_an_option_cannot_smuggle_in_another_setting() -> None:
    expected = re.escape('--learner.tau: learner.tau = "0.1\\ngamma = 0.5": must be a number')
    with pytest.raises(ConfigError, match=expected):
        load_config(options=[Option("--learner.tau", "learner.tau", "0.1\ngamma = 0.5")])


def test_the_last_of_several_options_counts() -> None:
    options = [Option("--seed", "training.seed", "1"), Option("--training.seed", "training.seed", "2")]
    assert load_config(options=options).training.seed == 2


def test_a_world_file_counts_from_the_folder_of_the_file_that_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "room.json").write_text("{}")
    (tmp_path / "my.toml").write_text('[world]\nname = "room.json"\n')
    assert load_config(tmp_path / "my.toml").world.name == str(tmp_path / "room.json")
    monkeypatch.chdir(tmp_path)
    config = load_config(options=[Option("--world", "world.name", "room.json")])
    assert config.world.name == str(tmp_path / "room.json")


def test_a_byte_order_mark_is_no_obstacle(config_file: Writer) -> None:
    assert load_config(config_file(b"\xef\xbb\xbf[learner]\ntau = 0.5\n")).learner.tau == 0.5


# Round trips


def values_of(key: str) -> st.SearchStrategy[Any]:
    """A strategy for the values that a setting may have."""
    words, text = choices(Config, key), allowed(Config, key)
    if words:
        return st.sampled_from(words)
    if text == "true or false":
        return st.booleans()
    if key == "world.name":
        return st.sampled_from(["td3", "boxes", "open8", "walls", "mixed"])
    if key == "networks.hidden_sizes":
        return st.lists(st.integers(1, 8192), min_size=2, max_size=8).map(tuple)
    if key == "lidar.mount":
        return st.tuples(*[st.floats(-10, 10)] * 3)
    low, high = text[text.index("[" if "[" in text else "(") + 1 : -1].split(", ")
    if text.startswith("a whole number"):
        return st.integers(int(low), int(high))
    return st.floats(float(low), float(high), exclude_min="in (" in text, exclude_max=text.endswith(")"))


changes = st.lists(st.sampled_from(keys(Config)), max_size=5, unique=True).flatmap(
    lambda names: st.fixed_dictionaries({name: values_of(name) for name in names})
)


@settings(
    max_examples=200, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(changes)
def test_toml_reads_back_to_the_same_configuration_bit_for_bit(tmp_path: Path, changes: dict[str, object]) -> None:
    config = Config()
    for key, value in changes.items():
        table, name = key.split(".")
        try:
            config = dataclasses.replace(
                config, **{table: dataclasses.replace(getattr(config, table), **{name: value})}
            )
        except ConfigError:
            assume(False)
    (tmp_path / "again.toml").write_text(to_toml(config), encoding="utf-8")
    again = load_config(tmp_path / "again.toml")
    # repr tells 0.0 from -0.0, which are equal.
    assert again == config
    assert repr(again) == repr(config)


@settings(max_examples=200, derandomize=True, deadline=None)
@given(changes)
def test_the_core_accepts_what_python_accepts(changes: dict[str, object]) -> None:
    sim = SimConfig()
    for key, value in changes.items():
        table, name = key.split(".")
        if hasattr(sim, table):
            changed = dataclasses.replace(getattr(sim, table), **{name: value})
            try:
                sim = dataclasses.replace(sim, **{table: changed})
            except ConfigError:
                assume(False)
    assert _navsim.read_list("", json.dumps(dataclasses.asdict(sim))) == ([], [])


def test_the_core_knows_every_key_and_no_other() -> None:
    tables = dataclasses.asdict(SimConfig())
    for table, values in tables.items():
        for name in values:
            without = {**tables, table: {key: value for key, value in values.items() if key != name}}
            with pytest.raises(ValueError, match=f"missing field `{name}`"):
                _navsim.read_list("", json.dumps(without))
        with pytest.raises(ValueError, match="unknown field `other`"):
            _navsim.read_list("", json.dumps({**tables, table: {**values, "other": 1}}))


@pytest.mark.parametrize(
    ("table", "name", "value"),
    [
        ("lidar", "bins", 181),
        ("lidar", "fov", 7.0),
        ("lidar", "noise", -1.0),
        ("robot", "radius", 0.0),
        ("robot", "v_max", -1.0),
        ("task", "period", 0.0),
        ("world", "boxes", 65),
        ("world", "goal_range_max", 1.0),
        ("reward", "goal", 1e7),
    ],
)
def test_the_core_refuses_ranges_by_itself(table: str, name: str, value: float) -> None:
    tables = dataclasses.asdict(SimConfig())
    tables[table][name] = value
    with pytest.raises(ValueError, match=f"{table}.{name}"):
        _navsim.read_list("", json.dumps(tables))


def test_toml_has_a_header_for_each_table_and_one_setting_a_line() -> None:
    lines = to_toml(Config()).splitlines()
    tables = [line for line in lines if line.startswith("[")]
    assert tables == [f"[{field.name}]" for field in dataclasses.fields(Config)]
    assert sum(" = " in line for line in lines) == len(keys(Config)) == len(lines) - 2 * len(tables) + 1


def test_awkward_path_names_survive(tmp_path: Path) -> None:
    folder = tmp_path / 'a "quoted" \\ folder\x7f with\ttab'
    folder.mkdir()
    (folder / "wörld.json").write_text("{}")
    config = load_config(options=[Option("--world", "world.name", str(folder / "wörld.json"))])
    (tmp_path / "again.toml").write_text(to_toml(config), encoding="utf-8")
    assert load_config(tmp_path / "again.toml") == config


# The page


def test_the_reference_page_is_the_generated_one() -> None:
    committed = (REPOSITORY / "docs" / "configuration.md").read_text(encoding="utf-8")
    assert committed == reference(), "run: python -m navrl.config.reference docs/configuration.md"


def test_the_reference_page_names_every_setting_with_its_meaning() -> None:
    page = reference()
    rows = [line for line in page.splitlines() if line.startswith("| `") and line.count("|") == 6]
    assert len(rows) == len(keys(Config))
    assert all(row.split("|")[-2].strip() for row in rows)
