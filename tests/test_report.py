"""What a comparison leaves to be read and looked at: tables, files and pictures, each figure where it belongs."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from contending import SIM, policy_folder, scenario
from navrl import machine
from navrl.cli import main
from navrl.compare import Comparison, compare, enter, write
from navrl.comparing import plots
from navrl.comparing.report import markdown, terminal
from navrl.comparing.short_names import LONGEST, short_names
from navrl.comparing.tables import percent
from navrl.scenarios import ScenarioList, given_list

pytestmark = pytest.mark.usefixtures("quick")


@pytest.fixture(scope="module")
def three(drawn: ScenarioList, tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    """Of three, one of which fails often."""
    with pytest.MonkeyPatch.context() as context:
        context.setattr("navrl.comparing.timing.CALLS", 20)
        return compare(["straight", "dwa", "pursuit+astar"], drawn, SIM, tmp_path_factory.mktemp("three"))


def table(text: str, title: str) -> list[dict[str, str]]:
    """Rows of a table of report.md by its headers."""
    lines = [line for line in text.split(f"## {title}\n")[1].split("\n## ")[0].splitlines() if line.startswith("|")]
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(head, row, strict=True)) for row in rows]


# Tables


def test_the_figures_of_all_files_are_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["compare", "random", "default", "gap+rrt", "--episodes", "8", "--out", str(out)]) == 0
    text = (out / "report.md").read_text()
    assert f"    navrl compare random default gap+rrt --episodes 8 --out {out}" in text
    results = json.loads((out / "results.json").read_text())
    arrive, drive, think = (table(text, title) for title in ("Who arrives", "How they drive", "How long they think"))
    printed = capsys.readouterr().out

    def share(scores: dict[str, Any], key: str) -> str:
        low, high = scores[f"{key}_ci95"]
        return f"{percent(scores[f'{key}_rate'])} ({percent(low)}-{percent(high)})"

    for scores, *rows in zip(results["contenders"], arrive, drive, think, strict=True):
        assert {row["contender"] for row in rows} == {scores["name"]}
        arrives, drives, thinks = rows
        for header, key in (
            ("success (%, 95 % CI)", "success"),
            ("collision (%, 95 % CI)", "collision"),
            ("time-out (%, 95 % CI)", "timeout"),
            ("detour solved (%, 95 % CI)", "detour_success"),
        ):
            assert arrives[header] == share(scores, key)
            assert arrives[header] in printed
        assert arrives["SPL"] == f"{scores['spl']:.3f}"
        assert thinks["decision p50 (ms)"] == f"{scores['decision_p50_ms']:.3f}"
        assert re.search(rf"^{re.escape(scores['name'])} .* {thinks['decision p50 (ms)']}$", printed, re.MULTILINE)
        if scores["name"] == "gap+rrt":
            assert thinks["plan p99 (ms)"] == f"{scores['planning_p99_ms']:.2f}"
            assert drives["time (s)"] == f"{scores['time_to_goal_s']:.2f}"
    assert len(results["pairs"]) == 3
    for pair, row in zip(results["pairs"], table(text, "Each against each"), strict=True):
        assert [row["a"], row["b"], row["only a"], row["only b"]] == [
            str(pair[k]) for k in ("a", "b", "only_a", "only_b")
        ]
        low, high = pair["spl_diff_ci95"]
        assert row["SPL a - b (95 % CI)"] == f"{pair['spl_diff']:+.3f} ({low:+.3f} to {high:+.3f})"
    assert "3 contenders on td3, list test, level ideal: 8 scenarios" in printed
    assert f"{out}/report.md: clearance" in printed


def test_results_and_report_say_what_made_them(three: Comparison, tmp_path: Path) -> None:
    made = machine.made_with()
    record = three.to_json("typed")
    assert {key: record[key] for key in made} == made
    assert [entry["made_with"] for entry in record["contenders"]] == [made] * 3
    text = markdown(three, "typed", [])
    assert text.count(machine.cpu_model()) == 1
    assert f"navrl {made['navrl']}" in text
    # What was kept may come from elsewhere.
    three.records[1].made_with["cpu"] = "another"
    text = markdown(three, "typed", [])
    three.records[1].made_with["cpu"] = made["cpu"]
    assert re.search(r"; another; \w+: `dwa`\.", text)
    assert re.search(r"; \w+: `straight`, `pursuit\+astar`\.", text)


def test_the_terminal_has_80_columns(drawn: ScenarioList, tmp_path: Path) -> None:
    folder = policy_folder(tmp_path / "a-policy-in-a-folder-with-a-long-name")
    still = enter("[red]mine", lambda ranges, *_: np.zeros((len(ranges), 2)))
    comparison = compare([f"{folder}+antcolony", str(folder), still], drawn.first(4), SIM, tmp_path / "out")
    printed = terminal(comparison, "out/report.md", Console(width=80))
    tables = printed.rpartition("out/report.md: ")[0].splitlines()
    assert max(len(line) for line in tables) <= 80
    # Neither a name nor a number is cut.
    for row, record in zip(table(markdown(comparison, "typed", []), "Who arrives"), comparison.records, strict=True):
        assert any(line.startswith(f"{row['contender']} ") for line in tables)
        assert f"is `{record.name}`" in markdown(comparison, "typed", []) or row["contender"] == record.name
    assert "…" not in printed


def test_shares_are_exact_where_they_are_all_or_none() -> None:
    assert [percent(share) for share in (0.0, 1.0, 0.983, 0.05)] == ["0", "100", "98.3", "5.0"]


LONG = "/data/robots/experiments/2026"


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["dwa", "runs/office"], ["dwa", "runs/office"]),
        ([f"{LONG}/seed0", f"{LONG}/seed1+astar"], [".../2026/seed0", ".../seed1+astar"]),
        ([f"{LONG}/a/policy", f"{LONG}/b/policy"], [".../2026/a/policy", ".../2026/b/policy"]),
        ([f"/a{LONG}/policy", f"/b{LONG}/policy"], [".../2026/policy #1", ".../2026/policy #2"]),
        ([f"{LONG}/never-ends-and-goes-on-for-ever"], ["...goes-on-for-ever"]),
        ([f"{LONG}/seed0", ".../2026/seed0"], [".../2026/seed0 #1", ".../2026/seed0"]),
    ],
)
def test_long_names_keep_their_ends_and_stay_apart(names: list[str], expected: list[str]) -> None:
    assert short_names(names) == expected
    assert all(len(short) <= LONGEST for short in expected)


# Files


def test_write_does_what_the_command_does(tmp_path: Path) -> None:
    """From Python, for a function as for any other."""
    from navrl.scenarios import load_list

    assert main(["compare", "straight", "gap", "--episodes", "5", "--out", str(tmp_path / "a")]) == 0
    typed = json.loads((tmp_path / "a/results.json").read_text())["command"]
    comparison = compare(["straight", "gap"], load_list(SIM, "test", count=5), SIM, tmp_path / "b")
    write(comparison, tmp_path / "b", typed)
    files = [sorted(path.name for path in (tmp_path / out).iterdir()) for out in "ab"]
    assert files[0] == files[1]
    assert {"results.json", "episodes.jsonl", "report.md", "success.png", "spl.png", "time.png"} <= set(files[0])
    for file in files[0]:
        if file not in ("contenders", "report.md", "results.json"):
            assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file
    first, second = ((tmp_path / out / "report.md").read_text().split("## How long they think") for out in "ab")
    assert first[0] == second[0]


# Pictures


def test_the_report_shows_its_pictures(three: Comparison, tmp_path: Path) -> None:
    write(three, tmp_path, "typed")
    for file in ("success.png", "spl.png", "time.png", "failures.png"):
        assert f"]({file})" in (tmp_path / "report.md").read_text()
        assert min(Image.open(tmp_path / file).size) > 100


def test_success_is_drawn_where_it_lies_and_explained(three: Comparison) -> None:
    picture = plots.success(three)
    rate = three.records[0].scores["success_rate"]
    assert 0 < rate < 1
    colors = np.asarray(picture).astype(int)
    row = plots.HEAD_PX + plots.ROW_PX // 2 + 6
    within = colors[row, plots.NAMES_PX : plots.NAMES_PX + plots.PLOT_PX]
    green = plots.OUTCOME_FILLS["goal"]
    assert (within == green).all(axis=1).sum() == pytest.approx(rate * plots.PLOT_PX, abs=2)
    # Every colour of a bar stands in the legend, above all bars.
    for color in plots.OUTCOME_FILLS.values():
        assert (np.abs(colors[: plots.HEAD_PX] - color).max(axis=2) < 4).sum() > 50


def test_colours_of_outcomes_differ_in_lightness() -> None:
    """So that they can be told apart without seeing red and green, and in print."""
    lightness = sorted(float(np.dot(color, (0.299, 0.587, 0.114))) for color in plots.OUTCOME_FILLS.values())
    assert min(np.diff(lightness)) > 25


def test_the_worst_failures_are_those_that_others_solve(three: Comparison) -> None:
    shown = plots.worst_failures(three)
    assert shown
    solvers = np.sum([record.solved() for record in three.records], axis=0)
    for record in three.records:
        mine = [index for other, index in shown if other is record]
        failed = [index for index, solved in enumerate(record.solved()) if not solved]
        assert len(mine) == min(len(failed), plots.PER_CONTENDER)
        left_out = [solvers[index] for index in failed if index not in mine]
        assert all(solvers[index] >= max(left_out, default=0) for index in mine)
        assert set(mine) <= set(failed)


def test_nobody_fails_in_an_open_world(tmp_path: Path) -> None:
    comparison = compare(["straight", "default"], given_list([scenario()], SIM), SIM, tmp_path / "out")
    assert plots.failures(comparison) is None
    assert [pair.mcnemar_p for pair in comparison.pairs] == [1.0]
    (tmp_path / "out/failures.png").write_text("of an earlier call")
    assert "failures.png" not in [file for file, _ in plots.write(comparison, tmp_path / "out")]
    assert not (tmp_path / "out/failures.png").exists()


def test_nobody_solves_what_all_solve(drawn: ScenarioList, tmp_path: Path) -> None:
    still = enter("still", lambda ranges, *_: np.zeros((len(ranges), 2)))
    comparison = compare(["straight", still], drawn.first(2), SIM, tmp_path / "out")
    write(comparison, tmp_path / "out", "typed")
    text = (tmp_path / "out/report.md").read_text()
    assert "Means over the 0 scenarios that every contender solves." in text
    assert "| contender |" not in text.split("## Where all arrive")[1].split("##")[0]
