"""The page docs/configuration.md, written from the configuration classes: `python -m navrl.config.reference FILE`."""

import ast
import inspect
import sys
import tomllib
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import get_type_hints

from navrl.config import Config
from navrl.config.files import ROBOTS, to_toml
from navrl.config.levels import REAL
from navrl.config.ranges import allowed

_INTRODUCTION = """\
# Configuration

<!-- Written by `python -m navrl.config.reference docs/configuration.md` from python/navrl/config/tree.py. -->

A run is described by the tables below. Each value comes from the last of these that names it:

1. the defaults, which are the preset `fast`;
2. `--preset paper`: the paper's way, which lists only what differs;
3. `--robot NAME`: the shape, limits and lidar of a robot on the market;
4. `--level real`: what was found for controllers and planners at that level, below;
5. `--config FILE.toml`;
6. options such as `--learner.tau 0.01`, whose value is read as a TOML value (a bare word is a string).

What the level real itself sets, of robot and lidar, counts before a file's and can be given in no option.
`navrl config show` prints the complete configuration that the same options would give, `navrl config check FILE` says
whether a file is valid. A run stores its own as `config.toml`, from which it can be repeated. Whatever cannot be used
is refused before any work, in one line that names the file or option, the key, its value and what is allowed.
Units are SI, angles in radians; sections and equations are those of the paper (equations.md).
A world file that is named in a configuration file counts from the folder of that file.
"""

_COMBINATIONS = """\
## Settings that exclude each other

These are refused too:

- `world.goal_range_max` below `goal_range_start`, or a `goal_range_start` so small that the world has no goals so near
  ("td3", "open8" and "walls" up to 0.7071, "boxes" and "mixed" up to 1.4142);
- `lidar.range_min` at or above `range_max`; more `lidar.bins` than `beams`;
- a `task.time_limit` of less than half a period or more than 1,000,000 periods;
- `task.sensor_range` outside the lidar's ranges, with the collision rule "sensor";
- `training.steps` and `training.episodes` both 0; `update_schedule = "per_episode"` with more than one robot;
- `exploration.sigma_min` above `sigma_max` ("spread"), `sigma_end` above `sigma_start` ("linear"); with forced actions,
  `forced_steps_min` above `forced_steps_max`, or a `forced_range` that the lidar cannot measure;
- `replay.capacity` below `learner.batch_size`, or below the rows that one step may add:
  num_envs x (n_step + delayed_steps);
- `learner.mirror` with a lidar that is not symmetric: mounted off the robot's x axis or turned, or with a beam exactly
  between two bins.
"""


def reference() -> str:
    """The whole page as Markdown."""
    tables = get_type_hints(Config)
    sections = [_section(table.name, tables[table.name]) for table in fields(Config)]
    return "\n".join([_INTRODUCTION, *sections, _COMBINATIONS, _level(), _robots()])


def _section(table: str, cls: type) -> str:
    defaults = _written(Config())
    paper = _preset("paper")
    rows = ["| key | default | preset paper | allowed | meaning |", "|---|---|---|---|---|"]
    for name, meaning in _docstrings(cls).items():
        key = f"{table}.{name}"
        other = f"`{paper[key]}`" if key in paper else ""
        rows.append(f"| `{name}` | `{defaults[key]}` | {other} | {allowed(Config, key)} | {meaning} |")
    return f"## [{table}]\n\n{inspect.getdoc(cls)}\n\n" + "\n".join(rows) + "\n"


def _level() -> str:
    conditions = _flat(REAL)
    found = _preset("real")
    rows = ["| key | level real |", "|---|---|"]
    rows += [f"| `{key}` | `{value}` |" for key, value in {**conditions, **found}.items()]
    text = "Robot and lidar are what the level is; python/navrl/presets/real.toml says how the others were found."
    return f"## Level real\n\n{text}\n\n" + "\n".join(rows) + "\n"


def _robots() -> str:
    presets = {robot: _preset(robot) for robot in ROBOTS}
    keys = dict.fromkeys(key for preset in presets.values() for key in preset)
    rows = [f"| key | {' | '.join(ROBOTS)} |", "|---" * (len(ROBOTS) + 1) + "|"]
    for key in keys:
        values = (f"`{preset[key]}`" if key in preset else "" for preset in presets.values())
        rows.append(f"| `{key}` | {' | '.join(values)} |")
    text = "The files python/navrl/presets/ROBOT.toml give the source of each number."
    return f"## Robots\n\n{text}\n\n" + "\n".join(rows) + "\n"


def _docstrings(cls: type) -> dict[str, str]:
    """The text under each field of a configuration class, by its name."""
    (definition,) = ast.parse(inspect.getsource(cls)).body
    assert isinstance(definition, ast.ClassDef)
    texts: dict[str, str] = {}
    for field, text in zip(definition.body, definition.body[1:], strict=False):
        match field, text:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                texts[name] = " ".join(words.split())
    return texts


def _written(tree: Config) -> dict[str, str]:
    """Every value of a configuration as a file has it, by key path."""
    return _flat(tomllib.loads(to_toml(tree)))


def _preset(name: str) -> dict[str, str]:
    return _flat(tomllib.loads(files("navrl").joinpath("presets", f"{name}.toml").read_text(encoding="utf-8")))


def _flat(tables: dict[str, dict[str, object]]) -> dict[str, str]:
    return {
        f"{table}.{key}": f'"{value}"'
        if isinstance(value, str)
        else str(value).lower()
        if isinstance(value, bool)
        else str(value)
        for table, content in tables.items()
        for key, value in content.items()
    }


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(reference(), encoding="utf-8")
