"""Configuration: everything that cannot be used is refused in one line, with its source, key, value and range."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from conftest import Writer
from navrl.config import (
    Config,
    LearnerConfig,
    LidarConfig,
    NetworksConfig,
    ReplayConfig,
    RobotConfig,
    SimConfig,
    TaskConfig,
    TrainingConfig,
    WorldConfig,
)
from navrl.config.files import PRESETS, ROBOTS, Option, load_config, load_sim
from navrl.config.ranges import allowed, choices, keys
from navrl.errors import ConfigError, UserError, shown

BUILT_IN = '"td3", "boxes", "open8", "walls", "mixed" or the path of an existing .json file'


def refusal(**sources: Any) -> str:  # noqa: ANN401 - what load_config takes
    """The line with which the sources are refused."""
    with pytest.raises(ConfigError) as caught:
        load_config(**sources)
    line = str(caught.value)
    assert "\n" not in line
    return line


def outcome(**sources: Any) -> str:  # noqa: ANN401 - what load_config takes
    """The refusal, or one word if there is none."""
    try:
        load_config(**sources)
    except ConfigError as error:
        return str(error)
    return "accepted"


# Single settings

FAULTS = {
    "[learner]\ntaus = 1": "learner.taus: no such key; did you mean learner.tau?",
    "[learner]\ncapacity = 1": "learner.capacity: no such key; did you mean replay.capacity?",
    "[learner]\nxyz = 1": "learner.xyz: no such key; [learner] has algorithm, kernel,",
    "tau = 0.1": "tau: no such table or key; did you mean learner.tau?",
    "[lerner]\ntau = 0.1": "lerner: no such table or key; did you mean learner?",
    "[x.y.z]\na = 1": "x: no such table or key; tables are world, robot,",
    '["a\\nb"]': '"a\\nb": no such table or key',
    "learner = 3": "learner = 3: must be a table, [learner]",
    "[[learner]]\ntau = 1": "learner = [{tau = 1}]: must be a table, [learner]",
    "[learner.tau]\nx = 1": "learner.tau = {x = 1}: must be a number in (0, 1]",
    "[learner]\ntau = 0": "learner.tau = 0: must be a number in (0, 1]",
    "[learner]\ntau = 1.5": "learner.tau = 1.5: must be a number in (0, 1]",
    "[learner]\ntau = nan": "learner.tau = nan: must be a number in (0, 1]",
    "[lidar]\nrange_max = inf": "lidar.range_max = inf: must be a number in (0, 1000]",
    "[lidar]\nmount = [0, 0, -inf]": "lidar.mount = [0, 0, -inf]: must be a list of 3 numbers in [-10, 10]",
    "[lidar]\nmount = [0, 0]": "lidar.mount = [0, 0]: must be a list of 3 numbers",
    "[lidar]\nmount = [0, 0, 0, 0]": "must be a list of 3 numbers",
    "[lidar]\nmount = 0": "lidar.mount = 0: must be a list of 3 numbers",
    '[learner]\ntau = "0.1"': 'learner.tau = "0.1": must be a number',
    "[learner]\ntau = true": "learner.tau = true: must be a number",
    "[learner]\nmirror = 1": "learner.mirror = 1: must be true or false",
    "[learner]\nmirror = 'yes'": 'learner.mirror = "yes": must be true or false',
    "[learner]\nbatch_size = 1.0": "learner.batch_size = 1.0: must be a whole number in [1, 65_536]",
    "[learner]\nbatch_size = true": "learner.batch_size = true: must be a whole number",
    "[learner]\ngamma = 1": "learner.gamma = 1: must be a number in [0, 1)",
    "[training]\nseed = -1": "training.seed = -1: must be a whole number in [0, ",
    "[training]\nseed = 9223372036854775808": "training.seed = 9223372036854775808: must be a whole number",
    "[training]\nseed = " + "9" * 4000: "...: must be a whole number",
    "[training]\nseed = 0x" + "f" * 9000: "training.seed = 0xff",
    "[robot]\nradius = " + "9" * 4000: "...: must be a number in (0, 10]",
    "[training]\nseed = 2026-01-31": "training.seed = 2026-01-31: must be a whole number",
    "[training]\nuntil = 1": "training.until = 1: must be a number in [0, 1)",
    "[networks]\nhidden_sizes = [128]": "hidden_sizes = [128]: must be a list of 2 to 8 whole numbers in [1, 8192]",
    "[networks]\nhidden_sizes = [128, 0]": "must be a list of 2 to 8 whole numbers",
    "[networks]\nhidden_sizes = [128, 1.5]": "must be a list of 2 to 8 whole numbers",
    "[networks]\nhidden_sizes = [true, true]": "must be a list of 2 to 8 whole numbers",
    '[learner]\nalgorithm = "TD3"': 'learner.algorithm = "TD3": must be "td3" or "ddpg"',
    '[learner]\nalgorithm = "ddgp"': "did you mean ddpg?",
    '[lidar]\ncaster = "rastr"': 'must be "auto", "raster" or "parry"; did you mean raster?',
    '[world]\nname = "td4"': f'world.name = "td4": must be {BUILT_IN}; did you mean td3?',
    '[world]\nname = "missing.json"': f'missing.json": must be {BUILT_IN}',
    '[world]\nname = "my.toml"': f"must be {BUILT_IN}",
    "[world]\nboxes = 65": "world.boxes = 65: must be a whole number in [0, 64]",
    "[validation]\nscenarios = 1001": "validation.scenarios = 1001: must be a whole number in [1, 1000]",
    "[checkpoint]\nkeep = 1": "checkpoint.keep = 1: must be a whole number in [2, 1000]",
    "[reward]\ncollision = 1": "reward.collision = 1: must be a number in [-1_000_000, 0]",
    "[learner]\ntau = 2\ngamma = 2\n[robot]\nv_max = 0": "robot.v_max = 0: must be a number in (0, 100] (and 2 more)",
    "[learner]\ntau": "line 2: not valid TOML:",
    "[learner]\n\ntau = = 1": "line 3, column 7: not valid TOML:",
    "[a]\n[a]": "line 2, column 3: not valid TOML:",
    "[learner]\ntau = 1\ntau = 1": "line 3: not valid TOML:",
    "x = " + "[" * 100_000: "not valid TOML",
    "x = " + "9" * 5000: "not valid TOML",
    b"[learner]\ntau = 0.1 # \xff": "line 2: not UTF-8 text",
    b"\x00": "line 1, column 1: not valid TOML:",
    b"#" * (1 << 21): "is larger than 1_048_576 bytes",
}


@pytest.mark.parametrize(("content", "expected"), FAULTS.items(), ids=lambda value: repr(value)[:40])
def test_every_fault_is_one_line_with_file_key_value_and_range(
    config_file: Writer, content: str | bytes, expected: str
) -> None:
    file = config_file(content)
    line = refusal(file=file)
    assert line.startswith(f"{file}: ")
    assert expected in line
    assert len(line) < 600


def test_every_setting_is_refused_out_of_its_range_and_type() -> None:
    for key in keys(Config):
        line = refusal(options=[Option("--it", key, "{ a = 1 }")])
        assert line == f"--it: {key} = {{a = 1}}: must be {allowed(Config, key)}"
    floats = [key for key in keys(Config) if allowed(Config, key).startswith("a number in")]
    assert len(floats) > 30
    for key in floats:
        for text in ("nan", "inf", "-inf", "true", '"1"', "1e300", "-1e300"):
            assert f"{key} = " in refusal(options=[Option("--it", key, text)])
    for key in [key for key in keys(Config) if choices(Config, key)]:
        assert f'{key} = "zzz"' in refusal(options=[Option("--it", key, "zzz")])


@pytest.mark.parametrize(
    ("path", "expected"),
    [("nowhere.toml", "no such file"), (".", "is a folder, not a file"), ("my.toml/x", "cannot be read")],
)
def test_files_that_cannot_be_read(config_file: Writer, tmp_path: Path, path: str, expected: str) -> None:
    config_file("")
    assert refusal(file=tmp_path / path).startswith(f"{tmp_path / path}: {expected}")


def test_presets_and_robots_are_known_names() -> None:
    assert refusal(preset="papr") == f'--preset: "papr": must be one of {", ".join(PRESETS)}; did you mean paper?'
    assert refusal(robot="fast") == f'--robot: "fast": must be one of {", ".join(ROBOTS)}'


def test_options_name_themselves() -> None:
    assert refusal(options=[Option("--seed", "training.seed", "x")]).startswith('--seed: training.seed = "x": must be')
    line = refusal(options=[Option("--learner.tua", "learner.tua", "1")])
    assert line == "--learner.tua: learner.tua: no such key; did you mean learner.tau?"


def test_a_world_name_that_is_no_text_is_refused(tmp_path: Path) -> None:
    name = "\udcff.json"
    (tmp_path / name).write_text("{}")
    assert "world.name" in refusal(options=[Option("--world", "world.name", str(tmp_path / name))])


# Combinations

COMBINATIONS = {
    "[lidar]\nbeams = 19": "lidar.bins = 20: must be at most beams = 19",
    "[lidar]\nbins = 181": "lidar.bins = 181: must be at most beams = 180",
    "[lidar]\nrange_min = 10": "lidar.range_min = 10.0: must be below range_max = 10.0",
    "[world]\ngoal_range_max = 9": "world.goal_range_max = 9.0: must be at least goal_range_start = 10.0",
    "[world]\ngoal_range_start = 0.7": "world.goal_range_start = 0.7: must be above 0.7071: in this world",
    '[world]\nname = "boxes"\ngoal_range_start = 1.4': "world.goal_range_start = 1.4: must be above 1.4142",
    "[task]\ntime_limit = 0.04": "task.time_limit = 0.04: must be 1 to 1000000 periods of 0.1 s",
    "[task]\nperiod = 0.001\ntime_limit = 1001": "task.time_limit = 1001.0: must be 1 to 1000000 periods",
    '[task]\ncollision = "sensor"\nsensor_range = 10': "task.sensor_range = 10.0: must be between lidar.range_min",
    '[task]\ncollision = "sensor"\nsensor_range = 0.1\n[lidar]\nrange_min = 0.1': "sensor_range = 0.1: must be between",
    "[training]\nsteps = 0": "training.steps = 0: must be at least 1, unless training.episodes is set",
    '[training]\nupdate_schedule = "per_episode"': "training.num_envs = 256: must be 1 with update_schedule",
    "[exploration]\nsigma_min = 0.5": "exploration.sigma_min = 0.5: must be at most sigma_max = 0.43",
    '[exploration]\nschedule = "linear"\nsigma_end = 2': "exploration.sigma_end = 2.0: must be at most sigma_start",
    "[exploration]\nforced = true\nforced_steps_min = 16": "exploration.forced_steps_min = 16: must be at most",
    "[exploration]\nforced = true\n[lidar]\nrange_min = 0.6": "forced_range = 0.6: must be above lidar.range_min",
    "[exploration]\nforced = true\nforced_range = 11": "exploration.forced_range = 11.0: must be above",
    "[replay]\ncapacity = 95": "replay.capacity = 95: must be at least learner.batch_size = 96",
    "[replay]\ncapacity = 2815": "must be at least num_envs x (n_step + delayed_steps) = 2816",
    "[learner]\ndelayed_steps = 4000": "must be at least num_envs x (n_step + delayed_steps) = 1026816",
    "[lidar]\nmount = [0.1, 0.2, 0]": "learner.mirror = true: must be false where a scan has no mirror image: the",
    "[lidar]\nmount = [0, 0, 0.1]": "the lidar is mounted at y = 0.0, yaw = 0.1",
    "[lidar]\nbeams = 61": "of 61 beams one lies exactly between two of 20 bins",
}


@pytest.mark.parametrize(("content", "expected"), COMBINATIONS.items())
def test_settings_that_exclude_each_other_are_refused(config_file: Writer, content: str | bytes, expected: str) -> None:
    file = config_file(content)
    # The file is named also when the setting at fault is a default, and an unrelated option came later.
    line = refusal(file=file, options=[Option("--seed", "training.seed", "3")])
    assert line.startswith(f"{file}: ")
    assert expected in line


ALLOWED_COMBINATIONS = [
    "[training]\nsteps = 0\nepisodes = 1",
    '[training]\nupdate_schedule = "per_episode"\nnum_envs = 1',
    "[exploration]\nforced_steps_min = 16",
    "[world]\ngoal_range_start = 0.71",
    "[exploration]\nsigma_end = 2",
    '[exploration]\nschedule = "linear"\nsigma_min = 0.5',
    "[task]\nsensor_range = 20",
    "[lidar]\nbins = 180",
    "[lidar]\nmount = [0.1, 0.2, 0.3]\n[learner]\nmirror = false",
    "[lidar]\nmount = [-0.1, 0, 0]",
    "[lidar]\nbeams = 61\n[learner]\nmirror = false",
    "[replay]\ncapacity = 2816",
]


@pytest.mark.parametrize("content", ALLOWED_COMBINATIONS)
def test_settings_that_only_look_so_are_accepted(config_file: Writer, content: str | bytes) -> None:
    assert load_config(config_file(content)) != Config()


@pytest.mark.parametrize("beams", range(1, 60))
def test_mirror_is_refused_exactly_where_bins_have_no_mirror_image(beams: int) -> None:
    for bins in range(1, beams + 1):
        counts = [0] * bins
        for beam in range(beams):
            counts[(2 * beam + 1) * bins // (2 * beams)] += 1
        if counts == counts[::-1]:
            Config(lidar=LidarConfig(beams=beams, bins=bins))
        else:
            with pytest.raises(ConfigError, match=r"learner\.mirror"):
                Config(lidar=LidarConfig(beams=beams, bins=bins))


def test_python_users_meet_the_same_checks() -> None:
    with pytest.raises(ConfigError, match=r"^lidar\.bins = 20: must be at most beams = 4"):
        SimConfig(lidar=LidarConfig(beams=4))
    with pytest.raises(ConfigError, match="num_envs"):
        Config(training=TrainingConfig(update_schedule="per_episode"))
    with pytest.raises(ValueError, match="tau"):
        LearnerConfig(tau=math.nan)
    with pytest.raises(ValueError, match="taus"):
        LearnerConfig(taus=1)  # type: ignore[call-arg]
    with pytest.raises(ValueError, match="hidden_sizes"):
        NetworksConfig(hidden_sizes=(True, True))
    assert issubclass(ConfigError, UserError)


PYTHON_FAULTS: dict[str, tuple[Callable[[], object], str]] = {
    "range": (lambda: RobotConfig(radius=-1), "robot.radius = -1: must be a number in (0, 10]"),
    "place": (lambda: RobotConfig("disc", 20.0), "robot.radius = 20.0: must be a number in (0, 10]"),
    "word": (
        lambda: LidarConfig(caster="rastr"),  # type: ignore[arg-type]
        'lidar.caster = "rastr": must be "auto", "raster" or "parry"; did you mean raster?',
    ),
    "list": (
        lambda: LidarConfig(mount=(0, 0, math.inf)),
        "lidar.mount = [0, 0, inf]: must be a list of 3 numbers in [-10, 10]",
    ),
    "world": (lambda: WorldConfig(name="offic.json"), f'world.name = "offic.json": must be {BUILT_IN}'),
    "misspelt": (lambda: WorldConfig(name="td4"), f'world.name = "td4": must be {BUILT_IN}; did you mean td3?'),
    "replaced": (lambda: replace(RobotConfig(), v_max=0.0), "robot.v_max = 0.0: must be a number in (0, 100]"),
    "several": (
        lambda: TaskConfig(period=0, goal_radius=0),
        "task.period = 0: must be a number in [0.001, 10] (and 1 more)",
    ),
    "unknown": (
        lambda: LearnerConfig(taus=1),  # type: ignore[call-arg]
        "learner.taus: no such key; did you mean learner.tau?",
    ),
    "table": (lambda: SimConfig(world="td3"), 'world = "td3": must be a WorldConfig'),  # type: ignore[arg-type]
    "no table": (
        lambda: SimConfig(wrold=WorldConfig()),  # type: ignore[call-arg]
        "wrold: no such table or key; did you mean world?",
    ),
    "too many": (
        lambda: ReplayConfig(1, 2),  # type: ignore[call-arg]
        "ReplayConfig: expected at most 1 settings, got 2",
    ),
}


@pytest.mark.parametrize(("make", "expected"), PYTHON_FAULTS.values(), ids=PYTHON_FAULTS)
def test_python_users_read_the_same_lines(make: Callable[[], object], expected: str) -> None:
    with pytest.raises(ConfigError) as refused:
        make()
    assert str(refused.value) == expected
    assert isinstance(refused.value, ValueError)


def test_load_sim_leaves_the_learner_alone() -> None:
    sim = load_sim([Option("--beams", "lidar.beams", "61")])
    assert (sim.lidar.beams, sim.lidar.bins) == (61, 20)
    with pytest.raises(ConfigError, match=r"^--beams: lidar\.bins = 20"):
        load_sim([Option("--beams", "lidar.beams", "6")])


# Anything


@settings(
    max_examples=300, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=st.one_of(st.binary(max_size=60), st.text(max_size=60).map(lambda text: f"[learner]\n{text}".encode())))
def test_no_file_causes_anything_but_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "any.toml").write_bytes(content)
    assert len(outcome(file=tmp_path / "any.toml").splitlines()) == 1


@settings(max_examples=300, derandomize=True, deadline=None)
@given(
    key=st.one_of(st.sampled_from(keys(Config)), st.text(max_size=20).map("learner.{}".format)),
    text=st.text(max_size=30),
)
def test_no_option_causes_anything_but_one_line(key: str, text: str) -> None:
    assert len(outcome(options=[Option("--it", key, text)]).splitlines()) == 1


def test_shown_values_fit_a_line() -> None:
    assert shown(True) == "true"
    assert shown("a\nb") == '"a\\nb"'
    assert shown([1, "x", 2.5]) == '[1, "x", 2.5]'
    assert len(shown("x" * 1000)) == 60
    assert len(shown(10**5000)) == 60
