"""Times the updates of the native kernel beside torch's and stable-baselines3's in one run.

    OMP_NUM_THREADS=1 python benches/learner.py [--peers torch stable-baselines3] [--seconds S] [--slices K]
    OMP_NUM_THREADS=1 python benches/learner.py --twins [--seconds S] [--slices K]

All learn with twin critics on one thread from 100,000 made-up rows of 26 inputs, sampling included. Their slices
alternate, so that whatever else the machine does meets all; the ratio is taken slice by slice. Seconds are processor
time, which other programs disturb less; on an idle machine they are those of the clock.

With `--twins` two copies of the native kernel with one thread, each in a process of its own on a core of its own, make
updates at the same time; then one learner with two threads on the same two cores; and so on in turn. The ratio is that
of the two threads to both copies together, slice by slice, by the clock.
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import os
import platform
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Literal, NamedTuple

import numpy as np
import torch

from navrl.config import Config, LearnerConfig, NetworksConfig, ThreadsConfig
from navrl.replay import Replay, row_width
from navrl.td3 import TD3, flushed_denormals

INPUTS, ROWS = 26, 100_000
SB3 = "stable-baselines3"
PEERS = ("torch", SB3)
"""The reference that `learner.kernel = "torch"` computes with, and another package."""


class Variant(NamedTuple):
    """Sizes to time."""

    hidden_sizes: tuple[int, ...]
    batch_size: int
    policy_delay: int = 2

    def __str__(self) -> str:
        """The sizes as a table shows them."""
        return f"{'-'.join(map(str, self.hidden_sizes))}, batch {self.batch_size}, delay {self.policy_delay}"


VARIANTS = (
    Variant((800, 600), 40),
    Variant((256, 256), 40),
    Variant((128, 128), 256),
    Variant((64, 64), 40),
    Variant((128, 128), 96, 3),
)
"""Four that published comparisons use, and the defaults."""


def navrl_updates(
    variant: Variant, kernel: Literal["native", "torch"] = "native", threads: int = 1
) -> Callable[[int], object]:
    """Updates of this package with its default options (mirror, penalty): call with their number."""
    learner = LearnerConfig(kernel=kernel, batch_size=variant.batch_size, policy_delay=variant.policy_delay)
    networks = NetworksConfig(hidden_sizes=variant.hidden_sizes)
    config = Config(networks=networks, learner=learner, threads=ThreadsConfig(learn=threads))
    replay = Replay(ROWS, row_width(INPUTS))
    rows = np.random.default_rng(0).normal(0.0, 0.3, (ROWS, replay.width)).astype(np.float32)
    rows[:, -1] = learner.gamma**learner.n_step
    replay.add(rows)
    return TD3(config, replay).update


def stable_baselines3_updates(variant: Variant) -> Callable[[int], object]:
    """Updates of stable-baselines3's TD3 with the same sizes: call with their number."""
    import gymnasium
    from stable_baselines3 import TD3 as PeerTD3
    from stable_baselines3.common.logger import Logger

    class Spaces(gymnasium.Env[np.ndarray, np.ndarray]):
        """An environment that is never stepped."""

        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (INPUTS,), np.float32)
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    model = PeerTD3(
        "MlpPolicy",
        Spaces(),
        batch_size=variant.batch_size,
        buffer_size=ROWS,
        policy_delay=variant.policy_delay,
        policy_kwargs={"net_arch": list(variant.hidden_sizes)},
        device="cpu",
        seed=0,
    )
    model.set_logger(Logger(None, []))
    buffer, generator = model.replay_buffer, np.random.default_rng(0)
    for array in (buffer.observations, buffer.next_observations, buffer.actions, buffer.rewards):
        array[:] = generator.normal(0.0, 0.3, array.shape)
    buffer.full = True
    return lambda count: model.train(gradient_steps=count, batch_size=variant.batch_size)


def rate(updates: Callable[[int], object], seconds: float, clock: Callable[[], float] = time.process_time) -> float:
    """Updates per second over about `seconds`, in calls of 5 as training makes them."""
    count, start = 0, clock()
    while (elapsed := clock() - start) < seconds:
        updates(5)
        count += 5
    return count / elapsed


def measure(variant: Variant, *, peers: list[str], slices: int, seconds: float) -> None:
    """Prints a line for each contender: min / median / max updates per second, and native's ratio to it."""
    contenders = [navrl_updates(variant)]
    contenders += [
        navrl_updates(variant, "torch") if peer == "torch" else stable_baselines3_updates(variant) for peer in peers
    ]
    for updates in contenders:
        updates(20)
    rates = np.array([[rate(updates, seconds) for updates in contenders] for _ in range(slices)])
    print(f"{variant!s:34s} native {_spread(rates[:, 0])}", flush=True)
    for peer, column in zip(peers, rates.T[1:], strict=True):
        print(f"{'':34s} {peer} {_spread(column)}   ratio {_spread(rates[:, 0] / column)}", flush=True)


def contend(pipe: Connection, variant: Variant, cores: set[int], seconds: float) -> None:
    """The work of a process: makes updates on as many threads as cores whenever it is told to, and sends their rate."""
    os.sched_setaffinity(0, cores)
    torch.set_num_threads(1)
    with flushed_denormals():
        updates = navrl_updates(variant, threads=len(cores))
        updates(20)
        pipe.send(0.0)
        while pipe.recv():
            pipe.send(rate(updates, seconds, time.perf_counter))


def measure_twins(variant: Variant, *, slices: int, seconds: float) -> None:
    """Prints min / median / max updates per second of two copies together and of two threads, and their ratio."""
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        raise SystemExit("--twins needs two cores")
    first, second = cores[:2]
    context = multiprocessing.get_context("spawn")
    pipes, processes = [], []
    for own in ({first}, {second}, {first, second}):
        pipe, end = context.Pipe()
        pipes.append(pipe)
        processes.append(context.Process(target=contend, args=(end, variant, own, seconds), daemon=True))
        processes[-1].start()
        pipe.recv()
    rates = []
    for _ in range(slices):
        rates.append([_together(pipes[:2]), _together(pipes[2:])])
    for pipe, process in zip(pipes, processes, strict=True):
        pipe.send(False)
        process.join()
    copies, threads = np.array(rates).T
    print(f"{variant!s:34s} two copies {_spread(copies)}   two threads {_spread(threads)}   ", end="")
    print(f"ratio {_spread(threads / copies)}", flush=True)


def _together(pipes: list[Connection]) -> float:
    """The sum of the rates of some processes that work at the same time."""
    for pipe in pipes:
        pipe.send(True)
    return sum(float(pipe.recv()) for pipe in pipes)


def _spread(numbers: np.ndarray) -> str:
    """Min / median / max."""
    digits = 2 if numbers.max() < 100 else 0
    return " / ".join(f"{n:.{digits}f}" for n in (numbers.min(), np.median(numbers), numbers.max()))


def main() -> int:
    """Times all variants."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a slice")
    parser.add_argument("--slices", type=int, default=11, help="slices of each contender")
    parser.add_argument(
        "--peers", nargs="*", choices=PEERS, default=PEERS, help="what to time beside the native kernel"
    )
    parser.add_argument("--twins", action="store_true", help="two threads beside two copies with one, on two cores")
    options = parser.parse_args()
    torch.set_num_threads(1)
    machine = platform.processor() or platform.machine()
    if options.twins:
        print(f"updates per second, min / median / max, {machine}, 2 cores")
        for variant in VARIANTS:
            measure_twins(variant, slices=options.slices, seconds=options.seconds)
        return 0
    peers = list(options.peers)
    if SB3 in peers and importlib.util.find_spec("stable_baselines3") is None:
        print(f"{SB3} is missing; to measure beside it: pip install {SB3}", file=sys.stderr)
        peers.remove(SB3)
    print(f"updates per second, min / median / max; torch {torch.__version__}, {machine}, 1 thread")
    with flushed_denormals():
        for variant in VARIANTS:
            measure(variant, peers=peers, slices=options.slices, seconds=options.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
