"""`navrl bench`: how fast the simulator steps."""

import json
import statistics
import sys
import time
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from navrl import _navsim
from navrl.batch import BatchSim
from navrl.commands.options import given_settings, output_file, threads, whole_number
from navrl.config import SimConfig
from navrl.config.files import Option, load_sim
from navrl.durable import write_file
from navrl.exit_codes import DONE

SCHEMA = 1
"""Version of the JSON file."""
SLICES = 7
SLICE_S = 0.5
WARM_UP_S = 0.5


def bench(options: Namespace) -> int:
    """Measures the simulator's speed."""
    num_envs = whole_number("--num-envs", options.num_envs, 1, 65536)
    num_threads = threads(options.threads)
    target = None if options.json is None else output_file("--json", options.json)
    settings = given_settings(options, "world", "noise")
    usual = load_sim([]).lidar
    beams = usual.beams if options.beams is None else whole_number("--beams", options.beams, 1, 4096)
    # Every bin needs a beam: with fewer beams than the usual bins there is one bin for each.
    bins = min(beams, usual.bins)
    lidar = [Option("--beams", "lidar.beams", str(beams)), Option("--beams", "lidar.bins", str(bins))]
    config = load_sim([*settings, *lidar])
    print(f"navrl: stepping {num_envs} robots in {config.world.name} for some seconds", file=sys.stderr)

    speed = measure(config, num_envs=num_envs, num_threads=num_threads)
    print(
        f"{config.world.name}: {speed.median:,.0f} steps/s (min {speed.minimum:,.0f}, max {speed.maximum:,.0f}); "
        f"{num_envs} robots, {beams} beams, noise {config.lidar.noise} m, threads {num_threads}, {_navsim.isa()}"
    )
    if target is not None:
        write_json(target, config, speed, num_envs=num_envs, num_threads=num_threads)
    return DONE


@dataclass(frozen=True)
class Speed:
    """Environment steps per second over the slices of one measurement."""

    minimum: float
    median: float
    maximum: float


def measure(config: SimConfig, *, num_envs: int, num_threads: int) -> Speed:
    """Steps robots with uniform random actions and automatic resets, after a warm-up, in slices of half a second.

    Args:
        config: what to simulate.
        num_envs: robots stepped together; one call makes as many environment steps.
        num_threads: threads of the simulator.

    Returns:
        Environment steps per second of the slowest, the middle and the fastest slice.
    """
    sim = BatchSim(config, num_envs=num_envs, seed=0, num_threads=num_threads)
    generator = np.random.Generator(np.random.Philox(0))
    actions = generator.uniform(-1.0, 1.0, (16, num_envs, 2)).astype(np.float32)

    def steps_per_second(duration_s: float) -> float:
        calls = 0
        start = time.perf_counter()
        while (elapsed := time.perf_counter() - start) < duration_s:
            for batch in actions:
                sim.step(batch)
            calls += len(actions)
        return calls * num_envs / elapsed

    steps_per_second(WARM_UP_S)
    rates = [steps_per_second(SLICE_S) for _ in range(SLICES)]
    return Speed(min(rates), statistics.median(rates), max(rates))


def write_json(path: Path, config: SimConfig, speed: Speed, *, num_envs: int, num_threads: int) -> None:
    """Writes one measurement with all that it depends on."""
    record = {
        "schema": SCHEMA,
        "world": config.world.name,
        "num_envs": num_envs,
        "beams": config.lidar.beams,
        "threads": num_threads,
        "noise": config.lidar.noise,
        "isa": _navsim.isa(),
        "steps_per_second": {"min": speed.minimum, "median": speed.median, "max": speed.maximum},
    }
    write_file(path, (json.dumps(record, indent=2) + "\n").encode())
