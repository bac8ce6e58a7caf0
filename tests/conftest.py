"""What several test files share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from navrl.comparing import timing
from navrl.config import SimConfig
from navrl.running.session import train
from navrl.scenarios import ScenarioList, load_list
from short_runs import PRESETS, outcome, small


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """Outcomes, by preset, of runs that were never interrupted and never saved but at their ends."""
    outcomes = {}
    for preset in PRESETS:
        folder = tmp_path_factory.mktemp(preset) / "run"
        train(small(preset), folder, preset=preset, test=False)
        outcomes[preset] = outcome(folder)
    return outcomes


Writer = Callable[[str | bytes], Path]
"""Writes a configuration file of that content."""


@pytest.fixture
def config_file(tmp_path: Path) -> Writer:
    """Writes my.toml."""

    def write(content: str | bytes) -> Path:
        path = tmp_path / "my.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def quick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few timed decisions, and a cache of lengths that nobody else has."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(timing, "CALLS", 20)
    monkeypatch.setattr(timing, "WARM_UP", 5)


@pytest.fixture(scope="session")
def drawn() -> ScenarioList:
    """The first test scenarios of "td3"."""
    return load_list(SimConfig(), "test", count=12)
