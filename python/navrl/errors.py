"""Errors that are the user's mistake: one line, exit code 2, no traceback.

Kept apart from the configuration so that commands and deployed policies can name them without loading its validator.
"""

from json import dumps


def shown(value: object, *, longest: int = 60) -> str:
    """A value as a configuration file would have it, on one line and cut after `longest` characters."""
    try:
        text = " ".join(_written(value, longest).split())
    except RecursionError:
        text = "lists in lists in lists ..."
    return text if len(text) <= longest else text[: longest - 3] + "..."


def _written(value: object, longest: int) -> str:
    if isinstance(value, (bool, str)):
        return dumps(value, ensure_ascii=False)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_written(item, longest) for item in value[:longest]) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_written(item, longest)}" for key, item in value.items()) + "}"
    if isinstance(value, int) and value.bit_length() > 64 * longest:
        return f"{value:#x}"  # Python writes numbers of so many digits only as powers of two
    return str(value)


class UserError(Exception):
    """A mistake that the user can put right; its text is one line that says what to change."""


class ConfigError(UserError):
    """A configuration that cannot be used.

    Attributes:
        fault: what is wrong, without its source, such as ``learner.tau = 2: must be a number in (0, 1]``.
        keys: paths of the settings at fault, the first being the one named; empty if the whole source is.
    """

    def __init__(self, fault: str, *, keys: tuple[str, ...] = (), source: str = "") -> None:
        """Joins the source (a file, a preset or an option; empty if unknown) and the fault to one line."""
        super().__init__(f"{source}: {fault}" if source else fault)
        self.fault = fault
        self.keys = keys


class SettingError(ConfigError, ValueError):
    """Settings of a table that are unknown, of another type, or out of range, given in Python."""
