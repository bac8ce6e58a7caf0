"""The allowed values of a setting in words, read from its type: for error messages and the reference page."""

from collections.abc import Iterator
from dataclasses import fields
from types import EllipsisType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic.fields import FieldInfo

from navrl.errors import shown

_NOUNS = {bool: "true or false", int: "whole number", float: "number", str: "string"}


def keys(tree: type) -> list[str]:
    """Every key path of a configuration class, such as ``learner.tau``, in order."""
    tables = get_type_hints(tree)
    return [f"{table.name}.{key.name}" for table in fields(tree) for key in fields(tables[table.name])]


def allowed(tree: type, key: str) -> str:
    """What the setting with this key path may be, such as ``a number in (0, 1]``."""
    return describe(_hint(tree, key))


def choices(tree: type, key: str) -> tuple[str, ...]:
    """The words that the setting may be; empty if it is no enumeration."""
    hint = _hint(tree, key)
    return get_args(hint) if get_origin(hint) is Literal else ()


def describe(hint: Any) -> str:  # noqa: ANN401 - a type hint may be anything
    """A type hint of the configuration in words."""
    if get_origin(hint) is Literal:
        *first, last = (shown(value) for value in get_args(hint))
        return f"{', '.join(first)} or {last}"
    hint, limits = _split(hint)
    for limit in limits:
        if isinstance(limit, str):
            return limit
    if get_origin(hint) is tuple:
        return "a list of " + _list(hint, limits)
    noun = _NOUNS[hint] if hint is bool else f"a {_NOUNS[hint]}"
    return noun + _interval(limits)


def _hint(tree: type, key: str) -> Any:  # noqa: ANN401 - a type hint may be anything
    table, _, name = key.partition(".")
    return get_type_hints(get_type_hints(tree)[table], include_extras=True)[name]


def _split(hint: Any) -> tuple[Any, list[object]]:  # noqa: ANN401 - a type hint may be anything
    if get_origin(hint) is not Annotated:
        return hint, []
    bare, *extras = get_args(hint)
    return bare, list(_limits(extras))


def _limits(extras: list[object]) -> Iterator[object]:
    for extra in extras:
        if isinstance(extra, FieldInfo):
            if extra.description:
                yield extra.description
            yield from extra.metadata


def _list(hint: Any, limits: list[object]) -> str:  # noqa: ANN401 - a type hint may be anything
    items: tuple[Any, ...] = get_args(hint)
    if items[-1] is Ellipsis or isinstance(items[-1], EllipsisType):
        least = next(limit.min_length for limit in limits if isinstance(limit, MinLen))
        most = next(limit.max_length for limit in limits if isinstance(limit, MaxLen))
        count = f"{least} to {most}"
    else:
        count = str(len(items))
    item, item_limits = _split(items[0])
    return f"{count} {_NOUNS[item]}s{_interval(item_limits)}"


def _interval(limits: list[object]) -> str:
    low, high = "(-inf", "inf)"
    for limit in limits:
        if isinstance(limit, Ge):
            low = f"[{_number(limit.ge)}"
        elif isinstance(limit, Gt):
            low = f"({_number(limit.gt)}"
        elif isinstance(limit, Le):
            high = f"{_number(limit.le)}]"
        elif isinstance(limit, Lt):
            high = f"{_number(limit.lt)})"
    return f" in {low}, {high}" if limits else ""


def _number(value: Any) -> str:  # noqa: ANN401 - the bounds of annotated-types are untyped
    if value != int(value):
        return repr(value)
    return f"{int(value):_}" if abs(value) >= 10_000 else str(int(value))
