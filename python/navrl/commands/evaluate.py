"""`navrl eval`: measures a policy on a fixed list of scenarios."""

import sys
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from navrl.commands.options import margin, output_file, threads, whole_number
from navrl.commands.selection import place, scenario_list, simulator
from navrl.errors import UserError
from navrl.exit_codes import DONE

if TYPE_CHECKING:
    from navrl.policy import Policy


def evaluate(options: Namespace) -> int:
    """Measures a policy on a list of scenarios."""
    target = None if options.json is None else output_file("--json", options.json)
    num_threads = threads(options.threads)
    count = None if options.episodes is None else whole_number("--episodes", options.episodes, 1, 10**6)

    brake = None if options.brake is None else margin("--brake", options.brake)

    policy = _policy(options.policy)
    sim = simulator(options, options.policy, policy.description)
    if brake is not None and sim.robot.footprint != "disc":
        raise UserError(f"--brake {options.brake}: needs a round robot, and that of {options.policy} is not")
    name = options.policy if brake is None else f"{options.policy}, braking at {brake:g} m"
    scenarios = scenario_list(options, sim, count=count, num_threads=num_threads)
    print(f"navrl: evaluating {name} on {place(options, sim)}", file=sys.stderr)

    from rich.console import Console

    from navrl import evaluate as run
    from navrl.evaluate import scores_table, write_json

    evaluation = run(policy, scenarios, sim=sim, num_threads=num_threads, brake=brake)
    if target is not None:
        write_json(target, evaluation, name)
    print(scores_table(evaluation.summary, name, place(options, sim), Console()), end="")
    return DONE


def _policy(name: str) -> "Policy":
    from navrl.policy import load_policy

    try:
        return load_policy(name)
    except UserError:
        from navrl.controllers import NAMES

        if not Path(name).exists() and ("+" in name or name in NAMES):
            raise UserError(f"{name}: is no policy alone: navrl compare {name} --out DIR evaluates it") from None
        raise
