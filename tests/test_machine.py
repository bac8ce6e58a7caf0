"""Cores and memory that a run may take: within the limits of a container, and as many threads as the core allows."""

import os
import subprocess
from pathlib import Path

import pytest

from navrl import machine
from navrl.batch import BatchSim
from navrl.config import THREADS_MAX

MB = 10**6


def container(folder: Path, *, limit: str, used: int, **stat: int) -> None:
    """The files that tell the limits of a container."""
    (folder / "memory.max").write_text(f"{limit}\n")
    (folder / "memory.current").write_text(f"{used}\n")
    (folder / "memory.stat").write_text("".join(f"{name} {amount}\n" for name, amount in stat.items()))


@pytest.mark.parametrize(
    ("used", "stat", "available"),
    [
        (30 * MB, {"anon": 30 * MB}, 70 * MB),
        # Cached files are given back: 90 - 40 - 20 - 10 of 100 MB are in the way.
        (
            90 * MB,
            {
                "anon": 15 * MB,
                "file": 65 * MB,
                "inactive_file": 40 * MB,
                "active_file": 20 * MB,
                "slab": 12 * MB,
                "slab_reclaimable": 10 * MB,
                "slab_unreclaimable": 2 * MB,
            },
            80 * MB,
        ),
        # The files are read one after the other, and the kernel counts on meanwhile.
        (10 * MB, {"inactive_file": 11 * MB}, 100 * MB),
    ],
)
def test_memory_of_a_container_counts_its_cached_files_as_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, used: int, stat: dict[str, int], available: int
) -> None:
    container(tmp_path, limit=str(100 * MB), used=used, **stat)
    monkeypatch.setattr(machine, "CGROUP", tmp_path)
    assert machine.available_memory() == available


def test_without_a_limit_the_machine_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "CGROUP", tmp_path)
    whole = machine.available_memory()
    assert whole is not None
    assert whole > 100 * MB
    container(tmp_path, limit="max", used=30 * MB)
    unlimited = machine.available_memory()
    assert unlimited == pytest.approx(whole, rel=0.3)


def test_cores_are_at_most_the_threads_of_a_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(384)), raising=False)
    assert machine.cores() == THREADS_MAX
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5}, raising=False)
    assert machine.cores() == 2


def test_the_core_has_the_same_limit() -> None:
    with pytest.raises(ValueError, match=rf"num_threads = {THREADS_MAX + 1}: expected .*\b{THREADS_MAX}\b"):
        BatchSim(num_envs=1, num_threads=THREADS_MAX + 1)


def test_the_commit_of_a_source_tree_and_of_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("NAME", "somebody"), ("EMAIL", "somebody@example.org")):
        monkeypatch.setenv(f"GIT_AUTHOR_{name}", value)
        monkeypatch.setenv(f"GIT_COMMITTER_{name}", value)

    def git(*words: str) -> str:
        return subprocess.run(["git", "-C", tmp_path, *words], capture_output=True, text=True, check=True).stdout

    assert machine.commit(tmp_path) is None
    git("init")
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "machine.py").write_text("installed here, and nothing that this repository keeps")
    git("add", "notes.txt")
    git("commit", "-m", "first")
    assert machine.commit(tmp_path) is None
    git("add", "machine.py")
    git("commit", "-m", "second")
    head = git("rev-parse", "HEAD")[:12]
    assert machine.commit(tmp_path) == head
    (tmp_path / "machine.py").write_text("changed")
    assert machine.commit(tmp_path) == head + "+"


def test_what_made_a_result() -> None:
    made = machine.made_with()
    assert list(made) == ["navrl", "commit", "numpy", "cpu", "isa"]
    assert made["cpu"] == machine.cpu_model() != ""
    assert made["isa"]
