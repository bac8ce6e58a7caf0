"""What is wrong with a setting, in one line: its key, its value, what is allowed, and the nearest valid name.

@one_line        a table of the configuration that refuses with such a line, for those who make it in Python
"""

from collections.abc import Callable, Sequence
from dataclasses import fields
from difflib import get_close_matches
from functools import wraps
from typing import Any, TypeVar, get_type_hints

from pydantic import ConfigDict, ValidationError

from navrl.config.ranges import allowed, choices, keys
from navrl.errors import SettingError, shown

LONGEST_KEY = 60
STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
"""How tables are validated: no unknown key, no other type, no infinity."""

_Table = TypeVar("_Table")


def one_line(table: type[_Table]) -> type[_Table]:
    """Lets a validated dataclass refuse with a `SettingError` where pydantic has several lines."""
    checked: Callable[..., None] = table.__init__

    @wraps(checked)
    def init(self: _Table, *values: Any, **named: Any) -> None:  # noqa: ANN401 - any value may be given
        try:
            checked(self, *values, **named)
        except ValidationError as error:
            raise _refusal(table, error, values, named) from None

    table.__init__ = init  # type: ignore[assignment]
    return table


def _refusal(table: type, error: ValidationError, values: tuple[Any, ...], named: dict[str, Any]) -> SettingError:
    """One line on the first setting at fault; the keys of the error are those of all."""
    names = [field.name for field in fields(table)]
    if len(values) > len(names):
        return SettingError(f"{table.__name__}: expected at most {len(names)} settings, got {len(values)}")
    given = dict(zip(names, values, strict=False)) | named
    # pydantic counts values that were given without a name.
    places = dict.fromkeys(fault["loc"][0] for fault in error.errors())
    at_fault = [names[place] if isinstance(place, int) else place for place in places]
    path = next((f"{name}." for name, kind in get_type_hints(_tree()).items() if kind is table), "")
    first = at_fault[0]
    if path:
        key = f"{path}{first}"
        fault = out_of_range(key, given[first]) if first in names else unknown_key(path[:-1], first)
    elif first in names:
        fault = f"{first} = {shown(given[first])}: must be a {get_type_hints(table)[first].__name__}"
    else:
        fault = unknown_table(first)
    more = f" (and {len(at_fault) - 1} more)" if len(at_fault) > 1 else ""
    return SettingError(fault + more, keys=tuple(f"{path}{name}" for name in at_fault))


def out_of_range(key: str, value: object) -> str:
    """What to say of a setting whose value cannot be."""
    from navrl.config import WORLDS

    words = WORLDS if key == "world.name" else choices(_tree(), key)
    hint = meant(get_close_matches(value, words, n=1)) if isinstance(value, str) else ""
    # A path is of little use without its end.
    text = shown(value, longest=4096) if key == "world.name" else shown(value)
    return f"{key} = {text}: must be {allowed(_tree(), key)}{hint}"


def unknown_table(name: str) -> str:
    """What to say of a name at the top that is none of a table."""
    own = [key for key in keys(_tree()) if key.endswith(f".{name}")]
    tables = [field.name for field in fields(_tree())]
    hint = meant([*own, *get_close_matches(name, tables, n=1)]) or f"; tables are {', '.join(tables)}"
    return f"{_shown_key(name)}: no such table or key{hint}"


def unknown_key(table: str, name: str) -> str:
    """What to say of a name that the table does not have."""
    known = keys(_tree())
    leaves = [key.removeprefix(f"{table}.") for key in known if key.startswith(f"{table}.")]
    near = [f"{table}.{leaf}" for leaf in get_close_matches(name, leaves, n=1)]
    elsewhere = [key for key in known if key.endswith(f".{name}")]
    hint = meant([*near, *elsewhere]) or f"; [{table}] has {', '.join(leaves)}"
    return f"{_shown_key(f'{table}.{name}')}: no such key{hint}"


def meant(names: Sequence[str]) -> str:
    """The first of the nearest names as a hint; nothing if there is none."""
    return f"; did you mean {names[0]}?" if names else ""


def _shown_key(key: str) -> str:
    plain = key.replace(".", "").replace("_", "").replace("-", "").isalnum() and len(key) <= LONGEST_KEY
    return key if plain else shown(key)


def _tree() -> type:
    # The configuration's classes are made with this module.
    from navrl.config import Config

    return Config
