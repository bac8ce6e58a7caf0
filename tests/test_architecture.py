"""The flow that README, docs and the core print is the one that the files follow."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PYTHON = ROOT / "python/navrl"
CORE = ROOT / "crates/navsim/src"
FLOW = "config -> world -> batch (kinematics -> collision -> lidar -> observation, reward, episode) -> env -> "


def flow(file: str) -> str:
    """The line of the flow in a file, to its end."""
    text = (ROOT / file).read_text()
    found = re.search(r"config -> world -> batch .*", text)
    assert found, f"{file} does not show the flow"
    return found[0].strip("` ")


def stages(line: str) -> list[str]:
    """The names in a line of the flow."""
    return re.findall(r"\w+", line)


def test_the_flow_is_the_same_everywhere() -> None:
    line = flow("README.md")
    assert line.startswith(FLOW)
    assert line.endswith(" -> td3 -> train -> evaluate -> compare -> policy")
    assert flow("docs/architecture.md") == line
    assert line.startswith(flow("crates/navsim/src/lib.rs"))


def rooms(source: Path) -> set[str]:
    """Names of the folders that hold code."""
    return {path.parent.name for path in source.glob("*/*.[pr][ys]")}


def test_every_stage_is_a_module() -> None:
    modules = {path.stem for path in PYTHON.glob("*.py")} | {path.stem for path in CORE.rglob("*.rs")}
    assert set(stages(flow("README.md"))) <= modules | rooms(PYTHON) | rooms(CORE)


def test_every_module_is_a_stage_or_named_beside_the_flow() -> None:
    page = (ROOT / "docs/architecture.md").read_text()
    named = set(stages(flow("README.md"))) | set(re.findall(r"`(\w+)/?`", page.split("## Modules beside the flow")[1]))
    modules = (
        {path.stem for path in [*PYTHON.rglob("*.py"), *CORE.glob("*.rs"), *CORE.glob("*/*.rs")]}
        | rooms(PYTHON)
        | rooms(CORE)
    )
    # `robot` holds kinematics; `task` holds observation, reward and episode.
    assert modules - {"__init__", "__main__", "lib", "mod", "robot", "footprint", "kinematics", "task"} <= named


@pytest.mark.parametrize("page", sorted(p.name for p in (ROOT / "docs").glob("*.md")))
def test_links_between_pages_lead_somewhere(page: str) -> None:
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", (ROOT / "docs" / page).read_text()):
        assert (ROOT / "docs" / target).exists(), f"docs/{page} links to {target}"
