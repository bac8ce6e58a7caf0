"""The search for settings: what it makes small, what it may read, and that it continues as if never interrupted."""

import tomllib
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import navrl.tune
from navrl.cli import main
from navrl.config import Config, PlannerConfig, SimConfig, WorldConfig
from navrl.config.controllers import TUNABLE
from navrl.config.files import load_config
from navrl.config.levels import at_level
from navrl.config.searching import searched
from navrl.errors import UserError
from navrl.metrics import Episode
from navrl.tune import penalised_time, tune

BOXES = Config(world=WorldConfig(name="boxes", boxes=4))


def test_a_search_at_a_level_drives_the_robot_of_that_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    searched_for = []

    def search(name: str, config: Config, folder: Path, **_: object) -> SimpleNamespace:
        searched_for.append(config)
        scores = {"success_rate": 0.5, "success_ci95": (0.4, 0.6), "spl": 0.3}
        return SimpleNamespace(scores=scores, cut=0, refused=0, at_ends=[])

    monkeypatch.setattr(navrl.tune, "tune", search)
    for level in ("ideal", "real"):
        assert main(["tune", "gap", "--level", level, "--gap.margin", "0.1", "--out", str(tmp_path / level)]) == 0
    ideal, real = searched_for
    assert ideal.sim == Config().sim
    assert real.sim == at_level(SimConfig(), "real")
    assert ideal.gap.margin == real.gap.margin == 0.1


def test_failures_cost_ten_time_limits() -> None:
    def episode(outcome: str, time_s: float) -> Episode:
        return Episode(0, outcome, 1, time_s, 1.0, 1.0, 0.0, None)  # type: ignore[arg-type]

    episodes = [episode("goal", 12.0), episode("collision", 3.0), episode("timeout", 50.0), episode("goal", 8.0)]
    # (12 + 500 + 500 + 8) / 4
    assert penalised_time(SimpleNamespace(episodes=episodes), 50.0) == 255.0  # type: ignore[arg-type]


SETTINGS = load_config(), load_config(level="real")


@pytest.mark.parametrize("table", [getattr(config, name) for config in SETTINGS for name in (*TUNABLE, "planner")])
def test_all_that_is_searched_is_allowed_and_holds_what_ships(table: object) -> None:
    space = searched(type(table))
    assert space
    for key, search in space.items():
        assert search.low < search.high
        for value in (search.low, search.high):
            assert getattr(replace(table, **{key: value}), key) == value  # type: ignore[type-var]
        # What ships lies at neither end of what a search would look at now.
        value = getattr(table, key)
        assert search.low < value < search.high
        assert not navrl.tune._at_end(value, search)


def test_a_search_continues_as_if_it_had_not_stopped(tmp_path: Path) -> None:
    optuna = pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    whole = tune("gap", BOXES, tmp_path / "whole", trials=4, episodes=5, seed=1)
    tune("gap", BOXES, tmp_path / "parts", trials=2, episodes=5, seed=1)
    storage = f"sqlite:///{tmp_path / 'parts' / navrl.tune.STUDY_FILE}"
    # A trial that was cut short.
    optuna.load_study(study_name="tune", storage=storage).ask()
    parts = tune("gap", BOXES, tmp_path / "parts", trials=4, episodes=5, seed=1)
    assert parts == whole
    # Nothing is left to do.
    assert tune("gap", BOXES, tmp_path / "parts", trials=4, episodes=5, seed=1) == whole
    written = tmp_path / "whole" / navrl.tune.BEST_FILE
    assert load_config(written).gap == whole.config.gap
    assert tomllib.loads(written.read_text()) == {"gap": asdict(whole.config.gap)}
    assert whole.config == replace(BOXES, gap=whole.config.gap)
    assert (whole.cut, parts.cut, whole.refused) == (0, 1, 0)
    assert whole.scores["list"] == "tuning"
    with pytest.raises(UserError, match=r"parts: holds a search with another seed: 1, not 2"):
        tune("gap", BOXES, tmp_path / "parts", trials=4, episodes=5, seed=2)
    with pytest.raises(UserError, match=r"parts: holds a search with another controller"):
        tune("apf", BOXES, tmp_path / "parts", trials=4, episodes=5, seed=1)


def test_the_first_trial_has_the_settings_as_configured(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    given = replace(BOXES, apf=replace(BOXES.apf, turn_gain=2.5))
    best = tune("apf", given, tmp_path / "study", trials=1, episodes=5)
    assert best.trial == 0
    assert best.config == given
    # What is configured outside of what is searched widens that, and stands at its end.
    far = replace(BOXES, apf=replace(BOXES.apf, turn_gain=200.0))
    best = tune("apf", far, tmp_path / "far", trials=1, episodes=2)
    assert best.config.apf.turn_gain == 200.0
    assert best.at_ends == ["apf.turn_gain"]
    assert "#   apf.turn_gain = 200.0, 0.05 to 200.0 by powers\n" in (tmp_path / "far" / "best.toml").read_text()
    with pytest.raises(UserError, match=r"^apf\.turn_gain = 0\.0: a search by powers cannot begin there"):
        tune("apf", replace(BOXES, apf=replace(BOXES.apf, turn_gain=0.0)), tmp_path / "none", trials=1, episodes=2)


def test_what_leads_is_searched_with_what_is_led(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    found = tune("pursuit+astar", BOXES, tmp_path / "pursuit", trials=3, episodes=5)
    written = tomllib.loads((tmp_path / "pursuit" / "best.toml").read_text())
    assert written.keys() == {"pursuit", "planner"}
    assert found.config.planner.lookahead == PlannerConfig().lookahead
    tune("gap+rrt", BOXES, tmp_path / "gap", trials=1, episodes=5)
    text = (tmp_path / "gap" / "best.toml").read_text()
    assert "#   planner.lookahead = 1.0, 0.2 to 5.0 by powers\n" in text
    assert "dwa" not in text
    # Where nothing limits accelerations, the time to reach a speed does nothing.
    for level, expected in (("ideal", False), ("real", True)):
        config = at_level(Config(), level)  # type: ignore[arg-type]
        tune("dwa", config, tmp_path / level, trials=1, episodes=2)
        assert ("#   dwa.interval" in (tmp_path / level / "best.toml").read_text()) == expected


def test_settings_that_exclude_each_other_are_counted_and_told(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    # A goal of 2.4 m lets nobody look ahead by less than 0.8 m.
    wide = replace(BOXES, task=replace(BOXES.task, goal_radius=2.4), pursuit=replace(BOXES.pursuit, lookahead=0.9))
    never = replace(wide, pursuit=replace(wide.pursuit, lookahead=0.35))
    with pytest.raises(UserError, match=r"no trial could be driven: .*look"):
        tune("pursuit+astar", never, tmp_path / "never", trials=1, episodes=3)
    best = tune("pursuit+astar", wide, tmp_path / "some", trials=6, episodes=3)
    assert 0 < best.refused < 6
    assert (
        f"refused as settings that exclude each other: {best.refused}\n"
        in (tmp_path / "some" / "best.toml").read_text()
    )


def test_what_differs_is_named_and_a_smaller_budget_refused(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    tune("gap", BOXES, tmp_path / "study", trials=2, episodes=3)
    other = replace(BOXES, gap=replace(BOXES.gap, reach=2.5))
    with pytest.raises(UserError, match=r"study: holds a search with another gap\.reach: .*, not 2\.5"):
        tune("gap", other, tmp_path / "study", trials=2, episodes=3)
    with pytest.raises(UserError, match=r"study: holds a search with another episodes: 3, not 4"):
        tune("gap", BOXES, tmp_path / "study", trials=2, episodes=4)
    with pytest.raises(UserError, match=r"study: holds 2 trials already, more than 1"):
        tune("gap", BOXES, tmp_path / "study", trials=1, episodes=3)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "settings.json").touch()
    with pytest.raises(UserError, match=r"other: is not empty and holds no search"):
        tune("gap", BOXES, tmp_path / "other", trials=1, episodes=3)


def test_cells_too_small_for_the_map_are_refused_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    fine = replace(BOXES, planner=replace(BOXES.planner, resolution=0.001))
    with pytest.raises(UserError, match=r"no trial could be driven: planner\.resolution = 0\.001: expected at least"):
        tune("pursuit+astar", fine, tmp_path, trials=1, episodes=3)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    folder = tmp_path / "study"
    words = ["tune", "gap", "--world", "boxes", "--boxes", "4", "--trials", "2", "--episodes", "5"]
    assert main([*words, "--out", str(folder), "--gap.margin", "0.05"]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("gap: success ")
    assert f"settings: {folder / navrl.tune.BEST_FILE}" in printed.out
    assert "trial 0 of 2" in printed.err
    head = (folder / navrl.tune.BEST_FILE).read_text().splitlines()
    assert head[0] == f"# navrl {' '.join(words)} --out {folder} --gap.margin 0.05"
    assert "of 2, " in head[1]
    assert "seed 0, each on the first 5 scenarios of the tuning list" in head[1]
    assert head[2].startswith("# boxes with 4 boxes, level ideal: success ")
    assert head[3] == "# not counted: 0 cut short; refused as settings that exclude each other: 0"
    assert f"#   gap.reach = {Config().gap.reach}, 0.1 to 10.0 by powers" in head


def test_a_search_has_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = []

    def search(name: str, config: Config, folder: Path, **_: object) -> SimpleNamespace:
        folders.append(str(folder))
        scores = {"success_rate": 0.5, "success_ci95": (0.4, 0.6), "spl": 0.3}
        return SimpleNamespace(scores=scores, cut=1, refused=2, at_ends=["gap.reach"])

    monkeypatch.setattr(navrl.tune, "tune", search)
    monkeypatch.chdir(tmp_path)
    assert main(["tune", "gap"]) == 0
    assert main(["tune", "pursuit+astar", "--world", "boxes", "--boxes", "4", "--level", "real", "--seed", "3"]) == 0
    assert folders == ["runs/tune-gap-td3-ideal-seed0", "runs/tune-pursuit+astar-boxes4-real-seed3"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["dwb"], "tune: dwb: must be one of dwa, apf, gap, mppi, pursuit, with or without + and one of astar, "),
        (["dwa+teb"], "tune: dwa+teb: must be one of dwa"),
        (["default+astar"], "tune: default+astar: must be one of dwa"),
        (["pursuit"], "pursuit: follows a path: name a planner too, such as pursuit+astar"),
        (["dwa", "--trials", "0"], "--trials 0: must be a whole number in [1, 1000000]"),
        (["dwa", "--boxes", "4"], "--boxes 4: goes with --world boxes"),
        (["dwa", "--list", "test"], "tune: --list: no such option"),
        (["dwa", "--dwa.horizon", "-1"], "--dwa.horizon: dwa.horizon = -1: must be a number in [0.001, 60]"),
        (["dwa", "--episodes", "501"], "501 scenarios of the list tuning: it has 1 to 500"),
    ],
)
def test_refusals(words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", *words, "--out", str(tmp_path / "study")]) == 2
    assert message in capsys.readouterr().err


def test_a_search_beside_another_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    drive, begun = navrl.tune._drive, []

    def interrupted(*arguments: Any) -> Any:  # noqa: ANN401 - whatever a trial has
        if not begun:
            begun.append(True)
            tune("gap", BOXES, tmp_path, trials=2, episodes=2)
        return drive(*arguments)

    monkeypatch.setattr(navrl.tune, "_drive", interrupted)
    with pytest.raises(UserError, match=r": another process searches there, too$"):
        tune("gap", BOXES, tmp_path, trials=2, episodes=2)


def test_a_damaged_study_is_said_so(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    (tmp_path / "study.db").write_bytes(b"no database" * 40)
    with pytest.raises(UserError, match=r"study\.db: cannot be used"):
        tune("gap", Config(), tmp_path, trials=1, episodes=2)
