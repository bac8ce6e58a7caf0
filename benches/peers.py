"""Times navrl's simulator beside IR-SIM's and MuJoCo's at the same job, in one run on one core.

    pip install ir-sim "mujoco>=3.4"
    python benches/peers.py [--seconds S] [--slices K] [--core C] [--json FILE]

The job is a control step of 0.1 s of a differential-drive disc of 0.25 m in rooms of "open8" (8 oriented boxes, 8
walls), with 180 beams over 180 degrees to 10 m, without noise. First the script compares the peers' ranges and contacts
with navrl's in the same rooms, in poses all over them; what differs is not timed. Then slices of all alternate, so that
whatever else the machine does meets everyone; ratios are taken slice by slice. Seconds are processor time, which other
programs disturb less; on an idle machine they are those of the clock.

What each does in a step:

* navrl: motion along the exact arc, swept collision, 180 ranges, 20 bins, goal, reward, and when an episode ends the
  reset: a new room with new boxes, start and goal. One call from Python is one step of all robots.
* MuJoCo: one integrator step of 0.1 s of three joints with velocity actuators, 180 rangefinders, and contacts with a
  sensor that reports them (not in the row "ranges only"). One call of `mujoco.rollout` is 10 steps of 256 robots.
* IR-SIM: its own motion, collision check and lidar2d. One call is one step of one robot.

The peers get no goal, no reward and no resets: after every 10 steps their robots are put back, off the clock, and their
rooms stay the same.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from peer_simulators import Contender, IrSim, MuJoCo, Navrl, Peer, Room, draw_rooms, navrl_ranges

from navrl import _navsim
from navrl.machine import cpu_model

SCHEMA = 1
"""Version of the JSON file."""
RANGE_TOLERANCE_M = 1e-3
"""Largest difference of a range that counts as the same room."""
PACKAGES = {"irsim": "ir-sim", "mujoco": "mujoco"}
"""Modules of the peers, and what pip calls them."""
OWN = ("navrl, 256 robots", "navrl, 1 robot")
"""Rows of this package."""
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}


class Agreement(NamedTuple):
    """How far a peer's reports are from navrl's."""

    poses: int
    """Poses with contact; as many without."""
    beams: int
    """Ranges that were compared."""
    worst_m: float
    """Largest difference of a range (m)."""
    wrong_contacts: int | None
    """Poses whose contact it reports wrongly; None if it does not look for contacts."""

    def holds(self) -> bool:
        """Whether both do the same job."""
        return self.worst_m <= RANGE_TOLERANCE_M and not self.wrong_contacts

    def __str__(self) -> str:
        """One line."""
        ranges = f"{self.beams:,} ranges differ by at most {self.worst_m:.1e} m (allowed: {RANGE_TOLERANCE_M:g} m)"
        if self.wrong_contacts is None:
            return f"{ranges}, contacts not computed"
        return f"{ranges}, {self.wrong_contacts} of {2 * self.poses} contacts are wrong"


def compare(peer: Peer, rooms: Sequence[Room]) -> Agreement:
    """Puts a peer's robot at all poses of all rooms."""
    worst, beams, poses, wrong = 0.0, 0, 0, 0
    looks_for_contacts = True
    for index, room in enumerate(rooms):
        expected = navrl_ranges(room)
        free, touching = peer.scans(index, room.free), peer.scans(index, room.touching)
        worst = max(worst, float(np.abs(free.ranges - expected).max()))
        beams, poses = beams + expected.size, poses + len(room.touching)
        if free.contacts is None or touching.contacts is None:
            looks_for_contacts = False
        else:
            wrong += int(free.contacts.sum() + (~touching.contacts).sum())
    return Agreement(poses, beams, worst, wrong if looks_for_contacts else None)


def peers(rooms: Sequence[Room]) -> dict[str, Peer]:
    """Those that are installed, by name; the others are named on stderr."""
    for package in (PACKAGES[module] for module in PACKAGES if not installed(module)):
        print(f"{package} is missing, its row is left out; to measure it: pip install {package}", file=sys.stderr)
    found: dict[str, Peer] = {}
    if installed("mujoco"):
        found["MuJoCo"] = MuJoCo(rooms, contacts=True)
        found["MuJoCo, ranges only"] = MuJoCo(rooms, contacts=False)
    if installed("irsim"):
        found["IR-SIM"] = IrSim(rooms)
    return found


def installed(module: str) -> bool:
    """Whether a peer can be imported."""
    return importlib.util.find_spec(module) is not None


def rate(contender: Contender, seconds: float) -> float:
    """Steps per second over about `seconds`, counted over all robots; putting robots back is not timed."""
    steps, spent = 0, 0.0
    while spent < seconds:
        contender.rewind()
        start = time.process_time()
        steps += contender.drive()
        spent += time.process_time() - start
    return steps / spent


def spread(numbers: np.ndarray) -> dict[str, float]:
    """Smallest, median and largest."""
    return {"min": float(numbers.min()), "median": float(np.median(numbers)), "max": float(numbers.max())}


def machine() -> dict[str, str | float]:
    """What the figures depend on."""
    folder = Path(__file__).parent
    try:
        git = ["git", "-C", str(folder), "describe", "--always", "--dirty"]
        commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        commit = ""
    packages = ["navrl", "numpy", *(PACKAGES[module] for module in PACKAGES if installed(module))]
    return {
        "cpu": cpu_model(),
        "isa": _navsim.isa(),
        "load average": round(os.getloadavg()[0], 1),
        "checkout": commit or "unknown",
        "python": platform.python_version(),
        **{package: importlib.metadata.version(package) for package in packages},
    }


def pin(core: int | None) -> None:
    """Confines this process to one core and its libraries to one thread, which they ask for when they are loaded."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0)) if core is None else core})
    else:
        print("this system cannot pin a process to a core: the figures vary more", file=sys.stderr)
    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**os.environ, **ONE_THREAD})


def measure(contenders: dict[str, Contender], *, slices: int, seconds: float) -> dict[str, np.ndarray]:
    """Steps per second of each, slice by slice, after a warm-up; the contenders alternate."""
    for contender in contenders.values():
        rate(contender, seconds / 5)
    rates = [[rate(contender, seconds) for contender in contenders.values()] for _ in range(slices)]
    return dict(zip(contenders, np.array(rates).T, strict=True))


def print_table(title: str, rows: dict[str, dict[str, float]]) -> None:
    """Min / median / max of each row."""
    if rows:
        print(f"\n{title:42s}" + "".join(f"{word:>12s}" for word in ("min", "median", "max")))
    for name, numbers in rows.items():
        print(f"{name:42s}" + "".join(f"{number:>12,.0f}" for number in numbers.values()))


def main() -> int:
    """Compares, times and prints the tables; 1 if a peer does not do the same job."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a slice")
    parser.add_argument("--slices", type=int, default=11, help="slices of each contender")
    parser.add_argument("--core", type=int, help="core to run on; the last one by default")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where to write all figures")
    options = parser.parse_args()
    if options.seconds <= 0 or options.slices < 1:
        parser.error("--seconds must be above 0 and --slices at least 1")
    try:
        pin(options.core)
    except OSError as error:
        parser.error(f"--core {options.core}: {error.strerror}")

    setting = machine()
    print(", ".join(f"{key} {value}" for key, value in setting.items()), flush=True)
    rooms = draw_rooms()
    agreements = {name: (peer, compare(peer, rooms)) for name, peer in peers(rooms).items()}
    contenders: dict[str, Contender] = {OWN[0]: Navrl(256), OWN[1]: Navrl(1)}
    for name, (peer, agreement) in agreements.items():
        print(f"{name}: {agreement}", flush=True)
        if agreement.holds():
            contenders[name] = peer
        else:
            print(f"{name} does not do the same job: it is not timed", file=sys.stderr)
    rates = measure(contenders, slices=options.slices, seconds=options.seconds)
    speeds = {name: spread(column) for name, column in rates.items()}
    ratios = {f"{own} / {name}": spread(rates[own] / rates[name]) for name in rates if name not in OWN for own in OWN}
    print_table("steps per second", speeds)
    print_table("ratio", ratios)
    if options.json is not None:
        record = {
            "schema": SCHEMA,
            "machine": setting,
            "slices": options.slices,
            "seconds": options.seconds,
            "agreement": {name: agreement._asdict() for name, (_, agreement) in agreements.items()},
            "steps_per_second": speeds,
            "ratio": ratios,
        }
        options.json.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return 0 if all(agreement.holds() for _, agreement in agreements.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
