"""`navrl config`: shows settings, or says whether a file holds valid ones."""

from argparse import Namespace

from navrl.cli import DONE
from navrl.commands.options import given_settings
from navrl.config.files import load_config, to_toml


def show(options: Namespace) -> int:
    """Prints a complete configuration as TOML."""
    settings = given_settings(options)
    print(
        to_toml(load_config(options.file, preset=options.preset or "fast", robot=options.robot, options=settings)),
        end="",
    )
    return DONE


def check(options: Namespace) -> int:
    """Says that a file is valid; a refusal is the error."""
    load_config(options.file)
    print(f"{options.file}: valid")
    return DONE
