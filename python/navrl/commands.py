"""What the commands other than `train` do once their options are read."""

import sys
from argparse import Namespace
from typing import TYPE_CHECKING

from navrl.cli import DONE, INTERNAL_ERROR
from navrl.command_options import given_settings, output_file, threads, whole_number
from navrl.config_files import Option, load_config, load_sim, to_toml
from navrl.errors import UserError

if TYPE_CHECKING:
    from navrl.config import SimConfig
    from navrl.policy_description import PolicyDescription
    from navrl.scenarios import ScenarioList


def evaluate(options: Namespace) -> int:
    """Measures a policy on a list of scenarios."""
    target = None if options.json is None else output_file("--json", options.json)
    num_threads = threads(options.threads)
    count = None if options.episodes is None else whole_number("--episodes", options.episodes, 1, 10**6)
    if options.skip_invalid and options.scenarios is None:
        raise UserError("eval: --skip-invalid goes with --scenarios only")

    from navrl.policy import load_policy

    policy = load_policy(options.policy)
    sim = _simulator(options, policy.description)
    print(f"navrl: evaluating {options.policy} on {_place(options, sim)}", file=sys.stderr)

    from rich.console import Console

    from navrl import evaluate as run
    from navrl.evaluate import print_scores, write_json

    scenarios = _list(options, sim, count=count, num_threads=num_threads)
    evaluation = run(policy, scenarios, sim=sim, num_threads=num_threads)
    if target is not None:
        write_json(target, evaluation, options.policy)
    print_scores(evaluation.summary, options.policy, _place(options, sim), Console())
    return DONE


def play(options: Namespace) -> int:
    """Draws one episode as a picture or a film."""
    target = output_file("--out", options.out)
    index = 0 if options.index is None else whole_number("--index", options.index, 0, 10**6)

    from navrl.play import check_output, drive, write
    from navrl.policy import load_policy

    check_output(target)
    policy = load_policy(options.policy)
    sim = _simulator(options, policy.description)
    print(f"navrl: {options.policy} drives scenario {index} of {_place(options, sim)}", file=sys.stderr)
    scenarios = _list(options, sim, count=None, num_threads=threads(None), lengths=False)
    trajectory = drive(policy, scenarios, index, sim)
    write(trajectory, target, title=f"{options.policy} on {_place(options, sim)}, scenario {index}")
    print(f"{target}: {trajectory.outcome} after {trajectory.steps * sim.task.period:.1f} s")
    return DONE


def bench(options: Namespace) -> int:
    """Measures the simulator's speed."""
    num_envs = whole_number("--num-envs", options.num_envs, 1, 65536)
    num_threads = threads(options.threads)
    target = None if options.json is None else output_file("--json", options.json)
    settings = given_settings(options, "world", "noise")
    usual = load_sim([]).lidar
    beams = usual.beams if options.beams is None else whole_number("--beams", options.beams, 1, 4096)
    # Every bin needs a beam: with fewer beams than the usual bins there is one bin for each.
    bins = min(beams, usual.bins)
    lidar = [Option("--beams", "lidar.beams", str(beams)), Option("--beams", "lidar.bins", str(bins))]
    config = load_sim([*settings, *lidar])
    print(f"navrl: stepping {num_envs} robots in {config.world.name} for some seconds", file=sys.stderr)

    from navrl._navsim import isa
    from navrl.bench import measure, write_json

    speed = measure(config, num_envs=num_envs, num_threads=num_threads)
    print(
        f"{config.world.name}: {speed.median:,.0f} steps/s (min {speed.minimum:,.0f}, max {speed.maximum:,.0f}); "
        f"{num_envs} robots, {beams} beams, noise {config.lidar.noise} m, threads {num_threads}, {isa()}"
    )
    if target is not None:
        write_json(target, config, speed, num_envs=num_envs, num_threads=num_threads)
    return DONE


def show_config(options: Namespace) -> int:
    """Prints a complete configuration as TOML."""
    settings = given_settings(options)
    print(
        to_toml(load_config(options.file, preset=options.preset or "fast", robot=options.robot, options=settings)),
        end="",
    )
    return DONE


def check_config(options: Namespace) -> int:
    """Says that a file is valid; a refusal is the error."""
    load_config(options.file)
    print(f"{options.file}: valid")
    return DONE


def doctor(_: Namespace) -> int:
    """Examines the installation."""
    from navrl.doctor import examine

    return DONE if examine() else INTERNAL_ERROR


def _simulator(options: Namespace, description: "PolicyDescription") -> "SimConfig":
    """The policy's robot in the world that was asked for."""
    if options.boxes is not None and options.world != "boxes":
        raise UserError(f"--boxes {options.boxes}: goes with --world boxes")
    return description.sim_config(load_sim(given_settings(options, "world", "boxes")).world)


def _place(options: Namespace, sim: "SimConfig") -> str:
    """World or file as typed."""
    return str(options.scenarios or options.world or sim.world.name)


def _list(
    options: Namespace, sim: "SimConfig", *, count: int | None, num_threads: int, lengths: bool = True
) -> "ScenarioList":
    """The scenarios that were asked for: those of a file, or a built-in list, perhaps without its shortest paths."""
    from navrl.scenarios import load_list, read_list

    if options.scenarios is None:
        return load_list(sim, options.list or "test", count=count, num_threads=num_threads, lengths=lengths)
    if options.list is not None:
        raise UserError(f"--list {options.list}: goes with a world, not with --scenarios")
    skip = getattr(options, "skip_invalid", False)
    given = read_list(options.scenarios, sim, skip_invalid=skip, num_threads=num_threads)
    return given if count is None else given.first(count)
