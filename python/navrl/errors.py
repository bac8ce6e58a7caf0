"""Errors that are the user's mistake: one line, exit code 2, no traceback.

Kept apart from the configuration so that commands and deployed policies can name them without loading its validator.
"""


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
