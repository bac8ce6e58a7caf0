"""The robot, the world and the scenarios that a command's options ask for."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from navrl.commands.options import given_settings
from navrl.config.files import ConfigFile, load_config, load_sim
from navrl.errors import UserError

if TYPE_CHECKING:
    from navrl.comparing.contenders import Contender
    from navrl.config import Config, SimConfig
    from navrl.policy_description import PolicyDescription
    from navrl.scenarios import ScenarioList


def check_boxes(options: Namespace) -> None:
    """Refuses a number of boxes for a world that has none to count."""
    if options.boxes is not None and options.world != "boxes":
        raise UserError(f"--boxes {options.boxes}: goes with --world boxes")


def check_place(options: Namespace) -> None:
    """Refuses what goes with another world, or with a file of scenarios."""
    check_boxes(options)
    if options.skip_invalid and options.scenarios is None:
        raise UserError(f"{options.command}: --skip-invalid goes with --scenarios only")


def simulator(options: Namespace, policy: str, description: "PolicyDescription") -> "SimConfig":
    """The policy's robot in the world that was asked for: without one in that of the run, or in td3."""
    check_place(options)
    run = Path(policy) / "config.toml"
    if options.world is None and run.is_file():
        return description.sim_config(load_config(file=run).sim.world)
    return description.sim_config(load_sim(given_settings(options, "world", "boxes")).world)


def contest(options: Namespace, names: Sequence[str]) -> "tuple[Config, SimConfig, list[Contender]]":
    """Settings, the robot that all drive, and the contenders, at the level that was asked for.

    Robot, lidar, task and world are as configured, and if none of them is, those of the first policy, as `navrl eval`
    has them.
    """
    check_place(options)
    settings = given_settings(options, "world", "boxes")
    file = None if options.config is None else ConfigFile.read(options.config)
    config = load_config(file, robot=options.robot, level=options.level, options=settings)

    from navrl.comparing.contenders import enter
    from navrl.config.levels import at_level

    contenders = [enter(name) for name in names]
    sim = config.sim
    first = next((contender for contender in contenders if contender.policy is not None), None)
    tables = {option.key.partition(".")[0] for option in given_settings(options)}.union(file.tables if file else ())
    configured = options.robot or tables.intersection(table.name for table in fields(sim))
    if first is not None and first.policy is not None and not configured:
        sim = simulator(options, first.name.removesuffix(f"+{first.planner}"), first.policy.description)
        if options.level == "ideal" and at_level(sim, "real") == sim:
            raise UserError(f"{first.name}: was trained for --level real")
        sim = at_level(sim, options.level)
    for contender in contenders:
        contender.check(sim, options.level)
    return config, sim, contenders


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
    given = read_list(options.scenarios, sim, skip_invalid=options.skip_invalid, num_threads=num_threads)
    return given if count is None else given.first(count)
