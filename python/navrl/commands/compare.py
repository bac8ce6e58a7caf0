"""`navrl compare`: contenders side by side on one list of scenarios."""

import sys
from argparse import Namespace
from pathlib import Path

from navrl.commands.options import threads, whole_number
from navrl.commands.selection import contest, place, scenario_list
from navrl.exit_codes import DONE


def compare(options: Namespace) -> int:
    """Runs all contenders, writes what came of it, and prints the tables."""
    num_threads = threads(options.threads)
    count = None if options.episodes is None else whole_number("--episodes", options.episodes, 1, 10**6)
    folder = Path(options.out)
    config, sim, entries = contest(options, options.names)

    from rich.console import Console

    from navrl.compare import compare as run
    from navrl.compare import write
    from navrl.comparing import plots, report
    from navrl.durable import write_file

    where = place(options, sim)
    print(f"navrl: comparing {report.contenders(len(entries))} on {where}; {folder}", file=sys.stderr)
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
