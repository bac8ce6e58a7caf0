"""The command line: what each command prints and writes, its exit codes, and what it does without."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

NAVRL = Path(sysconfig.get_path("scripts")) / "navrl"
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "NO_COLOR": "1"}


def navrl(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Runs the installed command."""
    command = [str(NAVRL), *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, cwd=cwd, env=ENVIRONMENT, timeout=300, check=False, encoding="utf-8"
    )


def python(code: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Runs Python code in a process of its own."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=ENVIRONMENT, timeout=300, check=False)


def refused(*arguments: object, cwd: Path | None = None) -> str:
    """The one line with which the command refuses its arguments."""
    done = navrl(*arguments, cwd=cwd)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("navrl: ")
    return done.stderr.removeprefix("navrl: ").rstrip()


# Help and version


def test_help_names_every_command() -> None:
    done = navrl("--help")
    assert done.returncode == 0
    assert all(command in done.stdout for command in ("train", "eval", "play", "bench", "config", "doctor"))


@pytest.mark.parametrize(
    "command", ["train", "eval", "play", "bench", "config", "doctor", "config show", "config check"]
)
def test_every_command_has_help(command: str) -> None:
    done = navrl(*command.split(), "--help")
    assert done.returncode == 0
    assert done.stdout.startswith(f"usage: navrl {command} ")


def test_help_loads_nothing_heavy() -> None:
    done = python(
        "import sys, navrl.cli\n"
        "try:\n    navrl.cli.main(['train', '--help'])\nexcept SystemExit:\n    pass\n"
        "print([name for name in ('numpy', 'torch', 'pydantic', 'gymnasium', 'rich') if name in sys.modules])"
    )
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_version() -> None:
    from importlib.metadata import version

    assert navrl("--version").stdout == f"navrl {version('navrl')}\n"
    assert python("import navrl; print(navrl.__version__)").stdout == f"{version('navrl')}\n"


def test_python_m_navrl_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "navrl", "--version"], capture_output=True, text=True, check=False)
    assert done.stdout == navrl("--version").stdout


# Refusals

REFUSALS = {
    "": "the following arguments are required: COMMAND",
    "trian": "argument COMMAND: invalid choice: 'trian' (choose from",
    "train --stpes 4": "train: --stpes: no such option; did you mean --steps?",
    "train --st 4": "train: --st: no such option",
    "train 4": "train: unexpected argument '4'",
    "train --steps": "train: argument --steps: expected one argument",
    "train --steps x": '--steps: training.steps = "x": must be a whole number in [0, 1_000_000_000_000]',
    "train --steps 0": "--steps: training.steps = 0: must be at least 1",
    "train --steps 1e6": "--steps: training.steps = 1000000.0: must be a whole number",
    "train --steps 10 --episodes 3": "train: argument --episodes: not allowed with argument --steps",
    "train --seed 1 --seeds 1,2": "train: argument --seeds: not allowed with argument --seed",
    "train --seed -1": "--seed: training.seed = -1: must be a whole number",
    "train --seeds 1,x": '--seeds: training.seed = "x": must be a whole number',
    "train --seeds 1,2,1": "--seeds 1,2,1: a seed stands there twice",
    "train --world td4": '--world: world.name = "td4": must be "td3", "boxes", "open8", "walls", "mixed" or',
    "train --world nowhere.json": "nowhere.json",
    "train --preset papr": '--preset: "papr": must be one of fast, paper',
    "train --robot burger": '--robot: "burger": must be one of turtlebot3_burger, turtlebot3_waffle',
    "train --config nowhere.toml": "nowhere.toml: no such file",
    "train --algorithm ddgp": '--algorithm: learner.algorithm = "ddgp": must be "td3" or "ddpg"; did you mean ddpg?',
    "train --until 1.5": "--until: training.until = 1.5: must be a number in [0, 1)",
    "train --learner.tau": "--learner.tau: expects a value",
    "train --learner.tau --steps 512": "--learner.tau: expects a value",
    "train --learner.tau 2": "--learner.tau: learner.tau = 2: must be a number in (0, 1]",
    "train --learner.taus 2": "--learner.taus: learner.taus: no such key; did you mean learner.tau?",
    "train --lidar.bins=181": "--lidar.bins: lidar.bins = 181: must be at most beams = 180",
    "train --robot.radius 6": "radius",
    "train --init nowhere": "nowhere: no such folder; expected a run folder, a policy folder or default",
    "train --resume nowhere": "--resume nowhere: no such run folder",
    "train --resume . --seed 1": "train: --seed: a resumed run keeps its settings",
    "train --resume . --level real": "train: --level: a resumed run keeps its settings",
    "train --level real --robot.delay_steps 2": "--robot.delay_steps: is set by --level real",
    "train --resume . --learner.tau 1": "train: --learner.tau: a resumed run keeps its settings",
    "train --inexact": "train: --inexact goes with --resume only",
    "eval": "eval: the following arguments are required: POLICY",
    "eval dwa": "dwa: is no policy alone: navrl compare dwa --out DIR evaluates it",
    "eval default+astar": "default+astar: is no policy alone: navrl compare default+astar --out DIR evaluates it",
    "eval nowhere": "nowhere: no such folder; expected a run folder, a policy folder or default",
    "eval default --list tuning": "eval: argument --list: invalid choice: 'tuning'",
    "eval default --world td3 --scenarios x": "eval: argument --scenarios: not allowed with argument --world",
    "eval default --skip-invalid": "eval: --skip-invalid goes with --scenarios only",
    "play --skip-invalid --out a.png": "play: --skip-invalid goes with --scenarios only",
    "compare gap --skip-invalid --out a": "compare: --skip-invalid goes with --scenarios only",
    "eval default --learner.tau 1": "eval: --learner.tau: this command takes no configuration keys",
    "eval default --episodes 0": "--episodes 0: must be a whole number in [1, 1000000]",
    "eval default --threads 0": "--threads 0: must be a whole number in [1, 256]",
    "eval default --json nowhere/a.json": "--json nowhere/a.json: no such folder nowhere",
    "eval default --json .": "--json .: is a folder, not a file",
    "play nowhere": "play: the following arguments are required: --out",
    "play nowhere --out a.png": "nowhere: no such folder; expected a run folder",
    "play --out a.bmp": "a.bmp: expected a name that ends in .png, .gif, .mp4",
    "play --out nowhere/a.png": "--out nowhere/a.png: no such folder nowhere",
    "play --out a.png --index -1": "--index -1: must be a whole number in [0, 1000000]",
    "bench --num-envs 0": "--num-envs 0: must be a whole number in [1, 65536]",
    "bench --num-envs many": "--num-envs many: must be a whole number in [1, 65536]",
    "bench --noise -1": "--noise: lidar.noise = -1: must be a number in [0, 10]",
    "bench --beams 5000": "--beams 5000: must be a whole number in [1, 4096]",
    "bench --world td4": '--world: world.name = "td4": must be',
    "config": "config: the following arguments are required: ACTION",
    "config chekc": "config: argument ACTION: invalid choice: 'chekc'",
    "config check": "config check: the following arguments are required: FILE",
    "config check .": ".: is a folder, not a file",
    "config show nowhere.toml": "nowhere.toml: no such file",
    "config show --learner.tau two": '--learner.tau: learner.tau = "two": must be a number in (0, 1]',
    "doctor now": "doctor: unexpected argument 'now'",
}


@pytest.mark.parametrize(("typed", "expected"), REFUSALS.items())
def test_a_mistake_is_one_line_and_exit_code_2(tmp_path: Path, typed: str, expected: str) -> None:
    assert expected in refused(*typed.split(), cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("eval", ""), "policy: expected a run folder, a policy folder or default, got nothing"),
        (("eval", "default", "--json", ""), "--json: expects the name of a file"),
        (("play", "--out", ""), "--out: expects the name of a file"),
    ],
)
def test_an_empty_name_is_no_folder(tmp_path: Path, arguments: tuple[str, ...], expected: str) -> None:
    assert expected in refused(*arguments, cwd=tmp_path)


def test_a_folder_that_is_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "note.txt").write_text("mine")
    assert refused("train", "--out", tmp_path / "run") == f"--out {tmp_path / 'run'}: is not empty"
    file = tmp_path / "run" / "note.txt"
    for folder in (file, file / "deeper"):
        assert refused("train", "--out", folder) == f"--out {folder}: {file} is not a folder"


def test_a_world_that_is_too_narrow_is_refused_before_training(tmp_path: Path) -> None:
    world = {"area": [-1, -1, 1, 1], "segments": [[-1, -1, 1, -1], [1, -1, 1, 1], [1, 1, -1, 1], [-1, 1, -1, -1]]}
    (tmp_path / "cell.json").write_text(json.dumps(world))
    refused("train", "--world", "cell.json", "--robot.radius", "1.5", cwd=tmp_path)
    (tmp_path / "cell.json").write_text("{")
    assert "cell.json" in refused("train", "--world", "cell.json", cwd=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["cell.json"]


def test_control_characters_of_a_file_are_not_obeyed(tmp_path: Path) -> None:
    (tmp_path / "cell.json").write_text(json.dumps({"area": [-1, -1, 1, 1], "\x1b[2J\x07": 1}))
    line = refused("train", "--world", "cell.json", cwd=tmp_path)
    assert "\\x1b[2J\\x07" in line
    assert line.isprintable()


def test_an_internal_error_is_exit_code_1_with_its_traceback() -> None:
    done = python(
        "import sys, navrl.cli, navrl.commands.doctor as command\n"
        "def broken(options): raise RuntimeError('a fault of ours')\n"
        "command.doctor = broken\n"
        "sys.exit(navrl.cli.main(['doctor']))"
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == "RuntimeError: a fault of ours"


def test_an_interrupt_is_exit_code_130_without_a_traceback() -> None:
    done = python(
        "import sys, navrl.cli, navrl.commands.doctor as command\n"
        "def stopped(options): raise KeyboardInterrupt\n"
        "command.doctor = stopped\n"
        "sys.exit(navrl.cli.main(['doctor']))"
    )
    assert done.returncode == 130
    assert done.stderr == "navrl: interrupted\n"


def test_a_reader_that_leaves_early_is_no_error() -> None:
    with subprocess.Popen(
        [NAVRL, "config", "show"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 0


# config


def test_config_show_prints_what_reads_back(tmp_path: Path) -> None:
    shown = navrl("config", "show", "--preset", "paper", "--robot", "turtlebot3_waffle", "--learner.tau", "0.25").stdout
    assert 'encoding = "raw"\n' in shown
    assert "tau = 0.25\n" in shown
    assert "v_max = 0.26\n" in shown
    (tmp_path / "all.toml").write_text(shown)
    assert navrl("config", "show", tmp_path / "all.toml").stdout == shown
    checked = navrl("config", "check", tmp_path / "all.toml")
    assert (checked.returncode, checked.stdout) == (0, f"{tmp_path / 'all.toml'}: valid\n")


def test_config_check_names_file_key_value_range_and_nearest_key(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("[learner]\ncritic_lrr = 1\n")
    line = refused("config", "check", "bad.toml", cwd=tmp_path)
    assert line == "bad.toml: learner.critic_lrr: no such key; did you mean learner.critic_lr?"
    (tmp_path / "bad.toml").write_text("[learner]\ncritic_lr = 2\n")
    assert refused("config", "check", "bad.toml", cwd=tmp_path) == (
        "bad.toml: learner.critic_lr = 2: must be a number in (0, 1]"
    )


def test_lists_in_lists_in_lists_are_refused(tmp_path: Path) -> None:
    (tmp_path / "deep.toml").write_text("[learner]\ntau = " + "[" * 341 + "]" * 341)
    assert "learner.tau = lists in lists" in refused("config", "check", "deep.toml", cwd=tmp_path)


def test_config_loads_neither_numpy_nor_torch() -> None:
    done = python(
        "import sys, navrl.cli\nnavrl.cli.main(['config', 'show'])\n"
        "print([name for name in ('numpy', 'torch', 'gymnasium') if name in sys.modules])"
    )
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


# bench and doctor


def test_bench_measures_and_writes_its_figures(tmp_path: Path) -> None:
    done = navrl("bench", "--num-envs", 8, "--beams", 16, "--threads", 1, "--noise", 0, "--json", tmp_path / "b.json")
    assert done.returncode == 0, done.stderr
    assert "steps/s" in done.stdout
    record = json.loads((tmp_path / "b.json").read_text())
    rates = record.pop("steps_per_second")
    assert record.pop("isa") in ("baseline", "avx2", "avx512")
    assert record == {"schema": 1, "world": "open8", "num_envs": 8, "beams": 16, "threads": 1, "noise": 0.0}
    assert 0 < rates["min"] <= rates["median"] <= rates["max"]


def test_doctor_says_what_is_there_and_that_it_works() -> None:
    done = navrl("doctor")
    lines = done.stdout.splitlines()
    for part in ("simulate", "learn", "checkpoint", "policy", "default policy"):
        assert any(line.startswith(f"OK   {part}: ") for line in lines), done.stdout
    assert done.returncode == 0
    assert "torch" in done.stdout
    assert lines[-1] == "all parts work"


def test_doctor_fails_when_a_part_does() -> None:
    done = python(
        "import sys, navrl.cli, navrl.td3\n"
        "def broken(self, count): raise ArithmeticError('no update today')\n"
        "navrl.td3.TD3.update = broken\n"
        "sys.exit(navrl.cli.main(['doctor']))"
    )
    assert done.returncode == 1
    assert "FAIL learn: ArithmeticError: no update today\n" in done.stdout
    assert "OK   simulate: " in done.stdout
    assert done.stdout.splitlines()[-1] == "some parts do not work"


# The package


def test_public_names_are_there_whatever_was_imported_before() -> None:
    done = python(
        "import navrl.evaluate, navrl\n"
        "from navrl import BatchSim, SimConfig, Scenario, load_policy, evaluate\n"
        "assert callable(evaluate) and navrl.evaluate is evaluate and evaluate.__module__ == 'navrl.evaluate'\n"
        "assert {'BatchSim', 'evaluate', '__version__'} <= set(dir(navrl))\n"
        "try:\n    navrl.nothing\nexcept AttributeError as error:\n    print(error)"
    )
    assert done.stdout == "module 'navrl' has no attribute 'nothing'\n", done.stderr


def test_the_public_names_load_without_torch() -> None:
    done = python(
        "import sys; sys.modules['torch'] = None\n"
        "from navrl import BatchSim, SimConfig, Scenario, load_policy, evaluate; print('fine')"
    )
    assert done.stdout == "fine\n", done.stderr
