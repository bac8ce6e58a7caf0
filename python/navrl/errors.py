"""Errors that are the user's mistake: one line, exit code 2, no traceback.

Kept apart from the configuration so that commands and deployed policies can name them without loading its validator.
"""

from json import dumps


def shown(value: object, *, longest: int = 60) -> str:
    """A value as a configuration file would have it, on one line and cut after `longest` characters."""
    if isinstance(value, (bool, str)):
        text = dumps(value, ensure_ascii=False)
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(shown(item) for item in value[:longest]) + "]"
    elif isinstance(value, int) and value.bit_length() > 4 * longest:
        text = f"{value:#x}"
    else:
        text = str(value)
    text = " ".join(text.split())
    return text if len(text) <= longest else text[: longest - 3] + "..."


class UserError(Exception):
    """A mistake that the user can put right; its text is one line that says what to change."""


class ConfigError(UserError):
    """A configuration that cannot be used.

    Attributes:
        key: path of the setting, such as ``learner.tau``; empty if the whole source is at fault.
        fault: what is wrong with it, without its source: ``learner.tau = 2: must be a number in (0, 1]``.
    """

    def __init__(self, fault: str, *, key: str = "", source: str = "") -> None:
        """Joins the source (a file, a preset or an option; empty if unknown) and the fault to one line."""
        super().__init__(f"{source}: {fault}" if source else fault)
        self.key = key
        self.fault = fault
