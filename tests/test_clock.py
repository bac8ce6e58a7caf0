"""The seconds of a run: over several processes, and with the time that a process takes to start."""

import time

import pytest

from navrl.running import clock as clock_module
from navrl.running.clock import RunClock

BEFORE = {"train_s": 50.0, "trained_s": 49.0, "update_s": 20.0, "eval_s": 5.0, "wall_s": 100.0}


class Hours:
    """A monotonic clock that the test moves (seconds)."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)


@pytest.fixture
def hours(monkeypatch: pytest.MonkeyPatch) -> Hours:
    """The clock of a process that is 3 s old and has had no run."""
    monkeypatch.setattr(clock_module, "_claimed", False)
    monkeypatch.setattr(clock_module, "_process_age", lambda: 3.0)
    return Hours(monkeypatch)


def test_evaluation_is_no_training(hours: Hours) -> None:
    clock = RunClock()
    hours.now += 1.0
    clock.start()
    with clock.updating():
        hours.now += 4.0
    with clock.evaluating():
        hours.now += 10.0
    assert (clock.train_s, clock.trained_s, clock.update_s, clock.eval_s, clock.wall_s) == (4.0, 4.0, 4.0, 10.0, 18.0)


def test_a_resumed_run_keeps_the_time_that_its_process_took_to_start(hours: Hours) -> None:
    clock = RunClock()
    hours.now += 2.0
    clock.resume(BEFORE)
    # 100 s before, 3 s until the clock was made, 2 s until it was resumed
    assert clock.wall_s == 105.0
    assert clock.state() == BEFORE | {"wall_s": 105.0}
    clock.start()
    with clock.evaluating():
        hours.now += 7.0
    hours.now += 1.0
    assert (clock.train_s, clock.eval_s, clock.wall_s) == (51.0, 12.0, 113.0)


def test_a_second_run_of_a_process_counts_from_its_own_beginning(hours: Hours) -> None:
    RunClock()
    hours.now += 60.0
    assert RunClock().wall_s == 0.0
