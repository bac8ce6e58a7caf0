"""Draws how runs went: success against episodes and against steps, and what the critics promise beside what robots get.

    pip install matplotlib
    python benches/curves.py FILE.png RUN [RUN ...]

Each RUN is a run folder; its colour tells the algorithm, its stroke the seed. The mean value of the critics (Q) is that
of the rows of replay, the return that of the newest 100 training episodes; both count what the configuration adds to
equations 3 and 5, unscaled.
"""

from __future__ import annotations

import csv
import sys
import tomllib
from math import nan
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

COLOURS = {"td3": "#1f6f8b", "ddpg": "#c8553d"}
STROKES = ("-", "--", ":", "-.")


class Run(NamedTuple):
    """One training run."""

    name: str
    colour: str
    stroke: str
    columns: dict[str, list[float]]
    """Columns of metrics.csv; NaN where a row has none."""


def main(target: str, *folders: str) -> None:
    """Reads the runs and writes the picture."""
    runs = [read_run(Path(folder)) for folder in folders]
    figure, panels = plt.subplots(1, 3, figsize=(13, 3.9), layout="constrained")
    for panel, axis in zip(panels, ("episodes", "thousand steps", "thousand steps"), strict=True):
        panel.set_xlabel(axis)
        panel.grid(alpha=0.25)
        panel.spines[["top", "right"]].set_visible(False)
    for run in runs:
        for panel, axis in ((panels[0], "episodes"), (panels[1], "steps")):
            draw(panel, run, axis, "success")
        draw(panels[2], run, "steps", "average_q")
        draw(panels[2], run, "steps", "training_return", faint=True)
    for panel in panels[:2]:
        panel.set_ylabel("success of the newest episodes, %")
        panel.set_ylim(-2, 102)
    panels[2].set_ylabel("mean Q (strong) and return (faint)")
    panels[0].legend(frameon=False)
    figure.savefig(target, dpi=110)


def read_run(folder: Path) -> Run:
    """Reads metrics.csv and the two settings that the picture shows."""
    config = tomllib.loads((folder / "config.toml").read_text(encoding="utf-8"))
    algorithm, seed = config["learner"]["algorithm"], config["training"]["seed"]
    with (folder / "metrics.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    columns = {name: [float(row[name]) if row[name] else nan for row in rows] for name in rows[0]}
    columns["steps"] = [steps / 1000 for steps in columns["steps"]]
    columns["success"] = [100 * share for share in columns["success"]]
    return Run(f"{algorithm.upper()}, seed {seed}", COLOURS[algorithm], STROKES[seed % len(STROKES)], columns)


def draw(panel: Axes, run: Run, axis: str, column: str, *, faint: bool = False) -> None:
    """Adds one curve, with its gaps; a faint one is not in the legend."""
    alpha, label = (0.45, None) if faint else (1.0, run.name)
    x, y = run.columns[axis], run.columns[column]
    panel.plot(x, y, run.stroke, color=run.colour, alpha=alpha, linewidth=1.4, label=label)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
