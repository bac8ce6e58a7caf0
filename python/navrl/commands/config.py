"""`navrl config`: shows settings, or says whether a file holds valid ones."""

from argparse import Namespace

from navrl.commands.options import given_settings
from navrl.config.files import load_config, to_toml
from navrl.exit_codes import DONE


def show(options: Namespace) -> int:
    """Prints a complete configuration as TOML."""
    preset = "fast" if options.preset is None else options.preset
    sources = {"preset": preset, "robot": options.robot, "level": options.level}
    config = load_config(options.file, **sources, options=given_settings(options))
    print(to_toml(config), end="")
    return DONE


def check(options: Namespace) -> int:
    """Says that a file is valid; a refusal is the error."""
    load_config(options.file)
    print(f"{options.file}: valid")
    return DONE
