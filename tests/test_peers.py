"""benches/peers.py: what it compares is the same job, what differs is noticed, what is missing is left out."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from navrl import Scenario

sys.path.insert(0, str(Path(__file__).parent.parent / "benches"))

import peer_simulators
import peers


def room_with_a_box() -> Scenario:
    """A box of 2 x 1 m at (1, 0), turned by 90 degrees, and a wall at y = -3."""
    return Scenario(
        start=(0.0, -1.0, 0.0),
        goal=(3.0, 0.0),
        goal_radius=0.3,
        time_limit=50.0,
        boxes=[(1.0, 0.0, np.pi / 2, 2.0, 1.0)],
        segments=[(-4.0, -3.0, 4.0, -3.0)],
    )


def test_clearance_is_the_distance_to_the_nearest_obstacle() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.9], [1.0, 1.5], [4.5, 4.0], [-2.0, -2.8], [8.0, -6.0]])
    expected = [0.5, 0.0, 0.5, np.hypot(3.0, 3.0), 0.2, 5.0]
    np.testing.assert_allclose(peer_simulators.clearance(room_with_a_box(), points), expected, atol=1e-12)


def test_poses_are_free_or_touching_as_navrl_sees_it() -> None:
    for room in peer_simulators.draw_rooms():
        assert room.free.shape == room.touching.shape == (peer_simulators.POSES, 3)
        assert peer_simulators.navrl_ranges(room).shape == (peer_simulators.POSES, 180)
        for pose in room.touching:
            with pytest.raises(ValueError, match="in contact"):
                peer_simulators.navrl_ranges(room._replace(free=pose[None]))


class Echo:
    """A peer that reports what navrl does, but for `error` metres on one beam and `missed` contacts."""

    def __init__(self, rooms: list[peer_simulators.Room], *, error: float = 0.0, missed: int = 0) -> None:
        self.rooms, self.error, self.missed = rooms, error, missed

    def scans(self, room: int, poses: np.ndarray) -> peer_simulators.Scans:
        free = poses is self.rooms[room].free
        ranges = peer_simulators.navrl_ranges(self.rooms[room])
        ranges[0, 0] += self.error
        contacts = np.full(len(poses), not free)
        contacts[: self.missed] ^= not free
        return peer_simulators.Scans(ranges, contacts)

    def rewind(self) -> None:
        """Nothing."""

    def drive(self) -> int:
        return 1


@pytest.mark.parametrize(
    ("error", "missed", "holds"), [(0.0, 0, True), (9e-4, 0, True), (1.1e-3, 0, False), (0.0, 1, False)]
)
def test_a_peer_that_differs_is_noticed(error: float, missed: int, holds: bool) -> None:
    rooms = peer_simulators.draw_rooms()[:2]
    agreement = peers.compare(Echo(rooms, error=error, missed=missed), rooms)
    assert agreement.holds() == holds
    assert agreement.wrong_contacts == 2 * missed
    assert agreement.worst_m == pytest.approx(error, abs=1e-9)


def test_missing_peers_are_named_and_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(peers, "installed", lambda module: False)
    monkeypatch.setattr(peers, "pin", lambda core: None)
    file = tmp_path / "peers.json"
    monkeypatch.setattr(sys, "argv", ["peers.py", "--seconds", "0.01", "--slices", "2", "--json", str(file)])
    assert peers.main() == 0
    captured = capsys.readouterr()
    assert captured.err.splitlines() == [
        f"{package} is missing, its row is left out; to measure it: pip install {package}"
        for package in ("ir-sim", "mujoco")
    ]
    record = json.loads(file.read_text(encoding="utf-8"))
    assert set(record["steps_per_second"]) == {"navrl, 256 robots", "navrl, 1 robot"}
    assert record["ratio"] == {}
    assert all(speed["min"] > 0 for speed in record["steps_per_second"].values())


def test_a_peer_that_differs_is_not_timed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(peers, "peers", lambda rooms: {"near": Echo(rooms), "far": Echo(rooms, error=1.0)})
    monkeypatch.setattr(peers, "pin", lambda core: None)
    monkeypatch.setattr(sys, "argv", ["peers.py", "--seconds", "0.01", "--slices", "2"])
    assert peers.main() == 1
    captured = capsys.readouterr()
    assert captured.err == "far does not do the same job: it is not timed\n"
    assert "navrl, 256 robots / near" in captured.out
    assert "/ far" not in captured.out
