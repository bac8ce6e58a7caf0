"""What a run reports: the numbers by brute force, metrics.csv and TensorBoard without duplicates, the display."""

import csv
import io
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from navrl import display
from navrl.errors import UserError
from navrl.metrics import Episode, Scores, summarize
from navrl.running.metrics_log import MetricsLog, ResumePoint
from navrl.running.monitor import SATURATED_ROWS, Monitor, result_lines
from navrl.running.training_metrics import CLOCKED, COLUMNS, Progress, Rates, Row, TrainingMetrics
from navrl.td3 import UpdateMetrics

ROBOTS = 3


def random_step(generator: np.random.Generator) -> SimpleNamespace:
    """What the metrics read of a simulator; every third robot's episode ends."""
    outcome = generator.choice([0, 0, 0, 1, 2, 3], ROBOTS).astype(np.uint8)
    return SimpleNamespace(
        rewards=generator.normal(size=ROBOTS).astype(np.float32),
        velocities=generator.normal(size=(ROBOTS, 2)),
        outcome=outcome,
        terminated=(outcome == 1) | (outcome == 2),
        truncated=outcome == 3,
        episode_returns=generator.normal(size=ROBOTS),
        episode_steps=generator.integers(1, 500, ROBOTS, dtype=np.uint32),
    )


def updates(loss: float, *, actor_updates: int = 0, actor_loss: float = math.nan) -> UpdateMetrics:
    return UpdateMetrics(
        critic_loss=loss,
        average_q=2 * loss,
        maximum_q=3 * loss,
        actor_updates=actor_updates,
        actor_loss=actor_loss,
        saturated_share=actor_loss / 100,
    )


def scores(success: int = 3, of: int = 4) -> Scores:
    episodes = [Episode(i, "goal" if i < success else "timeout", 10, 1.0, 2.0, 1.5, 50.0 + i, 0.1) for i in range(of)]
    return summarize("validation", "0" * 64, episodes)


def row(steps: int = 100, **values: float | None) -> Row:
    return dict.fromkeys(COLUMNS) | {"steps": steps} | values


def test_rates_and_means_equal_those_by_brute_force() -> None:
    generator = np.random.Generator(np.random.Philox(1))
    metrics = TrainingMetrics(ROBOTS, reward_scale=0.5)
    ended: list[tuple[int, float, float, int]] = []
    running = [0.0] * ROBOTS
    for _ in range(300):
        sim = random_step(generator)
        metrics.add_step(sim)
        for k in range(ROBOTS):
            running[k] += float(sim.rewards[k])
            if sim.outcome[k]:
                ended.append((sim.outcome[k], sim.episode_returns[k], running[k], sim.episode_steps[k]))
                running[k] = 0.0
    newest = ended[-100:]
    rates = metrics.rates()
    assert metrics.episodes == len(ended) > 200
    assert rates.success == pytest.approx(sum(e[0] == 1 for e in newest) / 100)
    assert rates.collision == pytest.approx(sum(e[0] == 2 for e in newest) / 100)
    assert rates.timeout == pytest.approx(sum(e[0] == 3 for e in newest) / 100)
    assert rates.total_return == pytest.approx(np.mean([e[1] for e in newest]))
    assert rates.training_return == pytest.approx(np.mean([e[2] for e in newest]))
    assert rates.episode_length == pytest.approx(np.mean([e[3] for e in newest]))


def test_a_row_holds_means_since_the_row_before() -> None:
    generator = np.random.Generator(np.random.Philox(2))
    metrics = TrainingMetrics(ROBOTS, reward_scale=0.5)
    metrics.add_step(random_step(generator))
    metrics.add_updates(updates(100.0), 5)
    metrics.row(Progress(3, 0, 5, 1.0), None)
    sims = [random_step(generator) for _ in range(2)]
    for sim in sims:
        metrics.add_step(sim)
    metrics.add_updates(updates(1.0, actor_updates=1, actor_loss=7.0), 1)
    metrics.add_updates(updates(4.0), 2)
    numbers = metrics.row(Progress(9, 2, 8, 3.0), scores())
    assert tuple(numbers) == COLUMNS
    velocities = np.concatenate([sim.velocities for sim in sims])
    expected = {
        "v": velocities[:, 0].mean(),
        "omega": np.abs(velocities[:, 1]).mean(),
        "critic_loss": 3.0,
        # In units of the unscaled reward
        "average_q": 12.0,
        "maximum_q": 24.0,
        "actor_loss": 7.0,
        "saturated_share": 0.07,
        "sps": 3.0,
        "ups": 1.5,
        "validation_success": 0.75,
        "validation_timeout": 0.25,
        "validation_return": 51.5,
    }
    assert {name: numbers[name] for name in expected} == pytest.approx(expected)


def test_what_has_no_value_is_none() -> None:
    numbers = TrainingMetrics(ROBOTS, reward_scale=1.0).row(Progress(0, 0, 0, 0.0), None)
    assert {name for name, number in numbers.items() if number is not None} == {
        "steps",
        "episodes",
        "updates",
        "train_s",
    }


def test_actor_figures_are_means_over_actor_steps() -> None:
    """8 updates with 3 actor steps, then 2 with 1: (3 x 10 + 1 x 50) / 4, not (8 x 10 + 2 x 50) / 10."""
    metrics = TrainingMetrics(ROBOTS, reward_scale=0.5)
    metrics.add_updates(updates(1.0, actor_updates=3, actor_loss=10.0), 8)
    metrics.add_updates(updates(1.0, actor_updates=1, actor_loss=50.0), 2)
    numbers = metrics.row(Progress(9, 2, 10, 3.0), None)
    assert (numbers["actor_loss"], numbers["saturated_share"]) == pytest.approx((20.0, 0.2))


def test_saved_metrics_go_on_to_the_same_rows() -> None:
    generator = np.random.Generator(np.random.Philox(3))
    steps = [random_step(generator) for _ in range(200)]
    one = TrainingMetrics(ROBOTS, reward_scale=0.3)
    for sim in steps[:90]:
        one.add_step(sim)
        one.add_updates(updates(float(sim.rewards[0]), actor_loss=float(sim.rewards[1])), 2)
    one.row(Progress(100, 3, 50, 1.5), None)
    for sim in steps[90:120]:
        one.add_step(sim)
        one.add_updates(updates(float(sim.rewards[0])), 3)
    other = TrainingMetrics(ROBOTS, reward_scale=0.3)
    other.restore(one.state())
    for metrics in (one, other):
        for sim in steps[120:]:
            metrics.add_step(sim)
    progress = Progress(999, 9, 99, 9.0)
    assert one.row(progress, None) == other.row(progress, None)
    assert one.rates() == other.rates()
    with pytest.raises(ValueError, match="running_returns have shape"):
        TrainingMetrics(ROBOTS + 1, reward_scale=0.3).restore(one.state())


# Files


def read_csv(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def read_events(folder: Path, tag: str) -> list[tuple[int, float]]:
    events = EventAccumulator(str(folder))
    events.Reload()
    return [(event.step, event.value) for event in events.Scalars(tag)]


def test_rows_read_back_to_the_same_numbers(tmp_path: Path) -> None:
    log = MetricsLog(tmp_path)
    log.add(row(100, success=1 / 3, critic_loss=None))
    log.close()
    (line,) = read_csv(tmp_path)
    assert tuple(line) == COLUMNS
    assert (line["steps"], float(line["success"]), line["critic_loss"]) == ("100", 1 / 3, "")
    assert set(CLOCKED) < set(COLUMNS)


def test_tensorboard_reads_the_values(tmp_path: Path) -> None:
    log = MetricsLog(tmp_path)
    log.add(row(100, success=0.5, critic_loss=2.0, validation_spl=0.75, sps=9.0, episodes=4))
    log.close()
    for tag, value in {
        "rollout/success": 0.5,
        "learner/critic_loss": 2.0,
        "validation/spl": 0.75,
        "speed/sps": 9.0,
        "progress/episodes": 4.0,
    }.items():
        assert read_events(tmp_path, tag) == [(100, value)]


def test_a_resumed_log_has_no_row_twice(tmp_path: Path) -> None:
    log = MetricsLog(tmp_path)
    log.add(row(100, success=0.5))
    size = log.sync()
    assert size == (tmp_path / "metrics.csv").stat().st_size
    log.add(row(200, success=0.2))
    log.add(row(300, success=0.3))
    log.close()
    log = MetricsLog(tmp_path, ResumePoint(size, 100))
    log.add(row(200, success=0.25))
    log.close()
    assert [(line["steps"], line["success"]) for line in read_csv(tmp_path)] == [("100", "0.5"), ("200", "0.25")]
    assert read_events(tmp_path, "rollout/success") == [(100, 0.5), (200, 0.25)]


def test_a_log_that_lost_rows_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"metrics\.csv: rows .* are missing"):
        MetricsLog(tmp_path, ResumePoint(10, 100))


# The display

RATES = Rates(0.5, 0.25, 0.25, 12.5, -3.0, 88.0)


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> io.StringIO:
    """What a monitor writes, on a terminal if the test asks for it."""
    text = io.StringIO()

    def console(*, stderr: bool, highlight: bool) -> Console:
        assert stderr
        assert not highlight
        return Console(file=text, force_terminal=getattr(request, "param", False), width=150, highlight=highlight)

    monkeypatch.setattr(display, "Console", console)
    return text


def test_plain_lines_say_how_far_how_fast_and_how_well(screen: io.StringIO) -> None:
    monitor = Monitor(1000, 0)
    monitor.show(Progress(0, 0, 0, 0.0), Rates(*[math.nan] * 6), 0.0)
    assert not monitor.due
    monitor.show(Progress(250, 7, 20, 2.0), RATES, 0.25)
    monitor.close()
    first, second = screen.getvalue().splitlines()
    assert first.split()[:6] == ["0", "%", "0", "of", "1,000", "steps"]
    assert re.match(r" 25 %  \d+:\d\d left  250 of 1,000 steps  125 steps/s  10 updates/s  7 episodes  ", second)
    assert "success 50.0 %  collision 25.0 %  time-out 25.0 %  return 12.5" in second
    assert "\x1b" not in screen.getvalue()


@pytest.mark.parametrize("screen", [True], indirect=True)
def test_a_terminal_shows_the_same_live(screen: io.StringIO) -> None:
    monitor = Monitor(0, 800)
    monitor.show(Progress(250, 7, 20, 2.0), RATES, 7 / 800)
    monitor.leave()
    monitor.close()
    assert "7 of 800 episodes" in screen.getvalue()
    # The cursor is hidden meanwhile and comes back.
    assert screen.getvalue().rfind("\x1b[?25h") > screen.getvalue().rfind("\x1b[?25l") >= 0


def test_validations_stand_under_one_header(screen: io.StringIO) -> None:
    monitor = Monitor(1000, 0)
    monitor.validation(25_088, scores(), best=True)
    monitor.validation(50_176, scores(1), best=False)
    header, first, second = screen.getvalue().splitlines()
    assert header.split() == ["validation", "at", "success", "collision", "time-out", "SPL", "return"]
    assert first.split() == ["25,088", "75.0", "%", "0.0", "%", "25.0", "%", "0.562", "51.5", "best"]
    assert second.split()[1] == "25.0"
    assert len(header) == len(second)


def test_a_saturated_actor_is_named_once_and_only_when_it_lasts(screen: io.StringIO) -> None:
    monitor = Monitor(1000, 0)
    for share in (0.99, 0.95, 0.5, None):
        for _ in range(SATURATED_ROWS - 1):
            monitor.check_saturation(share)
        monitor.check_saturation(0.2)
    assert screen.getvalue() == ""
    for _ in range(3 * SATURATED_ROWS):
        monitor.check_saturation(0.97)
    assert screen.getvalue().count("the actor saturates: 97 % of its outputs") == 1


def test_the_last_lines_name_the_result_the_policy_and_what_to_do_next() -> None:
    summary: dict[str, Any] = {"env_steps": 1000, "updates": 20, "train_s": 1.5, "wall_s": 3.0, "best_steps": 500}
    tested = {**summary, "scores": scores().to_json(), **scores().to_json()}
    lines = "\n".join(result_lines(tested, Path("runs/a")))
    assert "test, 4 unseen scenarios: success 75.0 % (95 % interval 30.1 to 95.4 %)" in lines
    assert "runs/a/policy" in lines
    assert "navrl play runs/a --out" in lines
    assert "navrl play 'my runs/a' --out" in "\n".join(result_lines(tested, Path("my runs/a")))
    assert "unseen" not in "\n".join(result_lines({**summary, "scores": None}, Path("runs/a")))
