"""The commands that drive robots: train, eval and play, from beginning to end and in small."""

import json
import os
import re
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navrl.config import Config
from navrl.config.files import ROBOTS, load_config
from navrl.drawing.render import PLANNED
from navrl.policy import save_policy
from navrl.policy_description import PolicyDescription

NAVRL = Path(sysconfig.get_path("scripts")) / "navrl"
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "NO_COLOR": "1"}
SMALL = [
    *("--training.num_envs", 16, "--steps", 1600, "--exploration.random_steps", 200),
    *("--validation.scenarios", 8, "--validation.every_steps", 800, "--replay.capacity", 5000, "--no-test"),
]
"""A training of a second."""
SCORES = (
    *("list", "list_sha256", "episodes", "success_rate", "success_ci95", "collision_rate", "collision_ci95"),
    *("timeout_rate", "timeout_ci95", "average_return", "spl", "time_to_goal_s", "path_length_m", "min_clearance_m"),
    *("path_ratio", "p5_clearance_m", "jerk_m_s3", "omega_change_rad_s", "turning_share"),
    *("detour_episodes", "detour_success_rate", "detour_success_ci95", "detour_spl"),
)


def navrl(*arguments: object, cwd: Path | None = None, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Runs the installed command and checks its exit code."""
    command = [str(NAVRL), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=ENVIRONMENT, timeout=300, check=False)
    assert done.returncode == code, done.stderr
    return done


def python(code: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Runs Python code in a process of its own."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=ENVIRONMENT, timeout=300, check=False)


def without_torch(arguments: list[str]) -> str:
    """Code that runs a command where torch cannot be imported."""
    return f"import sys; sys.modules['torch'] = None\nimport navrl.cli; sys.exit(navrl.cli.main({arguments!r}))"


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an untrained policy."""
    description = PolicyDescription.from_config(Config())
    generator = np.random.Generator(np.random.Philox(0))
    sizes = description.layer_sizes
    names = [*(f"hidden.{i}" for i in range(len(sizes) - 2)), "output"]
    weights = {}
    for name, inputs, outputs in zip(names, sizes, sizes[1:], strict=False):
        weights[f"{name}.weight"] = generator.normal(0, 0.3, (outputs, inputs)).astype(np.float32)
        weights[f"{name}.bias"] = np.zeros(outputs, np.float32)
    folder = tmp_path_factory.mktemp("policy")
    save_policy(folder, weights, description)
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished run."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    done = navrl("train", *SMALL, "--seed", 3, "--out", folder)
    assert done.stderr.splitlines()[0] == f"navrl: training on td3, preset fast, seed 3; run folder {folder}"
    return folder


# eval


def test_eval_reports_scores_and_episodes(policy: Path, tmp_path: Path) -> None:
    done = navrl("eval", policy, "--episodes", 20, "--threads", 1, "--json", tmp_path / "e.json")
    assert "success" in done.stdout
    record = json.loads((tmp_path / "e.json").read_text())
    assert list(record) == ["schema", "policy", "summary", "episodes"]
    assert tuple(record["summary"]) == SCORES
    assert record["summary"]["list"] == "test"
    assert [episode["index"] for episode in record["episodes"]] == list(range(20))
    keys = ["index", "outcome", "steps", "time_s", "path_m", "shortest_m", "return", "min_clearance_m"]
    keys += ["p5_clearance_m", "jerk_m_s3", "omega_change_rad_s", "turning_share", "needs_detour"]
    assert all(list(episode) == keys for episode in record["episodes"])


def test_eval_does_not_depend_on_threads(policy: Path, tmp_path: Path) -> None:
    for threads in (1, 2):
        navrl("eval", policy, "--episodes", 12, "--threads", threads, "--json", tmp_path / f"{threads}.json")
    assert (tmp_path / "1.json").read_bytes() == (tmp_path / "2.json").read_bytes()


@pytest.mark.parametrize(("name", "size"), [("validation", 1000), ("final", 4000)])
def test_eval_takes_the_list_and_the_world_that_were_asked_for(
    policy: Path, tmp_path: Path, name: str, size: int
) -> None:
    arguments = ["--world", "boxes", "--boxes", 4, "--list", name, "--episodes", 3, "--json", tmp_path / "e.json"]
    done = navrl("eval", policy, *arguments)
    assert "boxes" in done.stdout
    assert json.loads((tmp_path / "e.json").read_text())["summary"]["list"] == name
    line = navrl("eval", policy, "--list", name, "--episodes", size + 1, code=2).stderr.splitlines()[-1]
    assert str(size) in line


def test_eval_of_a_file_refuses_what_cannot_be_run_by_line(policy: Path, tmp_path: Path) -> None:
    good = {"start": [0, 0, 0], "goal": [2, 0], "goal_radius": 0.3, "time_limit": 5}
    touching = {**good, "circles": [[0.1, 0, 0.5]]}
    file = tmp_path / "course.jsonl"
    file.write_text("\n".join(json.dumps(scenario) for scenario in (good, touching, good)) + "\n")
    assert f"{file}, line 2: " in navrl("eval", policy, "--scenarios", file, code=2).stderr
    navrl("eval", policy, "--scenarios", file, "--skip-invalid", "--json", tmp_path / "e.json")
    record = json.loads((tmp_path / "e.json").read_text())
    assert record["summary"]["episodes"] == 2
    assert [(episode["index"], episode["line"]) for episode in record["episodes"]] == [(0, 1), (1, 3)]
    assert "no such file" in navrl("eval", policy, "--scenarios", tmp_path / "x.jsonl", code=2).stderr.lower()
    assert "--list test" in navrl("eval", policy, "--scenarios", file, "--list", "test", code=2).stderr
    assert "--boxes 4" in navrl("eval", policy, "--boxes", 4, code=2).stderr


def test_worlds_are_shown_as_they_were_typed(policy: Path, tmp_path: Path) -> None:
    (tmp_path / "open.json").write_text(json.dumps({"area": [-3, -3, 3, 3]}))
    evaluation = navrl("eval", policy, "--world", "open.json", "--episodes", 2, cwd=tmp_path)
    assert evaluation.stderr == f"navrl: evaluating {policy} on open.json\n"
    assert evaluation.stdout.startswith(f"{policy} on open.json, list test: 2 scenarios\n")
    played = navrl("play", policy, "--world", "./open.json", "--out", "p.png", cwd=tmp_path)
    assert played.stderr == f"navrl: {policy} drives scenario 0 of ./open.json\n"
    arguments = ["train", "--world", "open.json", "--out", "run"]
    assert python(without_torch(arguments), tmp_path).stderr.startswith("navrl: training on open.json, preset fast")


def test_play_measures_no_ways(policy: Path, tmp_path: Path) -> None:
    (tmp_path / "open.json").write_text(json.dumps({"area": [-3, -3, 3, 3]}))
    arguments = ["play", str(policy), "--world", "open.json", "--index", "7", "--out", "p.png"]
    done = python(
        "import sys, navrl.cli, navrl.scenarios\n"
        "navrl.scenarios.shortest_lengths = None\n"
        f"sys.exit(navrl.cli.main({arguments!r}))",
        tmp_path,
    )
    assert done.returncode == 0, done.stderr


def test_eval_and_play_do_without_torch(policy: Path, tmp_path: Path) -> None:
    for arguments in (["eval", str(policy), "--episodes", "3"], ["play", str(policy), "--out", "p.png"]):
        done = python(without_torch(arguments), tmp_path)
        assert done.returncode == 0, done.stderr


# play


@pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("a.GIF", b"GIF89a")])
def test_play_draws_pictures_and_films(policy: Path, tmp_path: Path, name: str, start: bytes) -> None:
    scenario = {"start": [0, 0, 0], "goal": [2, 1], "goal_radius": 0.3, "time_limit": 2, "circles": [[3, 0, 0.5]]}
    (tmp_path / "course.jsonl").write_text(json.dumps(scenario) + "\n")
    done = navrl("play", policy, "--scenarios", tmp_path / "course.jsonl", "--out", tmp_path / name)
    assert done.stdout.startswith(f"{tmp_path / name}: ")
    assert (tmp_path / name).read_bytes().startswith(start)


def test_play_draws_any_contender_in_the_episode_that_compare_measures(tmp_path: Path) -> None:
    common = ["--world", "boxes", "--boxes", 8, "--level", "real", "--gap.margin", 0.03]
    navrl("compare", "gap", "gap+rrt", *common, "--episodes", 4, "--out", tmp_path / "out")
    lines = [json.loads(line) for line in (tmp_path / "out/episodes.jsonl").read_text().splitlines()]
    for name in ("gap", "gap+rrt"):
        played = navrl("play", name, *common, "--index", 3, "--out", tmp_path / "a.png")
        assert played.stderr == f"navrl: {name} drives scenario 3 of boxes\n"
        [line] = [line for line in lines if line["contender"] == name and line["index"] == 3]
        assert played.stdout == f"{tmp_path / 'a.png'}: {line['outcome']} after {line['time_s']:.1f} s\n"
        # The planned path is drawn where there is one.
        colors = np.asarray(Image.open(tmp_path / "a.png").convert("RGB")).reshape(-1, 3).astype(int)
        amber = (np.abs(colors - PLANNED).max(axis=1) < 8).sum()
        assert (amber > 100) == (name == "gap+rrt")


def test_play_refuses_an_index_beyond_the_list(policy: Path, tmp_path: Path) -> None:
    done = navrl("play", policy, "--index", 1000, "--out", tmp_path / "a.png", code=2)
    assert "--index 1000: test has scenarios 0 to 999" in done.stderr


# train


def test_train_writes_what_the_interface_promises(run: Path) -> None:
    summary = json.loads((run / "summary.json").read_text())
    assert (summary["preset"], summary["algorithm"], summary["seed"]) == ("fast", "td3", 3)
    assert summary["env_steps"] == 1600
    assert summary["updates"] > 0
    assert load_config(run / "config.toml").training.num_envs == 16
    assert {"metrics.csv", "checkpoints", "policy"} <= {path.name for path in run.iterdir()}


def test_a_run_can_be_evaluated_and_begun_from(run: Path, tmp_path: Path) -> None:
    navrl("eval", run, "--episodes", 3)
    navrl("train", *SMALL, "--init", run, "--out", tmp_path / "next")


def test_a_run_is_evaluated_in_its_own_world(tmp_path: Path) -> None:
    file, run = tmp_path / "court.json", tmp_path / "run"
    file.write_text(
        '{"area": [-3, -3, 3, 3], "segments": [[-4, -4, 4, -4], [4, -4, 4, 4], [4, 4, -4, 4], [-4, 4, -4, -4]]}'
    )
    navrl("train", *SMALL, "--world", file, "--out", run)
    file.unlink()
    own, named = navrl("eval", run, "--episodes", 5), navrl("eval", run, "--episodes", 5, "--world", run / "world.json")
    other = navrl("eval", run, "--episodes", 5, "--world", "td3")
    assert own.stdout == named.stdout != other.stdout
    assert f"evaluating {run} on {run / 'world.json'}" in own.stderr
    assert (
        navrl("play", run, "--out", tmp_path / "a.png").stderr
        == f"navrl: {run} drives scenario 0 of {run / 'world.json'}\n"
    )


def test_a_finished_run_says_so_and_steps_extend_it(run: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(run, tmp_path / "run")
    assert "finished" in navrl("train", "--resume", tmp_path / "run").stdout
    navrl("train", "--resume", tmp_path / "run", "--steps", 2400)
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["env_steps"] == 2400


def test_a_damaged_summary_is_written_again(run: Path, tmp_path: Path) -> None:
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    for damage in ("{}", "[]", "5", "[" * 100_000):
        (copy / "summary.json").write_text(damage)
        navrl("train", "--resume", copy)
        assert json.loads((copy / "summary.json").read_text())["updates"] > 0


def test_a_run_folder_is_not_overwritten(run: Path) -> None:
    done = navrl("train", *SMALL, "--out", run, code=2)
    assert done.stderr == f"navrl: --out {run}: is not empty; to continue the run there: navrl train --resume {run}\n"


def test_several_seeds_train_into_folders_of_their_own(tmp_path: Path) -> None:
    navrl("train", *SMALL, "--seeds", "0,1", "--world", "boxes", cwd=tmp_path)
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("boxes-fast-seeds-")
    seeds = {path.name: json.loads((path / "summary.json").read_text())["seed"] for path in folder.iterdir()}
    assert seeds == {"seed-0": 0, "seed-1": 1}


def test_the_default_folder_names_world_preset_and_seed(tmp_path: Path) -> None:
    settings = ["--preset", "paper", "--episodes", 2, "--networks.hidden_sizes", "[32, 32]", "--no-test"]
    navrl("train", *settings, "--validation.scenarios", 4, "--seed", 7, cwd=tmp_path)
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("td3-paper-seed7-")
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["preset"], summary["episodes"]) == ("paper", 2)


@pytest.mark.parametrize("robot", ROBOTS)
def test_robots_on_the_market_train(robot: str, tmp_path: Path) -> None:
    navrl("train", "--robot", robot, *SMALL, "--out", tmp_path / "run")
    description = json.loads((tmp_path / "run" / "policy" / "policy.json").read_text())
    config = load_config(robot=robot)
    assert (description["v_max"], description["omega_max"]) == (config.robot.v_max, config.robot.omega_max)
    assert (description["beams"], description["bins"]) == (360, 40)
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["updates"] > 0


def test_the_first_line_is_out_before_torch_is_loaded(tmp_path: Path) -> None:
    done = python(without_torch(["train", "--out", "run"]), tmp_path)
    assert done.returncode == 1
    assert done.stderr.splitlines()[0] == "navrl: training on td3, preset fast, seed 0; run folder run"
    assert "torch" in done.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_a_full_world_and_a_policy_that_does_not_fit_are_refused_before_torch_is_loaded(
    policy: Path, tmp_path: Path
) -> None:
    full = {"area": [-5, -5, 5, 5], "random_boxes": {"count": 60, "sides": [1.0, 1.5], "clearance": 0.5}}
    (tmp_path / "full.json").write_text(json.dumps(full))
    for arguments, expected in (
        (["--world", "full.json"], f"navrl: world '{tmp_path / 'full.json'}' is too full: "),
        (["--init", str(policy), "--lidar.bins", "10"], "navrl: --init: the policy has bins = 20, this run has 10\n"),
    ):
        done = python(without_torch(["train", *arguments, "--out", "run"]), tmp_path)
        assert done.returncode == 2, done.stderr
        assert done.stderr.startswith(expected)
        assert len(done.stderr.splitlines()) == 1
        assert done.stderr.count("full.json") <= 1
        assert [path.name for path in tmp_path.iterdir()] == ["full.json"]


def test_values_that_are_not_finite_are_exit_code_3(tmp_path: Path) -> None:
    arguments = ["train", *map(str, SMALL), "--out", "run"]
    done = python(
        "import sys, torch, navrl.cli, navrl.td3\n"
        "update = navrl.td3.TD3.update\n"
        "def poisoned(self, count):\n"
        "    metrics = update(self, count)\n"
        "    if self.updates > 20:\n"
        "        next(self.critic.parameters()).detach().fill_(float('nan'))\n"
        "    return metrics\n"
        "navrl.td3.TD3.update = poisoned\n"
        f"sys.exit(navrl.cli.main({arguments!r}))",
        tmp_path,
    )
    assert done.returncode == 3, done.stderr
    assert "not finite" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_ctrl_c_saves_says_how_to_resume_and_exits_130(tmp_path: Path) -> None:
    arguments = ["train", *map(str, SMALL), "--out", "run", "--steps", "100000000"]
    # Whoever runs the tests in the background may ignore the signal, and what they start inherits that.
    with subprocess.Popen(
        [NAVRL, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env=ENVIRONMENT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stderr is not None
        seen = ""
        while "validation" not in seen:
            line = process.stderr.readline()
            assert line, seen
            seen += line
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
        assert process.wait(60) == 130
    assert "navrl train --resume run" in rest
    assert "Traceback" not in rest
    navrl("train", "--resume", "run", "--steps", 1600, cwd=tmp_path)


# Files that are not what they seem


@pytest.mark.parametrize("arguments", [("eval", "default", "--json", "x"), ("play", "--out", "x")])
def test_results_do_not_replace_devices_and_follow_links(arguments: tuple[str, ...], tmp_path: Path) -> None:
    suffix = ".png" if arguments[0] == "play" else ".json"
    few = ["--episodes", "4"] if arguments[0] == "eval" else []
    pipe, link, target = (tmp_path / f"{name}{suffix}" for name in ("pipe", "link", "target"))
    os.mkfifo(pipe)
    refused = navrl(*arguments[:-1], pipe, *few, code=2)
    assert refused.stderr.endswith(f"{pipe}: is a device or a pipe, not a file\n")
    assert pipe.is_fifo()
    target.write_bytes(b"old")
    link.symlink_to(target)
    navrl(*arguments[:-1], link, *few)
    assert link.is_symlink()
    assert len(target.read_bytes()) > 100
    circle = tmp_path / f"circle{suffix}"
    circle.symlink_to(circle)
    refused = navrl(*arguments[:-1], circle, *few, code=2)
    assert re.search(r"is a link that leads back to itself|Too many levels of symbolic links", refused.stderr)
    assert refused.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", ["bench --num-envs 2 --json", "eval default --episodes 2 --json"])
def test_a_result_that_cannot_be_written_leaves_the_old_one(arguments: str, tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text("old")
    command = ["bash", "-c", 'ulimit -f 0; exec "$@"', "bash", str(NAVRL), *arguments.split(), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=300, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == f"navrl: {file}: File too large"
    assert file.read_text() == "old"


@pytest.mark.parametrize("arguments", ["eval", "train --resume", "train --init", "train --out", "play --out"])
def test_a_name_that_is_too_long_is_one_line(arguments: str, tmp_path: Path) -> None:
    refused = navrl(*arguments.split(), "a" * 300 + ".png", cwd=tmp_path, code=2)
    assert "File name too long" in refused.stderr
    assert refused.stderr.count("\n") == 1


def test_a_part_of_a_world_that_is_walled_off_is_told(tmp_path: Path) -> None:
    walls = [[1, -3, 1, 3], [-3, -3, 3, -3], [3, -3, 3, 3], [3, 3, -3, 3], [-3, 3, -3, -3]]
    (tmp_path / "flat.json").write_text(json.dumps({"area": [-3, -3, 3, 3], "segments": walls}))
    done = navrl("train", "--world", "flat.json", *SMALL, "--out", "run", cwd=tmp_path)
    # Centres keep the robot's radius (about 0.26 m with its margin) from walls: of 3.48 x 5.48 and 1.48 x 5.48 m, the
    # smaller part is cut off, 30 %, as fine as a grid of 0.07 m can tell.
    share = re.search(r"flat\.json: no way leads to (\d+) % of the free area", done.stderr)
    assert share is not None
    assert 28 <= int(share[1]) <= 31
