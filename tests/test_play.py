"""Pictures and films of an episode: the same episode as the evaluation's, complete, and written whole."""

import builtins
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from navrl.config import SimConfig
from navrl.drawing import trajectory as trajectories
from navrl.drawing.film import FRAMES_MAX, check_output, frame_steps, shown_speed, write
from navrl.drawing.legend import Item, box, legend
from navrl.drawing.trajectory import Trajectory, with_idle
from navrl.errors import UserError
from navrl.evaluate import Pilot, driver, evaluate
from navrl.scenarios import ScenarioList, load_list


class TowardsGoal:
    """Turns to the goal and drives, for one robot or many; reacts to the noise of the lidar."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        rows = np.atleast_2d(observations)
        nearest, angle = rows[:, :20].min(axis=1), rows[:, 21]
        turn = np.clip(2 * angle + 0.2 * np.maximum(0, 1 - nearest), -1, 1)
        actions = np.stack([np.where(np.abs(angle) < 0.5, 1, -1), turn], axis=1).astype(np.float32)
        return actions.reshape(*observations.shape[:-1], 2)


def drive(pilot: Pilot, drawn: ScenarioList, index: int, sim: SimConfig) -> Trajectory:
    """Drives a scenario of a list."""
    return trajectories.drive(driver(pilot, sim), with_idle(drawn, index, sim), sim)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> ScenarioList:
    with pytest.MonkeyPatch.context() as context:
        context.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        return load_list(SimConfig(), "test", count=20)


@pytest.fixture(scope="module")
def trajectory(drawn: ScenarioList) -> Trajectory:
    episodes = evaluate(TowardsGoal(), drawn, sim=SimConfig()).episodes
    index = next(e.index for e in episodes if e.outcome == "goal" and e.steps > 60)
    return drive(TowardsGoal(), drawn, index, SimConfig())


def test_the_episode_is_that_of_the_evaluation(drawn: ScenarioList) -> None:
    episodes = evaluate(TowardsGoal(), drawn, sim=SimConfig()).episodes
    for index in (0, 7, 19):
        driven = drive(TowardsGoal(), drawn, index, SimConfig())
        assert (driven.steps, driven.outcome) == (episodes[index].steps, episodes[index].outcome)
        assert driven.velocities[:, 0].sum() * 0.1 == pytest.approx(episodes[index].path_m, abs=0.05)
        assert tuple(driven.poses[0]) == pytest.approx(drawn.scenarios[index].start)
        assert len(driven.poses) == len(driven.ranges) == len(driven.velocities) == driven.steps + 1


def test_a_place_outside_the_list_is_refused(drawn: ScenarioList) -> None:
    with pytest.raises(UserError, match="--index 20: test has scenarios 0 to 19"):
        drive(TowardsGoal(), drawn, 20, SimConfig())


def test_moments_tell_the_outcome_at_the_end_only(trajectory: Trajectory) -> None:
    assert trajectory.moment(0).outcome == "running"
    assert trajectory.moment(trajectory.steps - 1).outcome == "running"
    last = trajectory.moment(trajectory.steps)
    assert (last.outcome, last.step, len(last.path)) == ("goal", trajectory.steps, trajectory.steps + 1)


def test_frames_of_a_film() -> None:
    # 10 Hz shown 2.5 times as fast in 12.5 frames a second: every second step.
    shown, interval = frame_steps(10, 0.1, 12.5)
    assert (shown, interval) == ([0, 2, 4, 6, 8, 10], pytest.approx(0.08))
    assert frame_steps(3, 0.1, 25.0) == ([0, 1, 2, 3], pytest.approx(0.04))
    # The last step is always shown.
    assert frame_steps(7, 0.1, 12.5)[0][-2:] == [6, 7]
    for steps in (500, 5000):
        shown, _ = frame_steps(steps, 0.1, 12.5)
        assert shown[-1] == steps
        assert len(shown) <= FRAMES_MAX + 2


@pytest.mark.parametrize(
    ("steps", "rate", "speed"), [(1, 12.5, 2.5), (300, 12.5, 2.5), (300, 25.0, 2.5), (5000, 12.5, 21.25)]
)
def test_the_speed_that_is_told_is_the_one_that_is_shown(steps: int, rate: float, speed: float) -> None:
    assert shown_speed(steps, 0.1, rate) == pytest.approx(speed)
    shown, interval = frame_steps(steps, 0.1, rate)
    if len(shown) > 2:
        assert 0.1 * shown[-2] / (interval * (len(shown) - 2)) == pytest.approx(speed)


def test_films_say_how_fast_they_run_and_pictures_explain_their_marks(
    trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    explained: list[str] = []

    def listening(items: Sequence[Item], *, width: int) -> Image.Image:
        explained[:] = [item.label for item in items]
        return legend(items, width=width)

    monkeypatch.setattr("navrl.drawing.render.legend", listening)
    write(trajectory, tmp_path / "a.gif", title="test")
    assert explained == ["start", "goal", "driven", "rays: 0.35 to 4 m", "grid 1 m", "shown 2.5 times as fast"]
    planned = replace(trajectory, planned=trajectory.poses[::5, :2])
    assert write(planned, tmp_path / "a.png", title="test") is None
    assert explained[2:4] == ["driven", "planned"]
    assert explained[-1] == "the robot every 2 s"


def test_a_legend_takes_as_many_rows_as_it_needs() -> None:
    items = [Item(word, box((200, 0, 0))) for word in ("one", "two", "three", "four")]
    wide, narrow = legend(items, width=600), legend(items, width=130)
    assert (wide.width, narrow.width) == (600, 130)
    assert wide.height < narrow.height
    for picture in (wide, narrow):
        red = (np.asarray(picture) == (200, 0, 0)).all(axis=2).sum()
        assert red == pytest.approx(4 * 18 * 8, rel=0.2)


def test_a_picture(trajectory: Trajectory, tmp_path: Path) -> None:
    write(trajectory, tmp_path / "episode.png", title="test")
    with Image.open(tmp_path / "episode.png") as picture:
        assert picture.format == "PNG"
        assert max(picture.size) >= 1000
        colors = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    # Something of everything: obstacles, path or robot (blue), goal (green).
    for r, g, b in ((74, 85, 104), (37, 99, 235), (29, 78, 216), (5, 150, 105)):
        assert (np.abs(colors.astype(int) - (r, g, b)).max(axis=1) < 8).sum() > 100


def test_a_film(trajectory: Trajectory, tmp_path: Path) -> None:
    assert write(trajectory, tmp_path / "episode.gif", title="test") == pytest.approx(2.5)
    shown, _ = frame_steps(trajectory.steps, 0.1, 12.5)
    with Image.open(tmp_path / "episode.gif") as film:
        assert film.n_frames == len(shown)
        assert film.info["duration"] == 80
        frames = []
        for k in (0, film.n_frames // 2, film.n_frames - 1):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB")).astype(int))
        assert film.info["duration"] == 1500
        assert film.info["loop"] == 0
    for one, other in pairwise(frames):
        assert (np.abs(one - other).max(axis=2) > 30).sum() > 200
    assert (tmp_path / "episode.gif").stat().st_size < 60_000 * len(shown)


@pytest.mark.skipif(find_spec("imageio_ffmpeg") is None, reason="needs the extra package for films")
def test_a_video(trajectory: Trajectory, tmp_path: Path) -> None:
    write(trajectory, tmp_path / "episode.mp4", title="test")
    assert (tmp_path / "episode.mp4").read_bytes()[4:8] == b"ftyp"
    assert [p.name for p in tmp_path.iterdir()] == ["episode.mp4"]


def test_a_video_without_its_package_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import navrl.drawing.film

    def missing(name: str, *_: Any) -> Any:  # noqa: ANN401 - as import_module
        raise ImportError(name)

    monkeypatch.setattr(navrl.drawing.film, "import_module", missing)
    with pytest.raises(UserError, match=r"film\.mp4: needs the extra package of pip install 'navrl\[video\]'"):
        check_output(tmp_path / "film.mp4")


@pytest.mark.parametrize("name", ["film.avi", "film", "png", "a/b.gif"])
def test_names_that_cannot_be_written_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=name.replace(".", r"\.")):
        check_output(tmp_path / name)


def test_a_failed_write_leaves_the_older_picture(
    trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "episode.png"
    file.write_bytes(b"older")

    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="no space left"):
        write(trajectory, file, title="test")
    assert file.read_bytes() == b"older"
    assert [p.name for p in tmp_path.iterdir()] == ["episode.png"]


def test_torch_is_not_imported_to_play(monkeypatch: pytest.MonkeyPatch, trajectory: Trajectory, tmp_path: Path) -> None:
    real = builtins.__import__

    def guarded(name: str, *arguments: Any, **keywords: Any) -> Any:  # noqa: ANN401 - as __import__
        assert name.partition(".")[0] != "torch"
        return real(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", guarded)
    write(trajectory, tmp_path / "episode.png", title="test")
