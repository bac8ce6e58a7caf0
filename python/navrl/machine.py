"""What the bits of a run depend on besides its configuration: the processor, the builds and the learner's threads.

Machine.here(config) -> Machine;  .differences(other) -> list of lines
made_with() -> what a result says of the software and the processor behind it
cpu_model(), cores(), available_memory()
"""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from dataclasses import dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from navrl.config import THREADS_MAX

if TYPE_CHECKING:
    from navrl.config import Config

CGROUP = Path("/sys/fs/cgroup")
"""Limits of a container, where there is one."""
RECLAIMABLE = ("inactive_file", "active_file", "slab_reclaimable")
"""Lines of memory.stat: cached files and what the kernel keeps about them."""


@dataclass(frozen=True)
class Machine:
    """What has to be equal for a resumed run to continue bit for bit."""

    navrl: str
    """Version of navrl."""
    torch: str
    """Version and build of torch."""
    numpy: str
    """Version of numpy."""
    cpu: str
    """Model of the processor."""
    isa: str
    """Instruction set of the simulator's scan kernels."""
    torch_isa: str
    """Instruction set of torch's kernels."""
    kernel: str
    """What computes the updates: the native kernel or torch."""
    learn_threads: int
    """Threads of torch's updates; 0 with the native kernel, whose bits do not depend on them."""
    world_sha256: str
    """Hash of the world file; empty for a built-in world."""

    @classmethod
    def here(cls, config: Config) -> Machine:
        """The present one, for a run of that configuration."""
        import torch

        from navrl import _navsim
        from navrl.native import kernel_of, learn_threads

        world, kernel = Path(config.world.name), kernel_of(config)
        return cls(
            navrl=metadata.version("navrl"),
            torch=torch.__version__,
            numpy=np.__version__,
            cpu=cpu_model(),
            isa=_navsim.isa(),
            torch_isa=torch.backends.cpu.get_cpu_capability(),
            kernel=kernel,
            learn_threads=learn_threads(config) if kernel == "torch" else 0,
            world_sha256=hashlib.sha256(world.read_bytes()).hexdigest() if world.suffix else "",
        )

    def differences(self, other: Machine) -> list[str]:
        """What differs, as `name: own value, other value`."""
        names = [field.name for field in fields(self)]
        pairs = {name: (getattr(self, name), getattr(other, name)) for name in names}
        return [f"{name}: {own}, {others}" for name, (own, others) in pairs.items() if own != others]


def made_with() -> dict[str, str | None]:
    """Version and commit of navrl, version of numpy, the processor and the instruction set of the simulator's kernels.

    The commit is None where navrl was installed from a wheel, and ends in "+" where the source tree was changed since.
    """
    from navrl import _navsim

    return {
        "navrl": metadata.version("navrl"),
        "commit": commit(Path(__file__).parent),
        "numpy": np.__version__,
        "cpu": cpu_model(),
        "isa": _navsim.isa(),
    }


def commit(folder: Path) -> str | None:
    """The commit of the source tree in a folder; None if it is not one that git keeps.

    Args:
        folder: Of modules.
    """

    def git(*words: str) -> str:
        command = ["git", "-C", str(folder), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        # A wheel may lie within somebody else's repository, which does not keep its files.
        git("ls-files", "--error-unmatch", Path(__file__).name)
        return git("rev-parse", "--short=12", "HEAD") + ("+" if git("status", "--porcelain", "-uno", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def cpu_model() -> str:
    """The processor's name with what tells it from others of that name, in one line."""
    keys = {"model name": "", "cpu family": "family ", "model": "model ", "stepping": "stepping "}
    found: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            found.setdefault(key.strip(), value.strip())
    except OSError:
        return platform.processor() or platform.machine()
    words = [prefix + found[key] for key, prefix in keys.items() if key in found]
    return ", ".join(words) or platform.machine()


def cores() -> int:
    """Processor cores that this process may use, at most as many as a simulator can have threads."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(usable, THREADS_MAX)


def available_memory() -> int | None:
    """Memory that can be taken without swapping (bytes), within the limits of a container; None if unknown."""
    free = []
    try:
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
        free += [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
        limit = (CGROUP / "memory.max").read_text(encoding="utf-8").strip()
        if limit != "max":
            used = int((CGROUP / "memory.current").read_text(encoding="utf-8")) - _reclaimable_memory()
            free.append(int(limit) - max(0, used))
    except (OSError, ValueError):
        pass
    return min(free, default=None)


def _reclaimable_memory() -> int:
    """Memory (bytes) that counts as used by the container but is given back when somebody needs it."""
    lines = (CGROUP / "memory.stat").read_text(encoding="utf-8").splitlines()
    amounts = dict(line.split(maxsplit=1) for line in lines)
    return sum(int(amounts.get(name, 0)) for name in RECLAIMABLE)
