"""Prints what the last `cargo bench` measured, as min / median / max over its samples.

    cargo bench && python benches/spread.py

criterion itself prints a confidence interval of the mean, which hides how much a shared machine varies.
"""

from __future__ import annotations

import json
import statistics
import sys
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "target" / "criterion"


def main() -> int:
    """One line for each benchmark: nanoseconds an iteration, divided by its elements if it counts them."""
    samples = sorted(FOLDER.glob("**/new/sample.json"))
    if not samples:
        print(f"{FOLDER} has no results: run cargo bench first", file=sys.stderr)
        return 2
    print(
        f"{'ns, per element where there are several':52s}"
        + "".join(f"{word:>10s}" for word in ("min", "median", "max"))
    )
    for file in samples:
        sample = json.loads(file.read_bytes())
        benchmark = json.loads(file.with_name("benchmark.json").read_bytes())
        elements = (benchmark["throughput"] or {}).get("Elements", 1)
        times = [
            time / iterations / elements for time, iterations in zip(sample["times"], sample["iters"], strict=True)
        ]
        numbers = (min(times), statistics.median(times), max(times))
        print(f"{benchmark['full_id']:52s}" + "".join(f"{number:>10,.0f}" for number in numbers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
