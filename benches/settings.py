"""Trains with settings that differ and tells how good the policies are: the search behind docs/learning.md.

    python benches/settings.py --seeds 200-203 --out lab.jsonl "" "learner.tau=0.02" "reward.goal=200 learner.n_step=15"

Each argument is one variant: KEY=VALUE pairs as `navrl train --KEY VALUE` takes them, "" for the defaults. Every seed
trains as `navrl train` does, its best policy by validation is driven on scenarios of the split "tuning" alone, and the
table gives mean and spread over the seeds. Results are appended to the file, and what stands there is not run again.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import statistics
import tempfile
from pathlib import Path
from typing import Any

from navrl import load_policy
from navrl.batch import draw_list
from navrl.config.files import Option, load_config
from navrl.evaluate import evaluate
from navrl.running.session import train

COLUMNS = ("success_rate", "collision_rate", "timeout_rate", "spl")


def main() -> None:
    """Runs what is missing and prints one line for each run and each variant."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("variants", nargs="+", metavar='"KEY=VALUE ..."')
    parser.add_argument("--seeds", default="200-203", metavar="A-B", help="training seeds, named beforehand")
    parser.add_argument("--scenarios", type=int, default=2000, metavar="N", help="of the split tuning, for each policy")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="results, one JSON object a line")
    options = parser.parse_args()
    first, last = (int(seed) for seed in options.seeds.split("-"))
    known = read(options.out)
    for variant in options.variants:
        records = []
        for seed in range(first, last + 1):
            key = (variant, seed, options.scenarios)
            if key not in known:
                known[key] = run(variant, seed, options.scenarios)
                with options.out.open("a") as file:
                    print(json.dumps([*key, known[key]]), file=file)
            records.append(known[key])
            print(line(f"{variant or 'defaults'}, seed {seed}", known[key]), flush=True)
        means = {column: statistics.fmean(record[column] for record in records) for column in COLUMNS}
        rates = [record["success_rate"] for record in records]
        spread = statistics.stdev(rates) / math.sqrt(len(rates)) if len(rates) > 1 else math.nan
        print(line(f"{variant or 'defaults'}: mean of {len(rates)}", means), f" standard error {100 * spread:.2f} %\n")


def read(file: Path) -> dict[tuple[str, int, int], dict[str, Any]]:
    """Scores by variant, seed and number of scenarios; none if there is no such file."""
    lines = file.read_text().splitlines() if file.exists() else []
    return {(variant, seed, count): scores for variant, seed, count, scores in map(json.loads, lines)}


def run(variant: str, seed: int, count: int) -> dict[str, Any]:
    """Trains one policy, which is thrown away, and returns its scores on the first draws of the split tuning."""
    pairs = [pair.split("=", 1) for pair in (*variant.split(), f"training.seed={seed}")]
    config = load_config(options=[Option(f"--{key}", key, value) for key, value in pairs])
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        policy = load_policy(train(config, Path(folder) / "run", test=False))
    scenarios = draw_list(config.sim, "tuning", count)
    return evaluate(policy, scenarios, sim=config.sim).summary.to_json()


def line(name: str, scores: dict[str, Any]) -> str:
    """A line of the table."""
    success, collision, timeout = (100 * scores[column] for column in COLUMNS[:3])
    rates = f"success {success:6.2f} %  collision {collision:5.2f} %  time-out {timeout:5.2f} %"
    return f"{name:48s} {rates}  SPL {scores['spl']:.3f}"


if __name__ == "__main__":
    main()
