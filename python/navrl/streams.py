"""Named random streams of the learner: one counter-based generator per (seed, purpose).

    stream(seed, purpose) -> Generator
    stream_state(generator) -> (13,) uint64; restore_stream(generator, state)

Their bits are numpy's Philox4x64; the simulator's streams are its own.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Opens a stream at its beginning.

    Args:
        seed: Seed of the run, 0 to 2^64 - 1.
        purpose: What the numbers are for, such as "exploration".

    Returns:
        A generator on Philox4x64 whose 128-bit key is (seed, hash of the purpose): different names share no numbers.
    """
    name = int.from_bytes(hashlib.blake2b(purpose.encode(), digest_size=8).digest(), "little")
    return np.random.Generator(np.random.Philox(key=np.array([seed, name], np.uint64)))


def stream_state(generator: np.random.Generator) -> NDArray[np.uint64]:
    """The complete state of a stream.

    Returns:
        (13,) uint64: counter (4), key (2), buffered block (4), its position, and a half-used word (flag, word).
    """
    state = generator.bit_generator.state
    rest = [state["buffer_pos"], state["has_uint32"], state["uinteger"]]
    parts = [state["state"]["counter"], state["state"]["key"], state["buffer"], np.array(rest, np.uint64)]
    return np.concatenate(parts).astype(np.uint64)


def restore_stream(generator: np.random.Generator, state: NDArray[np.uint64]) -> None:
    """Puts a stream back to what `stream_state` returned.

    Args:
        generator: A stream of `stream`.
        state: (13,) uint64.

    Raises:
        ValueError: If the state belongs to a stream of another name.
    """
    if not np.array_equal(state[4:6], generator.bit_generator.state["state"]["key"]):
        raise ValueError("the saved random stream belongs to another seed or purpose")
    generator.bit_generator.state = {
        "bit_generator": "Philox",
        "state": {"counter": state[:4].copy(), "key": state[4:6].copy()},
        "buffer": state[6:10].copy(),
        "buffer_pos": int(state[10]),
        "has_uint32": int(state[11]),
        "uinteger": int(state[12]),
    }
