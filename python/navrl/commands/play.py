"""`navrl play`: one episode of any contender as a picture or a film."""

import sys
from argparse import Namespace

from navrl.commands.options import output_file, threads, whole_number
from navrl.commands.selection import contest, place, scenario_list
from navrl.exit_codes import DONE


def play(options: Namespace) -> int:
    """Draws one episode as a picture or a film."""
    target = output_file("--out", options.out)
    index = 0 if options.index is None else whole_number("--index", options.index, 0, 10**6)

    from navrl.drawing.film import check_output, write
    from navrl.drawing.trajectory import drive, with_idle

    check_output(target)
    config, sim, [contender] = contest(options, [options.name])
    scenarios = scenario_list(options, sim, count=None, num_threads=threads(None), lengths=False)
    robots = with_idle(scenarios, index, sim)
    print(f"navrl: {contender.name} drives scenario {index} of {place(options, sim)}", file=sys.stderr)
    plans = list(contender.plans(robots, sim, config.planner))
    driver = contender.driver(robots, plans, sim, config.controllers, config.planner)
    trajectory = drive(driver, robots, sim, planned=plans[-1].path if plans else None)
    speed = write(trajectory, target, title=f"{contender.name} on {place(options, sim)}, scenario {index}")
    shown = "" if speed is None else f", shown {speed:.3g} times as fast"
    print(f"{target}: {trajectory.outcome} after {trajectory.steps * sim.task.period:.1f} s{shown}")
    return DONE
