"""Saved states: bit for bit, complete after a crash or a full disk at any moment, and every damage found and named."""

import errno
import json
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ParamSpec

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import load

from navrl import durable
from navrl.replay import Replay
from navrl.running import checkpoint
from navrl.running.checkpoint import CheckpointError, Checkpoints

P = ParamSpec("P")
WIDTH = 7
ARRAYS: dict[str, NDArray[Any]] = {
    "weights": np.array([[1.5, -0.0], [np.float32(1e-42), 3e38]], np.float32),
    "stream": np.array([2**64 - 1, 0, 12345678901234567890], np.uint64),
    "count": np.array(7, np.int64),
    "flags": np.array([True, False]),
    "bytes": np.frombuffer(b"\x00\xff simulator", np.uint8),
    "empty": np.zeros((0, 3)),
}
RECORD = {"config": {"training": {"seed": 3}}, "owed": 0.1 + 0.2, "tiny": 5e-324}


def rows(first: int, count: int) -> NDArray[np.float32]:
    """Rows that differ in every number: row i holds i * WIDTH + column."""
    return (np.arange(first * WIDTH, (first + count) * WIDTH, dtype=np.float32)).reshape(count, WIDTH)


def filled(added: int, capacity: int = 100) -> Replay:
    replay = Replay(capacity, WIDTH)
    add(replay, added)
    return replay


def add(replay: Replay, count: int) -> None:
    for i in range(replay.added, replay.added + count):
        replay.add(rows(i, 1))


def save(folder: Path, replay: Replay, keep: int = 2, **record: int) -> None:
    Checkpoints(folder).save({**RECORD, **record}, {**ARRAYS, **prefixed(replay)}, replay, keep=keep)


def prefixed(replay: Replay) -> dict[str, NDArray[Any]]:
    return {f"replay/{name}": array for name, array in replay.state().items()}


def restored(folder: Path, capacity: int = 100) -> Replay:
    saved = Checkpoints(folder).newest()
    replay = Replay(capacity, WIDTH)
    saved.restore_replay(replay)
    replay.restore({"added": saved.arrays["replay/added"]})
    return replay


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_everything_comes_back_to_the_same_bits(tmp_path: Path) -> None:
    save(tmp_path, filled(30))
    saved = Checkpoints(tmp_path).newest()
    for name, array in ARRAYS.items():
        assert saved.arrays[name].dtype == array.dtype
        assert saved.arrays[name].shape == array.shape
        assert saved.arrays[name].tobytes() == array.tobytes()
    assert {key: saved.record[key] for key in RECORD} == RECORD


@pytest.mark.parametrize("added", [0, 1, 99, 100, 101, 250])
def test_replay_comes_back_also_when_its_ring_has_turned(tmp_path: Path, added: int) -> None:
    replay = filled(added)
    save(tmp_path, replay)
    again = restored(tmp_path)
    assert (again.added, again.oldest) == (replay.added, replay.oldest)
    np.testing.assert_array_equal(again.rows, replay.rows)


def test_a_checkpoint_writes_only_the_rows_that_are_new(tmp_path: Path) -> None:
    replay = filled(40)
    save(tmp_path, replay)
    before = {path: path.stat().st_ino for path in (tmp_path / "rows").iterdir()}
    add(replay, 5)
    save(tmp_path, replay)
    after = {path: path.stat().st_ino for path in (tmp_path / "rows").iterdir()}
    assert before.items() <= after.items()
    (new,) = after.keys() - before.keys()
    assert load(new.read_bytes())["rows"].tobytes() == rows(40, 5).tobytes()


def test_nothing_new_writes_no_rows(tmp_path: Path) -> None:
    replay = filled(40)
    save(tmp_path, replay)
    before = set((tmp_path / "rows").iterdir())
    save(tmp_path, replay)
    assert set((tmp_path / "rows").iterdir()) == before


def test_files_of_rows_go_once_no_kept_checkpoint_needs_them(tmp_path: Path) -> None:
    replay = filled(0)
    for _ in range(12):
        add(replay, 30)
        save(tmp_path, replay)
        np.testing.assert_array_equal(restored(tmp_path).rows, replay.rows)
    firsts = sorted(int(path.name.split("-")[1]) for path in (tmp_path / "rows").iterdir())
    # Kept are the states after 330 and 360 rows: the older needs rows 230 to 330.
    assert firsts == [210, 240, 270, 300, 330]


def test_many_small_files_of_rows_are_joined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "MOST_SMALL_CHUNKS", 8)
    replay = filled(0)
    checkpoints = Checkpoints(tmp_path)
    for _ in range(60):
        add(replay, 3)
        checkpoints.save(RECORD, prefixed(replay), replay, keep=2)
        assert len(checkpoints.newest().chunks) <= 9
        np.testing.assert_array_equal(restored(tmp_path).rows, replay.rows)


def test_large_amounts_of_rows_are_split(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "CHUNK_ROWS", 16)
    replay = filled(70)
    save(tmp_path, replay)
    assert [chunk.rows for chunk in Checkpoints(tmp_path).newest().chunks] == [16, 16, 16, 16, 6]
    np.testing.assert_array_equal(restored(tmp_path).rows, replay.rows)


@pytest.mark.parametrize("keep", [1, 2, 3])
def test_the_newest_are_kept(tmp_path: Path, keep: int) -> None:
    replay = filled(0)
    for count in range(5):
        add(replay, 2)
        save(tmp_path, replay, keep=keep, count=count)
    assert Checkpoints(tmp_path).numbers() == list(range(5 - keep, 5))
    assert Checkpoints(tmp_path).newest().record["count"] == 4


def test_files_are_tensors_and_json_with_modes_of_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        save(tmp_path, filled(10))
    finally:
        os.umask(before)
    paths = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.suffix for path in paths} == {".json", ".safetensors"}
    assert {stat.S_IMODE(path.stat().st_mode) for path in paths} == {0o640}
    assert stat.S_IMODE((tmp_path / "00000000").stat().st_mode) == 0o750


# Damage


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """Two checkpoints, with rows of their own each and rows that they share."""
    replay = filled(20)
    save(tmp_path, replay, count=0)
    add(replay, 10)
    save(tmp_path, replay, count=1)
    return tmp_path


def flip(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 1 << (place % 8)
    path.write_bytes(content)


def truncate(path: Path, place: int) -> None:
    path.write_bytes(path.read_bytes()[:place])


def load_all(folder: Path) -> None:
    restored(folder)


NEWEST = ["00000001/manifest.json", "00000001/state.safetensors", "rows/rows-000000000020-000000000030.safetensors"]


@pytest.mark.parametrize("name", NEWEST)
@pytest.mark.parametrize("damage", [flip, truncate, lambda path, place: path.unlink()], ids=["flip", "cut", "gone"])
def test_damage_anywhere_is_named_and_the_checkpoint_before_is_offered(
    two: Path, name: str, damage: Callable[[Path, int], None]
) -> None:
    content = files(two)
    size = len(content[name])
    for place in {0, 7, size // 3, size // 2, size - 1}:
        damage(two / name, place)
        with pytest.raises(CheckpointError) as refusal:
            load_all(two)
        message = str(refusal.value)
        assert str(two / name) in message
        assert f"rm -r {two / '00000001'}" in message
        assert "\n" not in message
        (two / name).write_bytes(content[name])
    load_all(two)


def test_every_flipped_bit_of_a_manifest_is_found(two: Path) -> None:
    path = two / "00000001" / "manifest.json"
    content = path.read_bytes()
    for place in range(len(content)):
        flip(path, place)
        with pytest.raises(CheckpointError):
            Checkpoints(two).newest()
        path.write_bytes(content)


def test_what_the_offer_says_works(two: Path) -> None:
    flip(two / NEWEST[1], 100)
    shutil.rmtree(two / "00000001")
    assert Checkpoints(two).newest().record["count"] == 0
    assert restored(two).added == 20


def test_damage_to_shared_rows_leaves_no_offer(two: Path) -> None:
    flip(two / "rows" / "rows-000000000000-000000000020.safetensors", 300)
    with pytest.raises(CheckpointError, match=r"rows-0+-0+20\.safetensors: damaged.*no other checkpoint .* is intact"):
        load_all(two)


def test_no_files_of_rows_are_removed_while_a_manifest_is_unreadable(two: Path) -> None:
    flip(two / "00000000" / "manifest.json", 50)
    before = set((two / "rows").iterdir())
    Checkpoints(two)
    assert set((two / "rows").iterdir()) == before


def test_a_folder_without_checkpoints(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no checkpoint to resume from"):
        Checkpoints(tmp_path).newest()


def test_another_schema_is_refused_with_both_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "SCHEMA", 2)
        save(tmp_path, filled(1))
    with pytest.raises(CheckpointError, match=r"schema 2 of navrl .* reads schema 1"):
        Checkpoints(tmp_path)


def test_rows_of_another_width_are_refused_with_both_named(tmp_path: Path) -> None:
    save(tmp_path, filled(5))
    with pytest.raises(CheckpointError, match=f"rows of {WIDTH} columns, this run needs 9"):
        Checkpoints(tmp_path).newest().restore_replay(Replay(100, 9))


# Crashes and full disks


class CrashError(BaseException):
    """The process ends here: no handler of the product runs."""


CALLS = [(durable.os, "fsync"), (durable.os, "replace"), (checkpoint.os, "rename"), (checkpoint.shutil, "rmtree")]


def failing(
    monkeypatch: pytest.MonkeyPatch, moment: int, error: BaseException, calls: list[tuple[Any, str]]
) -> Iterator[int]:
    """Lets the call number `moment` of those that touch the disk fail; yields the calls so far."""
    count = 0

    def wrapped(original: Callable[P, None]) -> Callable[P, None]:
        def call(*args: P.args, **kwargs: P.kwargs) -> None:
            nonlocal count
            count += 1
            if count == moment:
                raise error
            original(*args, **kwargs)

        return call

    with monkeypatch.context() as patch:
        for module, name in calls:
            patch.setattr(module, name, wrapped(getattr(module, name)))
        yield count


def attempt(
    folder: Path, replay: Replay, monkeypatch: pytest.MonkeyPatch, moment: int, error: BaseException, keep: int
) -> bool:
    """Saves with a failure at `moment`; returns whether it came to that."""
    checkpoints = Checkpoints(folder)
    for _ in failing(monkeypatch, moment, error, CALLS):
        try:
            checkpoints.save({"count": 1}, prefixed(replay), replay, keep=keep)
        except (CrashError, CheckpointError):
            return True
    return False


def test_a_crash_at_any_moment_leaves_a_complete_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = set()
    for moment in range(1, 100):
        folder = tmp_path / str(moment)
        replay = filled(20)
        save(folder, replay, keep=1, count=0)
        add(replay, 10)
        crashed = attempt(folder, replay, monkeypatch, moment, CrashError(), keep=1)
        count = Checkpoints(folder).newest().record["count"]
        seen.add(count)
        assert restored(folder).added == (20, 30)[count]
        assert not [name for name in files(folder) if ".new-" in name or ".old-" in name]
        # The next save works, and leaves nothing behind.
        save(folder, replay, keep=1, count=2)
        assert restored(folder).added == 30
        assert sum(name.endswith("manifest.json") for name in files(folder)) == 1
        if not crashed:
            break
    assert seen == {0, 1}
    assert moment > 10


def test_a_full_disk_at_any_moment_keeps_the_checkpoint_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for moment in range(1, 100):
        folder = tmp_path / str(moment)
        replay = filled(20)
        save(folder, replay, keep=2, count=0)
        before = files(folder)
        add(replay, 10)
        full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        failed = attempt(folder, replay, monkeypatch, moment, full, keep=2)
        if not failed:
            break
        left = files(folder)
        assert before.items() <= left.items()
        assert restored(folder).added == Checkpoints(folder).newest().arrays["replay/added"]
    assert moment > 8


def test_a_full_disk_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path, filled(20))
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    checkpoints = Checkpoints(tmp_path)
    for _ in failing(monkeypatch, 1, full, CALLS[:1]):
        with pytest.raises(CheckpointError, match=r"No space left on device; .*is complete") as refusal:
            checkpoints.save(RECORD, ARRAYS, filled(30), keep=2)
    assert "\n" not in str(refusal.value)


def test_leftovers_are_removed_and_manifests_are_plain_json(two: Path) -> None:
    (two / ".new-00000002").mkdir()
    (two / ".new-00000002" / "state.safetensors").write_bytes(b"half")
    (two / ".old-00000000").mkdir()
    (two / "rows" / ".new-rows-1-2.safetensors").write_bytes(b"half")
    (two / "rows" / "rows-000000000030-000000000031.safetensors").write_bytes(b"of no checkpoint")
    Checkpoints(two)
    assert sorted(path.name for path in two.iterdir()) == ["00000000", "00000001", "rows"]
    assert len(list((two / "rows").iterdir())) == 2
    assert json.loads((two / "00000001" / "manifest.json").read_text())["count"] == 1
