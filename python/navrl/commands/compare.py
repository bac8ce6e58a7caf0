"""`navrl compare`: contenders side by side on one list of scenarios."""

from argparse import Namespace
from pathlib import Path

from navrl.commands.options import threads, whole_number
from navrl.commands.selection import contest, scenario_list
from navrl.exit_codes import DONE


def compare(options: Namespace) -> int:
    """Runs all contenders, writes what came of it, and prints the tables."""
    num_threads = threads(options.threads)
    count = None if options.episodes is None else whole_number("--episodes", options.episodes, 1, 10**6)
    folder = Path(options.out)
    config, sim, contenders = contest(options, options.names)
    scenarios = scenario_list(options, sim, count=count, num_threads=num_threads)

    from rich.console import Console

    from navrl.compare import compare as run
    from navrl.compare import write
    from navrl.comparing.report import terminal
    from navrl.display import Display

    with Display(at_once=False) as display:
        comparison = run(
            contenders,
            scenarios,
            sim,
            folder,
            level=options.level,
            controllers=config.controllers,
            planner=config.planner,
            num_threads=num_threads,
            display=display,
        )
    write(comparison, folder, options.typed)
    print(terminal(comparison, str(folder / "report.md"), Console()), end="")
    return DONE
