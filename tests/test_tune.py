"""The search for settings: what it makes small, what it may read, and that it continues as if never interrupted."""

import tomllib
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

import navrl.tune
from navrl.cli import main
from navrl.config import Config, ControllersConfig, SimConfig, WorldConfig
from navrl.config.controllers import TUNABLE, searched
from navrl.config.files import load_config
from navrl.config.levels import at_level
from navrl.errors import UserError
from navrl.metrics import Episode
from navrl.tune import penalised_time, tune

BOXES = Config(world=WorldConfig(name="boxes", boxes=4))


def test_a_search_at_a_level_drives_the_robot_of_that_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    searched_for = []

    def search(name: str, config: Config, folder: Path, **_: object) -> SimpleNamespace:
        searched_for.append(config)
        return SimpleNamespace(scores={"success_rate": 0.5, "success_ci95": (0.4, 0.6), "spl": 0.3})

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


@pytest.mark.parametrize("name", TUNABLE)
def test_all_that_is_searched_is_allowed(name: str) -> None:
    space = searched(name)  # type: ignore[arg-type]
    table = getattr(ControllersConfig(), name)
    assert space
    for key, search in space.items():
        assert search.low < search.high
        for value in (search.low, search.high):
            assert getattr(replace(table, **{key: float(value)}), key) == value
        # What ships was found by the search or is its beginning.
        assert search.low <= getattr(table, key) <= search.high


def test_a_search_continues_as_if_it_had_not_stopped(tmp_path: Path) -> None:
    optuna = pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    whole = tune("gap", BOXES, tmp_path / "whole", trials=4, episodes=5, seed=1)
    tune("gap", BOXES, tmp_path / "parts", trials=2, episodes=5, seed=1)
    storage = f"sqlite:///{tmp_path / 'parts' / navrl.tune.STUDY_FILE}"
    # A trial that was cut short.
    optuna.load_study(study_name="tune", storage=storage).ask()
    assert tune("gap", BOXES, tmp_path / "parts", trials=4, episodes=5, seed=1) == whole
    # Nothing is left to do.
    assert tune("gap", BOXES, tmp_path / "parts", trials=4, episodes=5, seed=1) == whole
    written = tmp_path / "whole" / navrl.tune.BEST_FILE
    assert load_config(written).gap == whole.settings.gap
    assert tomllib.loads(written.read_text()) == {"gap": asdict(whole.settings.gap)}
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
    assert best.settings == given.controllers


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    folder = tmp_path / "study"
    words = ["tune", "gap", "--world", "boxes", "--boxes", "4", "--trials", "2", "--episodes", "5"]
    assert main([*words, "--out", str(folder), "--gap.margin", "0.05"]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("gap: success ")
    assert f"settings: {folder / navrl.tune.BEST_FILE}" in printed.out
    assert "trial 0 of 2" in printed.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["dwb"], "tune: dwb: must be one of dwa, apf, gap, mppi"),
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


def test_a_damaged_study_is_said_so(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: nothing is searched")
    (tmp_path / "study.db").write_bytes(b"no database" * 40)
    with pytest.raises(UserError, match=r"study\.db: damaged, or of something else"):
        tune("gap", Config(), tmp_path, trials=1, episodes=2)
