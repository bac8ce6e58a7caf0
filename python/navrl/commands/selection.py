"""The robot, the world and the scenarios that a command's options ask for."""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from navrl.commands.options import given_settings
from navrl.config.files import load_config, load_sim
from navrl.errors import UserError

if TYPE_CHECKING:
    from navrl.config import SimConfig
    from navrl.policy_description import PolicyDescription
    from navrl.scenarios import ScenarioList


def check_boxes(options: Namespace) -> None:
    """Refuses a number of boxes for a world that has none to count."""
    if options.boxes is not None and options.world != "boxes":
        raise UserError(f"--boxes {options.boxes}: goes with --world boxes")


def simulator(options: Namespace, policy: str, description: "PolicyDescription") -> "SimConfig":
    """The policy's robot in the world that was asked for: without one in that of the run, or in td3."""
    check_boxes(options)
    run = Path(policy) / "config.toml"
    if options.world is None and run.is_file():
        return description.sim_config(load_config(file=run).sim.world)
    return description.sim_config(load_sim(given_settings(options, "world", "boxes")).world)


def place(options: Namespace, sim: "SimConfig") -> str:
    """World or file as typed."""
    return str(options.scenarios or options.world or sim.world.name)


def scenario_list(
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
