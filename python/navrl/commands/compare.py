"""`navrl compare`: contenders side by side on one list of scenarios."""

import sys
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from navrl.commands.options import given_settings, threads, whole_number
from navrl.commands.selection import check_boxes, place, scenario_list, simulator
from navrl.config.files import load_config
from navrl.exit_codes import DONE

if TYPE_CHECKING:
    from navrl.comparing.contenders import Entry
    from navrl.config import Config, SimConfig


def compare(options: Namespace) -> int:
    """Runs all contenders, writes what came of it, and prints the tables."""
    num_threads = threads(options.threads)
    count = None if options.episodes is None else whole_number("--episodes", options.episodes, 1, 10**6)
    check_boxes(options)
    config = load_config(options.config, robot=options.robot, options=given_settings(options, "world", "boxes"))
    folder = Path(options.out)

    from navrl.comparing.contenders import enter

    entries = [enter(name) for name in options.names]
    sim = _robot(options, config, entries)

    from rich.console import Console

    from navrl.compare import compare as run
    from navrl.compare import write
    from navrl.comparing import plots, report
    from navrl.durable import write_file

    where = place(options, sim)
    print(f"navrl: comparing {len(options.names)} contenders on {where}; {folder}", file=sys.stderr)
    comparison = run(
        entries,
        scenario_list(options, sim, count=count, num_threads=num_threads),
        sim,
        folder,
        level=options.level,
        controllers=config.controllers,
        planner=config.planner,
        num_threads=num_threads,
        report=lambda line: print(f"navrl: {line}", file=sys.stderr),
    )
    write(comparison, folder, options.typed)
    pictures = plots.write(comparison, folder)
    write_file(folder / "report.md", report.markdown(comparison, where, options.typed, pictures).encode())
    print(report.terminal(comparison, where, Console()), end="")
    print(f"report: {folder / 'report.md'}")
    return DONE


def _robot(options: Namespace, config: "Config", entries: "list[Entry]") -> "SimConfig":
    """Robot, lidar and task: as configured, and if nothing is, those of the first policy, as `navrl eval` has them."""
    first = next((entry for entry in entries if entry.policy is not None), None)
    if first is None or first.policy is None or options.config or options.robot or options.settings:
        return config.sim
    return simulator(options, first.name.removesuffix(f"+{first.planner}"), first.policy.description)
