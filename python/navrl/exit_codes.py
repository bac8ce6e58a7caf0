"""How a command ends, as scripts see it."""

DONE = 0
INTERNAL_ERROR = 1
USER_MISTAKE = 2
"""The user can put it right; one line said what to change."""
NOT_FINITE = 3
"""Training met a NaN or an infinity."""
INTERRUPTED = 130
"""By Ctrl-C or a signal, and saved what there was."""
