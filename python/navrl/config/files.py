"""Configurations from files, presets and options, and back to TOML.

Precedence: defaults < preset < robot preset < settings found for the level < file < options < what the level is. Every
refusal is one line that names the source, the key, its value and what is allowed, and the nearest valid name for one
that is unknown.
"""

import json
import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any, Self, TypeVar, get_type_hints

from navrl.config import WORLDS, Config, SimConfig
from navrl.config.faults import meant, out_of_range, unknown_key, unknown_table
from navrl.config.levels import LEVELS, REAL, Level, at_level
from navrl.config.ranges import keys
from navrl.errors import ConfigError, SettingError, shown

ROBOTS = ("turtlebot3_burger", "turtlebot3_waffle")
PRESETS = ("fast", "paper", *ROBOTS)
AS_DEFAULTS = ("fast", "ideal")
"""What the defaults are."""
LARGEST_FILE = 1 << 20

_Tree = TypeVar("_Tree", Config, SimConfig)
_TABLES = get_type_hints(Config)
_KEYS = keys(Config)


@dataclass(frozen=True)
class Option:
    """A setting given on the command line."""

    flag: str
    """The option as the user typed it, such as ``--seed``."""
    key: str
    """Key path, such as ``training.seed``."""
    text: str
    """Its value, read as a TOML value; anything else is a string."""


@dataclass(frozen=True)
class _Layer:
    """Settings of one source: values by key path."""

    source: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class ConfigFile:
    """A TOML file that has been read: what it holds can be asked for more than once, also where it is a pipe."""

    path: str
    """As it was named."""
    tables: Mapping[str, Any]
    """What it sets, by table; not checked yet."""

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Reads a file.

        Raises:
            ConfigError: one line on a file that cannot be read or is no TOML.
        """
        return cls(os.fspath(path), _read(Path(path)))


def load_config(
    file: str | os.PathLike[str] | ConfigFile | None = None,
    *,
    preset: str = "fast",
    robot: str | None = None,
    level: Level = "ideal",
    options: Sequence[Option] = (),
) -> Config:
    """Builds the configuration of a run from its sources.

    Args:
        file: TOML file, perhaps read already; a relative world file in it counts from its folder.
        preset: one of PRESETS.
        robot: one of ROBOTS: the shape, limits and lidar of a robot on the market.
        level: conditions under which the robot drives; they count before a file's. Settings of controllers and
            planners that were found for the level stand behind the file's.
        options: settings of the command line; the last of several for one key counts.

    Returns:
        The complete, checked configuration.

    Raises:
        ConfigError: one line on the first setting that cannot be used.
    """
    layers = [*_preset(preset, PRESETS, "preset")]
    if robot is not None:
        layers += _preset(robot, ROBOTS, "robot")
    layers += _preset(level, LEVELS, "level")
    if file is not None:
        given = file if isinstance(file, ConfigFile) else ConfigFile.read(file)
        layers.append(_layer(given.path, given.tables, folder=Path(given.path).parent))
    layers += (_option(option) for option in options)
    if level == "real":
        fixed = {f"{table}.{key}" for table, values in REAL.items() for key in values}
        for option in options:
            if option.key in fixed:
                raise ConfigError("is set by --level real", source=option.flag)
    return at_level(_build(Config, layers), level)


def load_sim(options: Sequence[Option]) -> SimConfig:
    """Builds the part that the simulator reads from its defaults and options.

    Args:
        options: settings of its five tables.

    Returns:
        The complete, checked configuration of a simulator.

    Raises:
        ConfigError: one line on the first setting that cannot be used.
    """
    return _build(SimConfig, [_option(option) for option in options])


def to_toml(config: Config) -> str:
    """The complete configuration as TOML: table headers and one `key = value` a line; reads back to an equal one."""
    return tables_to_toml(asdict(config))


def tables_to_toml(tables: Mapping[str, Mapping[str, object]]) -> str:
    """Settings by table and key as TOML."""
    blocks = [
        f"[{table}]\n" + "".join(f"{key} = {_toml(value)}\n" for key, value in values.items())
        for table, values in tables.items()
    ]
    return "\n".join(blocks)


def _toml(value: object) -> str:
    if isinstance(value, str):
        # TOML's basic strings are JSON's, except that DEL must be escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
        if len(raw) > LARGEST_FILE:
            raise ConfigError(f"is larger than {LARGEST_FILE:_} bytes", source=str(path))
        text = raw.decode("utf-8-sig")
        return tomllib.loads(text)
    except OSError as error:
        raise ConfigError(_reason(error), source=str(path)) from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"line {line}: not UTF-8 text", source=str(path)) from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(_syntax(str(error), text), source=str(path)) from error
    except (ValueError, RecursionError) as error:
        raise ConfigError("not valid TOML: a number is too long or lists are too deep", source=str(path)) from error


def _reason(error: OSError) -> str:
    if isinstance(error, FileNotFoundError):
        return "no such file"
    if isinstance(error, IsADirectoryError):
        return "is a folder, not a file"
    return f"cannot be read: {(error.strerror or 'unknown reason').lower()}"


def _syntax(message: str, text: str) -> str:
    # tomllib says "Expected '=' after a key (at line 3, column 5)" or "... (at end of document)": the place goes first.
    fault, _, place = message.partition(" (at ")
    place = place.rstrip(")") if place.startswith("line") else f"line {text.count(chr(10)) + 1}"
    return f"{place}: not valid TOML: {fault[:1].lower()}{fault[1:]}"


def _preset(name: str, names: Sequence[str], kind: str) -> Iterator[_Layer]:
    if name not in names:
        hint = meant(get_close_matches(name, names, n=1))
        raise ConfigError(f"{shown(name)}: must be one of {', '.join(names)}{hint}", source=f"--{kind}")
    if name not in AS_DEFAULTS:
        text = files("navrl").joinpath("presets", f"{name}.toml").read_text(encoding="utf-8")
        yield _layer(f"{kind} {name}", tomllib.loads(text))


def _layer(source: str, tables: Mapping[str, Any], folder: Path | None = None) -> _Layer:
    values: dict[str, Any] = {}
    for table, content in tables.items():
        if table not in _TABLES:
            raise ConfigError(unknown_table(table), source=source)
        if not isinstance(content, dict):
            raise ConfigError(f"{table} = {shown(content)}: must be a table, [{table}]", source=source)
        for name, value in content.items():
            key = f"{table}.{name}"
            if key not in _KEYS:
                raise ConfigError(unknown_key(table, name), source=source)
            values[key] = value
    world = values.get("world.name")
    if isinstance(world, str) and world not in WORLDS:
        values["world.name"] = os.path.abspath((folder or Path()) / world) if world.endswith(".json") else world
    return _Layer(source, values)


def _option(option: Option) -> _Layer:
    table, _, name = option.key.partition(".")
    return _layer(option.flag, {table: {name: _value(option.text)}})


def _value(text: str) -> Any:  # noqa: ANN401 - any TOML value
    """The text of an option as a TOML value; what is none is a string."""
    if "\n" in text or "\r" in text:
        return text
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def _build(tree: type[_Tree], layers: Sequence[_Layer]) -> _Tree:
    values: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for layer in layers:
        values.update(layer.values)
        sources.update(dict.fromkeys(layer.values, layer.source))
    tables: dict[str, Any] = {}
    faults: list[str] = []
    for field in fields(tree):
        given = {key.partition(".")[2]: value for key, value in values.items() if key.startswith(f"{field.name}.")}
        try:
            tables[field.name] = _TABLES[field.name](**given)
        except SettingError as error:
            faults += (f"{sources[key]}: {out_of_range(key, values[key])}" for key in error.keys)
    if faults:
        raise ConfigError(faults[0] + (f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""))
    try:
        return tree(**tables)
    except ConfigError as error:
        # The last source that has a say in the clash is the one to look at.
        at_fault = dict.fromkeys(error.keys)
        source = next((layer.source for layer in reversed(layers) if at_fault.keys() & layer.values.keys()), "")
        raise ConfigError(error.fault, keys=error.keys, source=source) from None
