"""navrl trains a mobile robot with a lidar to reach goals without collisions.

The public names below load on first use, so that `navrl --help` answers at once and evaluation never loads torch.
`import navrl.env` makes its environments known to Gymnasium, as `navrl/TD3World-v0` and others.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from navrl.batch import BatchSim, Scenario
    from navrl.config import SimConfig
    from navrl.evaluate import evaluate
    from navrl.policy import load_policy

    __version__: str

__all__ = ["BatchSim", "Scenario", "SimConfig", "__version__", "evaluate", "load_policy"]

_MODULES = {
    "BatchSim": "navrl.batch",
    "Scenario": "navrl.batch",
    "SimConfig": "navrl.config",
    "evaluate": "navrl.evaluate",
    "load_policy": "navrl.policy",
}


class _Package(ModuleType):
    """A package in which a function may share its name with the module that holds it."""

    def __setattr__(self, name: str, value: object) -> None:
        # Importing navrl.evaluate binds the module here; the public name is the function of the same name in it.
        if isinstance(value, ModuleType) and name in _MODULES:
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the public names differ in type
    if name == "__version__":
        from importlib.metadata import version

        return version("navrl")
    if name not in _MODULES:
        raise AttributeError(f"module 'navrl' has no attribute '{name}'")
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
