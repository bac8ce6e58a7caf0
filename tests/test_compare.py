"""`navrl compare`: who takes part, what they see, what is measured of them, and that it continues and repeats."""

import json
import os
from dataclasses import replace
from pathlib import Path
from threading import Thread, get_ident
from typing import Any

import numpy as np
import pytest

from contending import SIM, policy_folder
from navrl.cli import main
from navrl.compare import compare
from navrl.comparing import contenders
from navrl.config import ControllersConfig, LidarConfig, PlannerConfig, RobotConfig
from navrl.config.files import load_config
from navrl.config.levels import LEVELS, at_level
from navrl.controllers import Controller
from navrl.errors import UserError
from navrl.evaluate import evaluate
from navrl.planners import Plan, plan_all
from navrl.policy import load_policy
from navrl.scenarios import ScenarioList, given_list

QUICK = ("gap", "straight", "pursuit+astar")


pytestmark = pytest.mark.usefixtures("quick")


# The same numbers


def test_eval_and_compare_give_a_policy_the_same_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = policy_folder(tmp_path / "policy")
    common = ["--world", "boxes", "--boxes", "4", "--episodes", "15", "--threads", "1"]
    assert main(["eval", str(folder), *common, "--json", str(tmp_path / "eval.json")]) == 0
    assert main(["compare", "straight", str(folder), *common, "--out", str(tmp_path / "out")]) == 0
    evaluated = json.loads((tmp_path / "eval.json").read_text())
    compared = json.loads((tmp_path / "out/results.json").read_text())["contenders"][1]
    assert {key: compared[key] for key in evaluated["summary"]} == evaluated["summary"]
    lines = [json.loads(line) for line in (tmp_path / "out/episodes.jsonl").read_text().splitlines()]
    own = [line for line in lines if line.pop("contender") == str(folder) and line.pop("level") == "ideal"]
    assert own == evaluated["episodes"]
    assert "2 contenders on boxes (4), list test, level ideal: 15 scenarios" in capsys.readouterr().out


def test_a_comparison_by_hand(drawn: ScenarioList, tmp_path: Path) -> None:
    comparison = compare(QUICK, drawn, SIM, tmp_path / "out")
    gap, straight, led = comparison.records
    assert gap.episodes == evaluate(Controller("gap"), drawn).episodes
    solved = [set(np.flatnonzero(record.solved()).tolist()) for record in comparison.records]
    assert comparison.common == sorted(set.intersection(*solved))
    first = comparison.pairs[0]
    assert (first.a, first.b) == ("gap", "straight")
    assert (first.only_a, first.only_b) == (len(solved[0] - solved[1]), len(solved[1] - solved[0]))
    spl = np.mean([x.spl - y.spl for x, y in zip(gap.episodes, straight.episodes, strict=True)])
    assert first.spl_diff == pytest.approx(spl)
    assert first.spl_diff_ci95[0] <= first.spl_diff <= first.spl_diff_ci95[1]
    both = sorted(solved[0] & solved[1])
    times = [gap.episodes[i].time_s - straight.episodes[i].time_s for i in both]
    assert first.time_diff_s == pytest.approx(np.mean(times))
    record = comparison.to_json("navrl compare")
    assert [pair["level"] for pair in record["pairs"]] == ["ideal"] * 3
    assert [entry["knows_map"] for entry in record["contenders"]] == [False, False, True]
    entry = record["contenders"][2]
    assert entry["common_time_to_goal_s"] == pytest.approx(np.mean([led.episodes[i].time_s for i in comparison.common]))
    lengths = [plan.length for plan in plan_all(drawn.scenarios)]
    assert entry["plan_ratio"] == pytest.approx(np.mean(lengths / drawn.shortest))
    assert entry["plans_found"] == 12
    assert 0 < entry["decision_p50_ms"] <= entry["decision_p99_ms"]


def test_plans_are_made_and_timed_one_after_the_other(
    drawn: ScenarioList, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, real = [], contenders.plan

    def recorded(*arguments: Any, **keywords: Any) -> Plan:  # noqa: ANN401 - as plan
        plan = real(*arguments, **keywords)
        made.append((get_ident(), plan.time))
        return plan

    monkeypatch.setattr(contenders, "plan", recorded)
    comparison = compare(["gap+astar"], drawn, SIM, tmp_path / "out", num_threads=2)
    assert {thread for thread, _ in made} == {get_ident()}
    scores = comparison.records[0].scores
    times = [1e3 * time for _, time in made[:12]]
    for key, percentile in (("planning_p50_ms", 50), ("planning_p99_ms", 99)):
        assert scores[key] == pytest.approx(np.percentile(times, percentile))


TIMES = ("decision_p50_ms", "decision_p99_ms", "planning_p50_ms", "planning_p99_ms")


def untimed(folder: Path) -> dict[str, Any]:
    """results.json without what differs from run to run."""
    record: dict[str, Any] = json.loads((folder / "results.json").read_text())
    del record["command"]
    record["contenders"] = [{k: v for k, v in c.items() if k not in TIMES} for c in record["contenders"]]
    return record


def test_a_comparison_repeats_bit_by_bit_and_continues(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run(out: str, *names: str, threads: int = 1) -> None:
        typed = ["compare", *names, "--episodes", "6", "--level", "real", "--threads", str(threads)]
        assert main([*typed, "--out", str(tmp_path / out)]) == 0

    run("whole", *QUICK)
    run("parts", "gap")
    run("parts", *QUICK, threads=2)
    assert "gap: success" in capsys.readouterr().err.splitlines()[-3]
    for file in ("episodes.jsonl", "success.png", "spl.png", "time.png", "failures.png"):
        assert (tmp_path / "whole" / file).read_bytes() == (tmp_path / "parts" / file).read_bytes(), file
    assert untimed(tmp_path / "whole") == untimed(tmp_path / "parts")
    command = json.loads((tmp_path / "whole/results.json").read_text())["command"]
    assert command == f"navrl compare {' '.join(QUICK)} --episodes 6 --level real --threads 1 --out {tmp_path}/whole"
    # Results are kept, not made again: what stands in the folder is what is reported.
    file = tmp_path / "parts/contenders/gap.json"
    kept = json.loads(file.read_text())
    kept["scores"]["spl"] = 0.125
    file.write_text(json.dumps(kept))
    run("parts", *QUICK)
    assert untimed(tmp_path / "parts")["contenders"][0]["spl"] == 0.125


def test_contenders_of_earlier_calls_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run(out: str, *names: str) -> dict[str, Any]:
        assert main(["compare", *names, "--episodes", "6", "--out", str(tmp_path / out)]) == 0
        return untimed(tmp_path / out)

    run("grown", "straight", "gap")
    capsys.readouterr()
    grown = run("grown", "apf")
    shown = capsys.readouterr()
    assert "grown holds gap, straight, too: they stay in the report\n" in shown.err
    assert "3 contenders on td3" in shown.out
    assert grown["earlier"] == ["gap", "straight"]
    assert "by commands with the same settings: `gap`, `straight`." in (tmp_path / "grown/report.md").read_text()
    whole = run("whole", "apf", "gap", "straight")
    assert whole.pop("earlier") == []
    del grown["earlier"]
    assert grown == whole
    assert (tmp_path / "grown/episodes.jsonl").read_bytes() == (tmp_path / "whole/episodes.jsonl").read_bytes()


def test_other_settings_are_refused(drawn: ScenarioList, tmp_path: Path) -> None:
    out = tmp_path / "out"
    compare(["straight"], drawn.first(3), SIM, out)
    small = replace(SIM, robot=replace(SIM.robot, radius=0.2))
    given = given_list([*drawn.scenarios[:2], drawn.scenarios[4]], SIM)
    others: list[tuple[dict[str, Any], str]] = [
        # What follows from the level is not told besides.
        ({"level": "real"}, "level ideal, not real;"),
        ({"scenarios": drawn.first(4)}, "number of scenarios 3, not 4;"),
        ({"scenarios": given, "level": "real"}, "level ideal, not real; list test, not given;"),
        ({"scenarios": replace(given, name="test")}, "other scenarios by the name of test: the file of the scenarios "),
        ({"sim": replace(SIM, lidar=replace(SIM.lidar, noise=0.5))}, r"lidar\.noise 0\.008, not 0\.5;"),
        (
            {"controllers": replace(ControllersConfig(), gap=replace(ControllersConfig().gap, margin=0.2))},
            rf"gap\.margin {ControllersConfig().gap.margin}, not 0\.2;",
        ),
        (
            {"planner": PlannerConfig(margin=0.3), "sim": small},
            rf"robot\.radius 0\.25, not 0\.2; planner\.margin {PlannerConfig().margin}, ",
        ),
    ]
    for changes, message in others:
        arguments = {"names": ["gap"], "scenarios": drawn.first(3), "sim": SIM, "folder": out} | changes
        with pytest.raises(UserError, match=f"out: holds a comparison with {message}") as refusal:
            compare(**arguments)
        assert "\n" not in str(refusal.value)
        assert str(refusal.value).endswith("; choose another folder, or the same settings")
    with pytest.raises(UserError, match="gap: named twice"):
        compare(["gap", "straight", "gap"], drawn, SIM, out)
    (tmp_path / "other").mkdir()
    (tmp_path / "other/notes.txt").write_text("mine")
    with pytest.raises(UserError, match="other: is not empty and holds no comparison"):
        compare(["gap"], drawn, SIM, tmp_path / "other")


def test_damaged_files_are_said_so(drawn: ScenarioList, tmp_path: Path) -> None:
    for file, content, message in (
        ("settings.json", "{", r"settings\.json: damaged"),
        ("contenders/straight.json", "[]", r"straight\.json: damaged"),
        ("contenders/straight.json", '{"policy_sha256": null}', r"straight\.json: damaged, or .*\.npz is; remove both"),
        ("contenders/straight.json.npz", "", r"straight\.json: damaged, or .*\.npz is; remove both"),
        ("contenders/straight.json", '{"policy_sha256": null, "scores": {"spl": NaN}}', r"straight\.json: damaged"),
        ("contenders/straight.json.npz", "cut", r"straight\.json: damaged, or .*\.npz is; remove both"),
    ):
        out = tmp_path / str(len(list(tmp_path.iterdir())))
        compare(["straight"], drawn.first(2), SIM, out)
        (out / file).write_text(content)
        with pytest.raises(UserError, match=message) as refusal:
            compare(["straight"], drawn.first(2), SIM, out)
        assert "\n" not in str(refusal.value)


def test_another_policy_of_the_same_name_is_refused(drawn: ScenarioList, tmp_path: Path) -> None:
    folder = policy_folder(tmp_path / "policy")
    compare([str(folder)], drawn.first(2), SIM, tmp_path / "out")
    policy_folder(folder, seed=1)
    with pytest.raises(
        UserError, match=r"policy: the policy has changed since .*out; choose another folder, or"
    ) as refusal:
        compare(["straight", str(folder)], drawn.first(2), SIM, tmp_path / "out")
    # That is seen before anything is driven, and the file that it names is the one to remove.
    [kept] = (tmp_path / "out/contenders").glob("*.json")
    assert f"remove {kept} to" in str(refusal.value)
    kept.unlink()
    compare(["straight", str(folder)], drawn.first(2), SIM, tmp_path / "out")


def test_a_policy_for_another_robot_is_refused_but_for_what_the_level_sets(drawn: ScenarioList, tmp_path: Path) -> None:
    limited = replace(SIM, robot=RobotConfig(acceleration_max=1.0, angular_acceleration_max=2.5))
    name = str(policy_folder(tmp_path / "limited", limited))
    with pytest.raises(UserError, match=r"limited: robot\.acceleration_max = 0\.0: the policy was trained for 1\.0"):
        compare([name], drawn.first(2), SIM, tmp_path / "ideal")
    compare([name, "default"], drawn.first(2), SIM, tmp_path / "real", level="real")
    other = str(policy_folder(tmp_path / "beams", replace(SIM, lidar=LidarConfig(beams=360))))
    with pytest.raises(UserError, match=r"beams: lidar\.beams = 180: the policy was trained for 360"):
        compare([other], drawn.first(2), SIM, tmp_path / "out", level="real")


# Settings


def test_classical_settings_are_those_of_the_level(drawn: ScenarioList, tmp_path: Path) -> None:
    ideal, real = (load_config(level=level) for level in LEVELS)
    assert (ideal.controllers, ideal.planner) == (ControllersConfig(), PlannerConfig())
    for key in ("dwa", "gap", "apf"):
        assert getattr(real, key) != getattr(ideal, key)
    given = {"controllers": real.controllers, "planner": real.planner}
    shipped = compare(["dwa+rrt"], drawn, SIM, tmp_path / "a", level="real")
    same = compare(["dwa+rrt"], drawn, SIM, tmp_path / "b", level="real", **given)
    other = compare(["dwa+rrt"], drawn, SIM, tmp_path / "c", level="real", controllers=ideal.controllers)
    assert shipped.records[0].episodes == same.records[0].episodes != other.records[0].episodes


# The command line


def test_mistakes_of_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def refused(*typed: str) -> str:
        assert main(["compare", *typed, "--out", str(tmp_path / "out")]) == 2
        return capsys.readouterr().err.splitlines()[-1]

    assert "nobody: no such folder" in refused("nobody")
    assert "--episodes 0" in refused("gap", "--episodes", "0")
    assert "--boxes 4: goes with --world boxes" in refused("gap", "--boxes", "4")
    assert "learner.tu" in refused("gap", "--learner.tu", "1")
    assert "compare: argument --level" in refused("gap", "--level", "dream")
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").write_text("a file")
    assert "is not a folder" in refused("gap", "--episodes", "2")


def test_nothing_is_announced_that_is_then_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "out")
    assert main(["compare", "straight", "--episodes", "2", "--out", out]) == 0
    assert capsys.readouterr().err.startswith(
        "navrl: comparing 1 contender on td3, list test, level ideal: 2 scenarios; "
    )
    for typed in (
        ["compare", "gap", "--episodes", "2", "--level", "real", "--out", out],
        ["compare", "gap", "--episodes", "2000", "--out", out],
        ["compare", "gap", "--scenarios", str(tmp_path / "none.jsonl"), "--out", out],
        ["play", "gap", "--index", "5000", "--out", str(tmp_path / "a.png")],
        ["eval", "default", "--episodes", "2000"],
    ):
        assert main(typed) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1, typed


def test_settings_of_controllers_leave_the_policys_robot(tmp_path: Path) -> None:
    policy = policy_folder(tmp_path / "small", replace(SIM, robot=replace(SIM.robot, radius=0.15)))
    file = tmp_path / "mine.toml"
    file.write_text("[gap]\nmargin = 0.2\n")
    for out, typed in (("a", ["--config", str(file)]), ("b", ["--gap.margin", "0.2"])):
        names = [str(policy), "gap", *typed]
        assert main(["compare", *names, "--episodes", "3", "--out", str(tmp_path / out)]) == 0
        assert json.loads((tmp_path / out / "settings.json").read_text())["robot.radius"] == 0.15


def test_a_configuration_may_come_through_a_pipe(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe = tmp_path / "mine.toml"
    os.mkfifo(pipe)
    writer = Thread(target=pipe.write_text, args=("[robot]\nradius = 0.3\n",))
    writer.start()
    assert main(["compare", "default", "gap", "--config", str(pipe), "--out", str(tmp_path / "out")]) == 2
    writer.join()
    assert "default: robot.radius = 0.3: the policy was trained for 0.25" in capsys.readouterr().err


def test_a_policy_for_the_level_real_is_not_compared_at_ideal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = policy_folder(tmp_path / "real", at_level(SIM, "real"))
    command = ["compare", str(policy), "gap", "--episodes", "3", "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("real: was trained for --level real")
    assert main([*command, "--level", "real"]) == 0


def test_settings_of_controllers_count(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[gap]\nmargin = 0.2\n")
    for out, typed in (("a", ["--config", str(file)]), ("b", ["--gap.margin", "0.2"]), ("c", [])):
        assert main(["compare", "gap", "default", *typed, "--episodes", "10", "--out", str(tmp_path / out)]) == 0
    a, b, c = (untimed(tmp_path / out)["contenders"] for out in "abc")
    assert a == b
    assert a[0] != c[0]
    # What it does alone is the same; means over what all solve depend on the other.
    alone = [{key: value for key, value in one.items() if not key.startswith("common_")} for one in (a[1], c[1])]
    assert alone[0] == alone[1]
    assert load_policy("default").description.v_max == 0.5
