"""Work in two threads or in one: what is done, and when one has to do."""

import threading
import time

import pytest

from navrl.running import beside
from navrl.running.beside import Beside


def _busy(seconds: float) -> None:
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def test_both_are_done_and_errors_of_both_arrive_after_the_other_has_ended() -> None:
    done: list[str] = []

    def fails() -> None:
        raise ArithmeticError("own")

    def late() -> None:
        time.sleep(0.02)
        done.append("aside")

    free: list[bool] = []
    with Beside(pytest.fail, free.append) as pair:
        assert pair.do(threading.current_thread, lambda: done.append("own")) is not threading.main_thread()
        with pytest.raises(ArithmeticError, match="own"):
            pair.do(late, fails)
        assert done == ["own", "aside"]
        with pytest.raises(ZeroDivisionError):
            pair.do(lambda: 1 / 0, lambda: done.append("own"))
        assert done == ["own", "aside", "own"]
    # The other thread tells that it has ended, also when its work failed.
    assert free == 3 * [False, True]


def test_one_thread_does_while_waits_are_longer_than_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that sleeps is like one that gets no processor: its time passes, its work does not."""
    monkeypatch.setattr(beside, "WINDOW", 5)
    monkeypatch.setattr(beside, "PAUSE", 3)
    said: list[str] = []
    threads: list[bool] = []

    ended = threading.Event()

    def aside(sleep: float) -> None:
        time.sleep(sleep)
        _busy(0.002)
        threads.append(threading.current_thread() is threading.main_thread())
        ended.set()

    def own_is_longer() -> None:
        ended.wait()
        ended.clear()

    with Beside(said.append, lambda free: None) as pair:
        for _ in range(5):
            pair.do(lambda: aside(0.0), own_is_longer)
        assert said == []
        for _ in range(5):
            pair.do(lambda: aside(0.02), lambda: None)
        assert len(said) == 1
        for _ in range(4):
            pair.do(lambda: aside(0.0), lambda: None)
    assert threads == 10 * [False] + 3 * [True] + [False]
