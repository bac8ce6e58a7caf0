"""Lists of scenarios: the built-in ones, drawn by the core, and those of a file; each with its shortest paths.

    load_list(sim, "test", num_threads=2) -> ScenarioList
    read_list("course.jsonl", sim, skip_invalid=True) -> ScenarioList
    given_list([Scenario(...), ...], sim) -> ScenarioList

Lists have a purpose (tuning, validation, test, final) and do not depend on any training seed. The lengths of the
shortest paths, which SPL needs, ship with navrl for the built-in lists; others are computed once and kept in the user's
cache.

    python -m navrl.scenarios FOLDER        writes the lengths that ship
"""

from __future__ import annotations

import hashlib
import io
import math
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navrl import _navsim, length_cache
from navrl.batch import Scenario, config_json, draw_list
from navrl.config import SimConfig, WorldConfig
from navrl.durable import write_file
from navrl.errors import UserError, shown
from navrl.machine import cores

if TYPE_CHECKING:
    from navrl.batch import Split

LIST_SIZES: dict[Split, int] = {"tuning": 500, "validation": 1000, "test": 1000, "final": 4000}
"""Scenarios of each built-in list, by its purpose."""
SHORTEST_MIN = 0.1
"""Scenarios with a shorter way to their goal circle (m) are refused: SPL would mean nothing."""
SHIPPED_WORLDS = (
    WorldConfig(name="td3"),
    *(WorldConfig(name="boxes", boxes=boxes) for boxes in (4, 8, 12, 16)),
    *(WorldConfig(name=name) for name in ("open8", "walls", "mixed")),
)
"""Worlds whose lengths ship, for the default robot."""
METHOD = "taut string 1"
"""Names how lengths are computed: another name leaves older cached lengths unused."""
LENGTHS_FOLDER = Path(__file__).parent / "lengths"


class ScenarioError(UserError, ValueError):
    """A scenario list that cannot be used; the text names the file and line, or the list."""


@dataclass(frozen=True)
class ScenarioList:
    """Scenarios that every contender meets, each exactly once, in this order."""

    name: str
    """Purpose of a built-in list, or path of the file."""
    scenarios: tuple[Scenario, ...]
    """Start, goal and obstacles of each."""
    shortest: NDArray[np.float64]
    """(scenarios,) length of the shortest path of the robot's centre to the goal circle, metres."""
    sha256: str
    """Hash of the scenarios as JSON Lines."""
    lines: tuple[int, ...] | None = None
    """Line of the file, from 1, that each stands in; None where they come from no file."""

    def __len__(self) -> int:
        """Number of scenarios."""
        return len(self.scenarios)

    def first(self, count: int) -> ScenarioList:
        """The beginning of the list.

        Args:
            count: Scenarios to keep, 1 to the list's length.

        Returns:
            A list of the same name.

        Raises:
            ScenarioError: The list is shorter.
        """
        if not 1 <= count <= len(self):
            raise ScenarioError(f"{count} scenarios of {self.name}: it has 1 to {len(self)}")
        kept, lines = self.scenarios[:count], self.lines and self.lines[:count]
        return ScenarioList(self.name, kept, self.shortest[:count], hash_scenarios(kept), lines)


def robot_radius(sim: SimConfig) -> float:
    """Radius (m) of the disc whose shortest path counts: the footprint's, or a rectangle's circumscribed circle's."""
    robot = sim.robot
    return robot.radius if robot.footprint == "disc" else 0.5 * math.hypot(robot.length, robot.width)


def hash_scenarios(scenarios: Sequence[Scenario]) -> str:
    """SHA-256 of scenarios as JSON Lines, in hexadecimal digits."""
    return hashlib.sha256("".join(scenario.to_json() + "\n" for scenario in scenarios).encode()).hexdigest()


def load_list(
    sim: SimConfig, name: Split, *, count: int | None = None, num_threads: int = 1, lengths: bool = True
) -> ScenarioList:
    """A built-in list in the world of a configuration.

    Args:
        sim: World, robot and task; goals are drawn over the full range.
        name: Purpose of the list: tuning, validation, test or final.
        count: Only so many from its beginning.
        num_threads: Threads for shortest paths that have to be computed.
        lengths: False leaves the shortest paths NaN, for who only drives.

    Returns:
        The list with its shortest paths.

    Raises:
        ScenarioError: There is no such list, or the world cannot hold the robot.
    """
    if name not in LIST_SIZES:
        raise ScenarioError(f"list {name}: expected {', '.join(LIST_SIZES)}")
    try:
        drawn = draw_list(sim, name, LIST_SIZES[name])
    except ValueError as error:
        raise ScenarioError(f"list {name}: {error}") from None
    sha256 = hash_scenarios(drawn)
    if count is not None and not 1 <= count <= len(drawn):
        raise ScenarioError(f"{count} scenarios of the list {name}: it has 1 to {len(drawn)}")
    kept = tuple(drawn[:count])
    shortest = _shipped_lengths(sim, name, sha256) if lengths else np.full(len(kept), math.nan)
    if shortest is None:
        shortest = shortest_lengths(kept, robot_radius(sim), num_threads=num_threads)
    return ScenarioList(name, kept, shortest[: len(kept)], hash_scenarios(kept))


def read_list(file: str | Path, sim: SimConfig, *, skip_invalid: bool = False, num_threads: int = 1) -> ScenarioList:
    """A list from a file of JSON Lines.

    Args:
        file: One scenario a line; empty lines are passed over.
        sim: The robot that has to run them.
        skip_invalid: Leave out scenarios that it cannot run, and say so on stderr.
        num_threads: Threads for shortest paths that have to be computed.

    Returns:
        The list with its shortest paths, those given in the file as they stand there.

    Raises:
        ScenarioError: The file cannot be read, or a line is wrong, or its start is in contact, its goal unreachable or
            less than 0.1 m away.
    """
    try:
        text = Path(file).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ScenarioError(f"{file}: cannot be read: {reason}") from None
    examined = _examine(text, sim, num_threads)
    if examined.refused and not skip_invalid:
        (line, reason), *others = examined.refused
        more, them = (f"{_and_more(others, 'line')}; ", "them") if others else ("", "it")
        raise ScenarioError(f"{file}, line {line}: {reason} ({more}--skip-invalid leaves {them} out)")
    for line, reason in examined.refused:
        print(f"{file}, line {line}: left out: {reason}", file=sys.stderr)
    kept = examined.scenarios
    if not kept:
        raise ScenarioError(f"{file}: no scenario that the robot can run")
    return ScenarioList(str(file), kept, examined.lengths, hash_scenarios(kept), examined.lines)


def given_list(scenarios: Sequence[Scenario], sim: SimConfig, *, num_threads: int = 1) -> ScenarioList:
    """A list of scenarios that were made or read elsewhere.

    Args:
        scenarios: Start, goal and obstacles of each.
        sim: The robot that has to run them.
        num_threads: Threads for shortest paths that have to be computed.

    Returns:
        The list with its shortest paths.

    Raises:
        ScenarioError: There is none, or a start is in contact, a goal unreachable or less than 0.1 m away.
    """
    kept = tuple(scenarios)
    if not kept:
        raise ScenarioError("scenarios: expected at least one")
    for index, scenario in enumerate(kept):
        if not isinstance(scenario, Scenario):
            raise ScenarioError(f"scenario {index}: expected a Scenario, got {shown(scenario)}")
    examined = _examine("".join(scenario.to_json() + "\n" for scenario in kept), sim, num_threads)
    if examined.refused:
        (line, reason), *others = examined.refused
        more = f" ({_and_more(others, 'scenario')})" if others else ""
        raise ScenarioError(f"scenario {line - 1}: {reason}{more}")
    return ScenarioList("given", kept, examined.lengths, hash_scenarios(kept))


class _Examined(NamedTuple):
    """Scenarios of a text that the robot can run, and what is wrong with the other lines."""

    lines: tuple[int, ...]
    """Line of each scenario, from 1."""
    scenarios: tuple[Scenario, ...]
    lengths: NDArray[np.float64]
    """(scenarios,) lengths of their shortest paths, metres."""
    refused: list[tuple[int, str]]
    """Line and reason, in the order of the lines."""


def _examine(text: str, sim: SimConfig, num_threads: int) -> _Examined:
    good, refused = _navsim.read_list(text, config_json(sim))
    lengths = shortest_lengths([scenario for _, scenario in good], robot_radius(sim), num_threads=num_threads)
    usable = np.isfinite(lengths) & (lengths >= SHORTEST_MIN)
    kept = [good[i] for i in np.flatnonzero(usable)]
    refused += [(good[i][0], _fault(float(lengths[i]))) for i in np.flatnonzero(~usable)]
    lines, scenarios = tuple(line for line, _ in kept), tuple(scenario for _, scenario in kept)
    return _Examined(lines, scenarios, lengths[usable], sorted(refused))


def _and_more(others: Sequence[object], noun: str) -> str:
    return f"and {len(others)} more {noun}{'s' if len(others) > 1 else ''}"


def _fault(length: float) -> str:
    if math.isfinite(length):
        return f"the way to the goal circle is {length:.3g} m long, at least {SHORTEST_MIN} m are needed"
    return "the goal cannot be reached"


def shortest_lengths(scenarios: Sequence[Scenario], radius: float, *, num_threads: int = 1) -> NDArray[np.float64]:
    """Shortest paths of a disc; those not given are looked up in the user's cache or computed.

    Args:
        scenarios: Start, goal and obstacles of each.
        radius: Radius of the disc, metres.
        num_threads: Threads that compute.

    Returns:
        (scenarios,) lengths to the goal circle, metres; infinity where the goal cannot be reached.
    """
    lengths = {i: s.shortest for i, s in enumerate(scenarios) if s.shortest is not None}
    keys = {i: _cache_key(s, radius) for i, s in enumerate(scenarios) if i not in lengths}
    known = length_cache.read(keys.values())
    missing = [i for i, key in keys.items() if key not in known]
    measured = measure_lengths([scenarios[i] for i in missing], radius, num_threads=num_threads)
    computed = {keys[i]: length for i, length in zip(missing, measured.tolist(), strict=True)}
    length_cache.write(computed)
    known |= computed
    return np.array([lengths[i] if i in lengths else known[keys[i]] for i in range(len(scenarios))], np.float64)


def measure_lengths(scenarios: Sequence[Scenario], radius: float, *, num_threads: int) -> NDArray[np.float64]:
    """Shortest paths of a disc, computed.

    Args:
        scenarios: Start, goal and obstacles of each.
        radius: Radius of the disc, metres.
        num_threads: Threads that compute.

    Returns:
        (scenarios,) lengths to the goal circle, metres; infinity where the goal cannot be reached.
    """

    def measure(scenario: Scenario) -> float:
        length = _navsim.shortest_path(scenario, radius)
        return math.inf if length is None else length

    with ThreadPoolExecutor(num_threads) as pool:
        return np.fromiter(pool.map(measure, scenarios), np.float64, len(scenarios))


def _cache_key(scenario: Scenario, radius: float) -> str:
    return hashlib.sha256(f"{METHOD} {radius!r} {scenario.to_json()}".encode()).hexdigest()


def _shipped_file(folder: Path, sim: SimConfig, name: str, sha256: str) -> Path:
    world = sim.world.name + (str(sim.world.boxes) if sim.world.name == "boxes" else "")
    return folder / f"{world}-{name}-r{robot_radius(sim):g}-{sha256[:16]}.npy"


def _shipped_lengths(sim: SimConfig, name: str, sha256: str) -> NDArray[np.float64] | None:
    """Lengths that ship for exactly these scenarios: the hash is part of the file's name."""
    if Path(sim.world.name).suffix:
        return None
    file = _shipped_file(LENGTHS_FOLDER, sim, name, sha256)
    return np.load(file, allow_pickle=False).astype(np.float64) if file.is_file() else None


def write_shipped_lengths(folder: Path, *, num_threads: int) -> None:
    """Computes the lengths of the built-in lists and writes one file a list.

    Args:
        folder: Where to, made if missing; files of lists that are no more are removed.
        num_threads: Threads that compute.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = set()
    for world in SHIPPED_WORLDS:
        sim = SimConfig(world=world)
        for name, size in LIST_SIZES.items():
            drawn = draw_list(sim, name, size)
            lengths = measure_lengths(drawn, robot_radius(sim), num_threads=num_threads)
            file = _shipped_file(folder, sim, name, hash_scenarios(drawn))
            content = io.BytesIO()
            np.save(content, lengths.astype(np.float32), allow_pickle=False)
            write_file(file, content.getvalue())
            written.add(file)
            print(file)
    for file in set(folder.glob("*.npy")) - written:
        file.unlink()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m navrl.scenarios FOLDER")
    write_shipped_lengths(Path(sys.argv[1]), num_threads=cores())
