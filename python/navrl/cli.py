"""The command line: what may be typed, which command it calls, and how each ending is reported.

Results go to stdout, progress and errors to stderr. Nothing heavy is imported before a command needs it.
"""

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NoReturn

from navrl.errors import UserError
from navrl.exit_codes import DONE, INTERRUPTED, USER_MISTAKE

Settings = list[tuple[str, str]]
"""Configuration options as typed: key path and text of the value."""


class _Version(argparse.Action):
    """Prints the version; the package's metadata are read only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> NoReturn:  # noqa: ANN401
        import navrl

        print(f"navrl {navrl.__version__}")
        parser.exit()


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are exceptions of one line."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - as argparse declares it
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message: str) -> NoReturn:
        command = self.prog.removeprefix("navrl").strip()
        raise UserError(f"{command}: {message}" if command else message)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command.

    Args:
        arguments: as typed, without the name of the program; None takes them from the system.

    Returns:
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace", line_buffering=True)
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments))
    except UserError as error:
        print(f"navrl: {_printable(' '.join(str(error).splitlines()))}", file=sys.stderr)
        return USER_MISTAKE
    except KeyboardInterrupt as interruption:
        if not str(interruption):  # training has said what it saved
            print("navrl: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone, as `head` does: nothing is left to say, not even at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:
        # A name that is too long, a full disk behind stdout, which has no name: the system's word, in one line.
        file = "output" if error.filename is None else error.filename
        print(f"navrl: {file}: {error.strerror or error}", file=sys.stderr)
        return USER_MISTAKE


def _printable(text: str) -> str:
    """The text with escapes for control characters, which files may hold and terminals obey."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _run(arguments: list[str]) -> int:
    typed, settings = _split_settings(arguments)
    parser = _parser()
    options, unknown = parser.parse_known_args(typed)
    command = options.command
    if unknown:
        raise UserError(_unexpected(parser, command, unknown[0]))
    if settings and not options.takes_settings:
        raise UserError(f"{command}: --{settings[0][0]}: this command takes no configuration keys")
    options.settings = settings
    options.typed = shlex.join(["navrl", *arguments])
    # The module that runs a command brings what the others do without.
    module, _, function = options.run.partition(":")
    code: int = getattr(import_module(f"navrl.commands.{module}"), function)(options)
    return code


def _split_settings(arguments: list[str]) -> tuple[list[str], Settings]:
    """Takes the options `--KEY.PATH VALUE` and `--KEY.PATH=VALUE` out of what was typed."""
    typed: list[str] = []
    settings: Settings = []
    rest = iter(arguments)
    for argument in rest:
        if argument == "--":
            return [*typed, argument, *rest], settings
        key, equals, value = argument.removeprefix("--").partition("=")
        if not argument.startswith("--") or "." not in key:
            typed.append(argument)
        elif equals:
            settings.append((key, value))
        else:
            following = next(rest, None)
            if following is None or following.startswith("--"):
                raise UserError(f"--{key}: expects a value")
            settings.append((key, following))
    return typed, settings


def _unexpected(parser: argparse.ArgumentParser, command: str, word: str) -> str:
    if not word.startswith("-"):
        return f"{command}: unexpected argument {word!r}"
    flag = word.partition("=")[0]
    near = get_close_matches(flag, _flags(parser, command), n=1)
    hint = f"; did you mean {near[0]}?" if near else f"; see navrl {command} --help"
    return f"{command}: {flag}: no such option{hint}"


def _flags(parser: argparse.ArgumentParser, command: str) -> list[str]:
    """The options of a command such as `config show`."""
    for word in command.split():
        choices = [action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
        parser = dict(choices[0])[word]
    return [flag for action in parser._actions for flag in action.option_strings]


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="navrl",
        description="Train a mobile robot with a lidar to reach goals without collisions.",
        epilog="POLICY is a run folder, a policy folder or `default`, the policy that comes with navrl.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)
    _add_train(commands)
    _add_eval(commands)
    _add_play(commands)
    _add_bench(commands)
    _add_compare(commands)
    _add_tune(commands)
    _add_config(commands)
    doctor = commands.add_parser("doctor", help="versions, processor, and a self-test of a few seconds")
    doctor.set_defaults(command="doctor", run="doctor:doctor", takes_settings=False)
    return parser


def _add_train(commands: Any) -> None:  # noqa: ANN401 - argparse hides the type
    train = commands.add_parser(
        "train",
        help="train a policy, test it and save it",
        epilog="Every setting of docs/configuration.md can be given as --KEY.PATH VALUE, such as --learner.tau 0.01.",
    )
    train.set_defaults(command="train", run="train:train", takes_settings=True)
    train.add_argument("--preset", metavar="P", help="fast (default) or paper")
    _add_robot(train)
    _add_level(train, default=None)
    train.add_argument("--world", metavar="W", help="td3, boxes or a world file (.json)")
    seeds = train.add_mutually_exclusive_group()
    seeds.add_argument("--seed", metavar="K", help="seed of every random stream (default 0)")
    seeds.add_argument("--seeds", metavar="K0,K1,..", help="several runs, one after the other")
    length = train.add_mutually_exclusive_group()
    length.add_argument("--steps", metavar="N", help="environment steps; with --resume the new total")
    length.add_argument("--episodes", metavar="N", help="episodes")
    train.add_argument("--until", metavar="X", help="stop once two validations in a row reach this success rate")
    train.add_argument("--algorithm", metavar="A", help="td3 or ddpg")
    train.add_argument("--init", metavar="POLICY", help="start from this policy's actor")
    train.add_argument("--no-test", action="store_true", help="skip the test after training")
    train.add_argument("--out", metavar="DIR", help="folder of the run, new or empty (default: one in runs/)")
    train.add_argument("--resume", metavar="DIR", help="continue the run in DIR")
    train.add_argument("--inexact", action="store_true", help="with --resume: also where bitwise is impossible")


def _add_robot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", metavar="R", help="turtlebot3_burger or turtlebot3_waffle")
    parser.add_argument("--config", metavar="F.toml", help="settings from a file")


def _add_scenarios(parser: argparse.ArgumentParser) -> None:
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--world", metavar="W", help="td3, boxes or a file (.json); default: the run's, or td3")
    where.add_argument("--scenarios", metavar="F.jsonl", help="scenarios from a file, one in each line")
    parser.add_argument("--boxes", metavar="K", help="number of boxes of the world boxes")
    parser.add_argument("--list", choices=("validation", "test", "final"), help="built-in list (default test)")
    parser.add_argument("--skip-invalid", action="store_true", help="leave out scenarios that cannot be run")


def _add_level(parser: argparse.ArgumentParser, default: str | None = "ideal") -> None:
    parser.add_argument("--level", choices=("ideal", "real"), default=default, help="ideal (default) or real")


def _add_eval(commands: Any) -> None:  # noqa: ANN401 - argparse hides the type
    parser = commands.add_parser("eval", help="measure a policy on a fixed list of scenarios")
    parser.set_defaults(command="eval", run="evaluate:evaluate", takes_settings=False)
    parser.add_argument("policy", metavar="POLICY", help="run folder, policy folder or default")
    _add_scenarios(parser)
    parser.add_argument("--episodes", metavar="N", help="only the first N scenarios")
    parser.add_argument("--brake", metavar="M", help="slow down for what would come nearer than M metres, as 0.02")
    parser.add_argument("--threads", metavar="N", help="threads (default: all cores); never changes results")
    parser.add_argument("--json", metavar="F", help="write scores and episodes to F")


def _add_play(commands: Any) -> None:  # noqa: ANN401 - argparse hides the type
    parser = commands.add_parser(
        "play",
        help="draw an episode: room, path, lidar rays",
        epilog="NAME is any contender of navrl compare, and its options give the episode that it measures.",
    )
    parser.set_defaults(command="play", run="play:play", takes_settings=True)
    parser.add_argument("name", metavar="NAME", nargs="?", default="default", help="default: the policy that ships")
    _add_scenarios(parser)
    _add_level(parser)
    _add_robot(parser)
    parser.add_argument("--index", metavar="I", help="which scenario of the list (default 0)")
    parser.add_argument("--out", metavar="F", required=True, help="picture or film to write: .png, .gif or .mp4")


def _add_bench(commands: Any) -> None:  # noqa: ANN401 - argparse hides the type
    parser = commands.add_parser("bench", help="measure the simulator's speed with random actions")
    parser.set_defaults(command="bench", run="bench:bench", takes_settings=False)
    parser.add_argument("--world", metavar="W", default="open8", help="open8 (default), td3, boxes, walls or mixed")
    parser.add_argument("--num-envs", metavar="N", default="256", help="robots (default 256)")
    parser.add_argument("--beams", metavar="N", help="beams of the lidar (default 180)")
    parser.add_argument("--threads", metavar="N", help="threads (default: all cores)")
    parser.add_argument("--noise", metavar="S", help="lidar noise (default 0.008 m)")
    parser.add_argument("--json", metavar="F", help="write the figures to F")


def _add_compare(commands: Any) -> None:  # noqa: ANN401 - argparse hides the type
    parser = commands.add_parser(
        "compare",
        help="measure policies, controllers and planners side by side",
        epilog="The same command continues a comparison; more contenders may be named. Settings: --KEY.PATH VALUE.",
    )
    parser.set_defaults(command="compare", run="compare:compare", takes_settings=True)
    parser.add_argument(
        "names",
        metavar="NAME",
        nargs="+",
        help="POLICY, dwa, dwa-1997, apf, gap, mppi, straight, random, or one of these or pursuit with a planner that"
        " leads it on the map, such as pursuit+astar, default+astar, dwa+rrt",
    )
    _add_scenarios(parser)
    _add_level(parser)
    parser.add_argument("--episodes", metavar="N", help="only the first N scenarios")
    _add_robot(parser)
    parser.add_argument("--threads", metavar="N", help="threads (default: all cores); never changes results")
    parser.add_argument("--out", metavar="DIR", required=True, help="folder of the comparison, new or its own")


def _add_tune(commands: Any) -> None:  # noqa: ANN401 - argparse hides the type
    parser = commands.add_parser(
        "tune",
        help="find settings of a classical controller on the tuning list",
        epilog="The same command continues a search. Settings that are not searched: --KEY.PATH VALUE.",
    )
    parser.set_defaults(command="tune", run="tune:tune", takes_settings=True)
    parser.add_argument(
        "name",
        metavar="NAME",
        help="dwa, apf, gap or mppi, or one of these or pursuit with a planner, such as pursuit+astar",
    )
    parser.add_argument("--world", metavar="W", help="td3 (default), boxes, walls, mixed or a world file (.json)")
    parser.add_argument("--boxes", metavar="K", help="number of boxes of the world boxes")
    _add_robot(parser)
    _add_level(parser)
    parser.add_argument("--trials", metavar="N", default="100", help="budget (default 100)")
    parser.add_argument("--episodes", metavar="N", default="500", help="scenarios of a trial (default 500)")
    parser.add_argument("--seed", metavar="K", default="0", help="seed of the search (default 0)")
    parser.add_argument("--threads", metavar="N", help="threads (default: all cores); never changes results")
    parser.add_argument("--out", metavar="DIR", help="folder of the search, new or its own (default: in runs/)")


def _add_config(commands: Any) -> None:  # noqa: ANN401 - argparse hides the type
    config = commands.add_parser("config", help="show or check settings")
    actions = config.add_subparsers(metavar="ACTION", required=True, parser_class=_Parser)
    show = actions.add_parser("show", help="print the complete configuration that FILE and options give")
    show.set_defaults(command="config show", run="config:show", takes_settings=True)
    show.add_argument("file", metavar="FILE", nargs="?", help="TOML file")
    show.add_argument("--preset", metavar="P", help="fast (default) or paper")
    show.add_argument("--robot", metavar="R", help="turtlebot3_burger or turtlebot3_waffle")
    _add_level(show)
    check = actions.add_parser("check", help="say whether FILE is a valid configuration")
    check.set_defaults(command="config check", run="config:check", takes_settings=False)
    check.add_argument("file", metavar="FILE", help="TOML file")


if __name__ == "__main__":
    sys.exit(main())
