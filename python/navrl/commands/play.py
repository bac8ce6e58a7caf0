"""`navrl play`: one episode as a picture or a film."""

import sys
from argparse import Namespace

from navrl.commands.options import output_file, threads, whole_number
from navrl.commands.selection import place, scenario_list, simulator
from navrl.exit_codes import DONE


def play(options: Namespace) -> int:
    """Draws one episode as a picture or a film."""
    target = output_file("--out", options.out)
    index = 0 if options.index is None else whole_number("--index", options.index, 0, 10**6)

    from navrl.drawing.film import check_output, write
    from navrl.drawing.trajectory import drive
    from navrl.policy import load_policy

    check_output(target)
    policy = load_policy(options.policy)
    sim = simulator(options, options.policy, policy.description)
    print(f"navrl: {options.policy} drives scenario {index} of {place(options, sim)}", file=sys.stderr)
    scenarios = scenario_list(options, sim, count=None, num_threads=threads(None), lengths=False)
    trajectory = drive(policy, scenarios, index, sim)
    write(trajectory, target, title=f"{options.policy} on {place(options, sim)}, scenario {index}")
    print(f"{target}: {trajectory.outcome} after {trajectory.steps * sim.task.period:.1f} s")
    return DONE
