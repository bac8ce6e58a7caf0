"""`navrl train`: checks everything that the user may have got wrong, then trains."""

import os
import sys
import time
from argparse import Namespace
from pathlib import Path

from navrl.commands.options import given_settings, whole_number
from navrl.config import WORLDS, Config
from navrl.config.files import Option, load_config
from navrl.errors import UserError
from navrl.exit_codes import DONE, NOT_FINITE

FIXED_BY_RUN = (
    *("preset", "robot", "level", "config", "world", "seed", "seeds", "episodes", "until", "algorithm", "init", "out"),
)
"""Options that a resumed run has no use for."""
CUT_OFF_TOLD = 0.005
"""Share of a world file's free area that is told about when no way leads there."""
FIRST_DRAWS = 8
"""Scenarios drawn before the learner is loaded, to see whether the world has room."""


def train(options: Namespace) -> int:
    """Trains a policy for each seed, one after the other, or continues a run."""
    if options.resume is not None:
        return _resume(options)
    if options.inexact:
        raise UserError("train: --inexact goes with --resume only")
    preset = "fast" if options.preset is None else options.preset
    configs = _configs(options, preset)
    folders = _folders(options.out, preset, configs, several=options.seeds is not None)
    if options.init is not None:
        _check_policy(options.init, configs[0])
    _check_world(configs[0])
    for config, folder in zip(configs, folders, strict=True):
        where = f"{options.world or config.world.name}, preset {preset}, seed {config.training.seed}"
        print(f"navrl: training on {where}; run folder {folder}", file=sys.stderr)
        from navrl.running import session

        try:
            session.train(config, folder, preset=preset, init=options.init, test=not options.no_test)
        except session.NonFiniteError as error:
            print(f"navrl: {error}", file=sys.stderr)
            return NOT_FINITE
    return DONE


def _resume(options: Namespace) -> int:
    extra = [name for name in FIXED_BY_RUN if getattr(options, name) is not None]
    extra += [key for key, _ in options.settings] + ["no-test"] * options.no_test
    if extra:
        raise UserError(f"train: --{extra[0]}: a resumed run keeps its settings; --steps N extends it")
    steps = None if options.steps is None else whole_number("--steps", options.steps, 1, 10**12)
    folder = Path(options.resume)
    if not folder.is_dir():
        raise UserError(f"--resume {folder}: no such run folder")
    print(f"navrl: resuming the run in {folder}", file=sys.stderr)
    from navrl.running import session

    try:
        session.resume(folder, steps=steps, inexact=options.inexact)
    except session.NonFiniteError as error:
        print(f"navrl: {error}", file=sys.stderr)
        return NOT_FINITE
    return DONE


def _configs(options: Namespace, preset: str) -> list[Config]:
    """One configuration for each seed, all checked."""
    settings = given_settings(options, "world", "algorithm", "steps", "episodes", "until")
    flag = "--seeds" if options.seeds is not None else "--seed"
    seeds = options.seeds.split(",") if options.seeds is not None else [options.seed]
    configs = []
    for text in seeds:
        seed = [] if text is None else [Option(flag, "training.seed", text.strip())]
        sources = {"preset": preset, "robot": options.robot, "level": options.level or "ideal"}
        configs.append(load_config(options.config, **sources, options=[*settings, *seed]))
    distinct = {config.training.seed for config in configs}
    if len(distinct) < len(configs):
        raise UserError(f"--seeds {options.seeds}: a seed stands there twice")
    return configs


def _folders(out: str | None, preset: str, configs: list[Config], *, several: bool) -> list[Path]:
    """The folder of each run; none of them exists or holds anything."""
    first = configs[0]
    if out is None:
        world = Path(first.world.name).stem
        seed = "seeds" if several else f"seed{first.training.seed}"
        folder = _unused(Path("runs") / f"{world}-{preset}-{seed}-{time.strftime('%Y%m%d-%H%M%S')}")
    else:
        folder = Path(out)
        if folder.is_dir() and any(folder.iterdir()):
            run = (
                f"; to continue the run there: navrl train --resume {out}" if (folder / "checkpoints").is_dir() else ""
            )
            raise UserError(f"--out {out}: is not empty{run}")
    above = next(path for path in (folder, *folder.parents) if path.exists())
    if not (above.is_dir() and os.access(above, os.W_OK | os.X_OK)):
        reason = "cannot be written to" if above.is_dir() else "is not a folder"
        raise UserError(f"--out {folder}: {above} {reason}")
    return [folder / f"seed-{config.training.seed}" for config in configs] if several else [folder]


def _unused(folder: Path) -> Path:
    """The folder, or the first of its name with -2, -3 ... that does not exist."""
    names = (folder if number == 1 else folder.with_name(f"{folder.name}-{number}") for number in range(1, 1000))
    return next(name for name in names if not name.exists())


def _check_policy(path: str, config: Config) -> None:
    """Refuses a first policy that cannot be loaded or does not fit, before the learner is loaded."""
    from navrl.policy import load_policy
    from navrl.policy_description import PolicyDescription

    PolicyDescription.from_config(config).check_first(load_policy(path).description)


def _check_world(config: Config) -> None:
    """Refuses a world that cannot be read, is too narrow for the robot or too full, before the learner is loaded."""
    from navrl import _navsim
    from navrl.batch import config_json, draw_list

    try:
        cut_off = _navsim.check_world(config_json(config.sim))
        draw_list(config.sim, "train", FIRST_DRAWS, seed=config.training.seed)
    except ValueError as error:
        raise UserError(str(error)) from error
    if config.world.name not in WORLDS and cut_off > CUT_OFF_TOLD:
        print(
            f"navrl: {config.world.name}: no way leads to {100 * cut_off:.0f} % of the free area for a robot of this "
            "size; starts and goals are drawn in the largest connected part only",
            file=sys.stderr,
        )
