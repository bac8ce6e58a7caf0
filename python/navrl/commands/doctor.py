"""`navrl doctor`: what this installation consists of and whether it works."""

import platform
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from navrl.exit_codes import DONE, INTERNAL_ERROR
from navrl.machine import cores, cpu_model

if TYPE_CHECKING:
    from navrl.config import Config
    from navrl.replay import Replay
    from navrl.td3 import TD3

PACKAGES = ("navrl", "numpy", "torch", "gymnasium", "pydantic", "safetensors", "rich", "tensorboard", "pillow")
FEATURES = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512vl", "neon", "asimd")
"""Processor features worth knowing, as Linux names them."""


def doctor(_: Namespace) -> int:
    """Examines the installation."""
    return DONE if examine() else INTERNAL_ERROR


def examine() -> bool:
    """Prints versions, processor and threads, then a self-test with a line for each part.

    Returns:
        Whether every part works.
    """
    for name, text in _facts():
        print(f"{name:<10} {text}")
    outcomes = [_passes(name, part) for name, part in _PARTS.items()]
    print("all parts work" if all(outcomes) else "some parts do not work")
    return all(outcomes)


def _facts() -> Iterator[tuple[str, str]]:
    yield "python", f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    yield "packages", ", ".join(f"{name} {_version(name)}" for name in PACKAGES)
    yield "processor", f"{cpu_model()}; {' '.join(_features()) or 'features unknown'}"
    yield (
        "threads",
        f"{cores()} cores usable; training learns on {min(cores(), 2)} and simulates on {max(1, cores() - 2)}",
    )
    yield "simulator", f"instruction set {_isa()}"
    yield "torch", _torch_build()


def _features() -> list[str]:
    """Features of the processor that are worth knowing, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    present = {name for line in lines if line.startswith(("flags", "Features")) for name in line.split()}
    return [name for name in FEATURES if name in present]


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "is missing"


def _isa() -> str:
    try:
        from navrl import _navsim
    except ImportError as error:
        return f"unknown: {error}"
    return _navsim.isa()


def _torch_build() -> str:
    try:
        import torch
    except ImportError as error:
        return f"cannot be imported: {error}"
    build = f"CUDA {torch.version.cuda}" if torch.version.cuda else "CPU"
    return f"{build} build, {torch.backends.cpu.get_cpu_capability()} kernels, {torch.get_num_threads()} threads"


def _passes(name: str, part: Callable[[], str]) -> bool:
    start = time.perf_counter()
    try:
        detail = part()
    except Exception as error:  # whatever is broken here is what the user wants to know
        print(f"FAIL {name}: {type(error).__name__}: {' '.join(str(error).split())}")
        return False
    print(f"OK   {name}: {detail} ({time.perf_counter() - start:.1f} s)")
    return True


def _simulate() -> str:
    from navrl.batch import BatchSim
    from navrl.config import SimConfig

    robots, steps = 64, 200
    actions = np.random.Generator(np.random.Philox(0)).uniform(-1, 1, (steps, robots, 2)).astype(np.float32)
    results = []
    for threads in (1, 2):
        sim = BatchSim(SimConfig(), num_envs=robots, seed=0, num_threads=threads)
        for batch in actions:
            sim.step(batch)
        if not np.isfinite(sim.observations).all():
            raise ArithmeticError("an observation is not finite")
        results.append((sim.observations.tobytes(), sim.rewards.tobytes(), sim.poses.tobytes()))
    if results[0] != results[1]:
        raise ArithmeticError("one thread and two give different results")
    return f"{2 * robots * steps} steps, the same bits from 1 and 2 threads"


def _learn() -> str:
    from navrl.config import Config
    from navrl.native import kernel_of
    from navrl.td3 import flushed_denormals

    with flushed_denormals():
        learner, replay = _learner(Config())
        metrics = learner.update(10)
    if not np.isfinite(metrics.critic_loss):
        raise ArithmeticError(f"critic loss is {metrics.critic_loss}")
    return f"10 updates of TD3 on {replay.size} rows, computed by {kernel_of(Config())}"


def _checkpoint() -> str:
    from navrl.config import Config
    from navrl.replay import Replay
    from navrl.running.checkpoint import Checkpoints
    from navrl.td3 import flushed_denormals

    with flushed_denormals():
        learner, replay = _learner(Config())
        learner.update(3)
    state = learner.state()
    with tempfile.TemporaryDirectory() as folder:
        Checkpoints(Path(folder)).save({}, state, replay, keep=2)
        saved = Checkpoints(Path(folder)).newest()
        again = Replay(replay.capacity, replay.width)
        saved.restore_replay(again)
    if any(saved.arrays[name].tobytes() != np.asarray(array).tobytes() for name, array in state.items()):
        raise ArithmeticError("an array changed on its way through a checkpoint")
    again.restore(replay.state())
    if again.read(0, replay.size).tobytes() != replay.read(0, replay.size).tobytes():
        raise ArithmeticError("a row of replay changed on its way through a checkpoint")
    return f"{len(state)} arrays and {replay.size} rows written and read back, bit for bit"


def _act() -> str:
    import torch

    from navrl.config import Config
    from navrl.encoding import encode_observations
    from navrl.policy import Policy
    from navrl.policy_description import PolicyDescription

    config = Config()
    learner, _ = _learner(config)
    # Torch is asked one-sided.
    description = replace(PolicyDescription.from_config(config), symmetric=False)
    policy = Policy(learner.policy_weights(), description)
    bins = config.lidar.bins
    observations = np.random.Generator(np.random.Philox(1)).uniform(0, 1, (8, bins + 4)).astype(np.float32)
    with torch.no_grad():
        expected = learner.policy(torch.from_numpy(encode_observations(observations, config.networks.encoding)))
    if not np.allclose(policy.act(observations), expected.numpy(), atol=1e-5):
        raise ArithmeticError("the native kernel and torch compute different actions")
    return "the native kernel computes torch's actions"


def _load() -> str:
    from navrl.policy import load_policy

    policy = load_policy("default")
    policy.act(np.zeros(policy.description.bins + 4, np.float32))
    return "the policy that ships with navrl loads and acts"


def _learner(config: "Config") -> "tuple[TD3, Replay]":
    """A learner with its first weights and some random rows."""
    from navrl.encoding import encoded_size
    from navrl.replay import Replay, row_width
    from navrl.td3 import TD3

    replay = Replay(1000, row_width(encoded_size(config.lidar.bins, config.networks.encoding)))
    rows = np.random.Generator(np.random.Philox(0)).uniform(0, 1, (600, replay.width))
    replay.add(rows.astype(np.float32))
    return TD3(config, replay), replay


_PARTS = {"simulate": _simulate, "learn": _learn, "checkpoint": _checkpoint, "policy": _act, "default policy": _load}
