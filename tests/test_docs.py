"""The pages of docs/: their snippets run, their examples and refusals are what navrl says, their options exist."""

import json
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from navrl import _navsim
from navrl.batch import BatchSim, config_json
from navrl.cli import main
from navrl.config import SimConfig, WorldConfig
from navrl.config.files import load_config
from navrl.errors import UserError
from navrl.scenarios import ScenarioError, read_list

DOCS = Path(__file__).parent.parent / "docs"
EXAMPLES = DOCS / "examples"
PAGES = sorted(page.name for page in DOCS.glob("*.md"))
SMALLER = {
    "evaluation.md": [
        ('evaluate(policy, "test")', "evaluate(policy, few)"),
        ('evaluate(Straight(), "test", ', "evaluate(Straight(), few, "),
    ],
    "gymnasium.md": [
        ("total_timesteps=200_000", "total_timesteps=4_608"),
        ('evaluate(Trained(), "test", ', "evaluate(Trained(), few, "),
    ],
}
"""What a page does at length and a test in short: (text, replacement); `few` is a list of 10 scenarios."""

World = dict[str, Any]


def page(name: str) -> str:
    """Text of a page."""
    return (DOCS / name).read_text(encoding="utf-8")


def blocks(name: str, language: str) -> list[str]:
    """Fenced blocks of a language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page(name), re.MULTILINE | re.DOTALL)


def snippets(name: str) -> list[str]:
    """Python blocks of a page, with what takes long made short."""
    text = "\0".join(blocks(name, "python"))
    for long, short in SMALLER.get(name, []):
        assert long in text, f"{name} no longer says {long}"
        text = text.replace(long, short)
    return text.split("\0") if text else []


def commands() -> list[tuple[str, list[str]]]:
    """(page, words) of every navrl command in the console blocks of all pages."""
    lines = [(name, line) for name in PAGES for block in blocks(name, "console") for line in block.splitlines()]
    return [(name, shlex.split(line)[2:]) for name, line in lines if line.startswith("$ navrl ")]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small run in the office, in the folder that the pages name."""
    folder = tmp_path_factory.mktemp("run") / "office"
    world = str(EXAMPLES / "office.json")
    short = ["--steps", "2560", "--no-test", "--validation.scenarios", "5", "--training.num_envs", "64"]
    assert main(["train", "--world", world, "--out", str(folder), *short]) == 0
    return folder


@pytest.fixture
def desk(tmp_path: Path, run: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The reader's folder: the examples, and runs/office."""
    shutil.copytree(EXAMPLES, tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(run, tmp_path / "runs" / "office")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def execute(name: str, texts: list[str]) -> None:
    """Runs snippets one after the other in one namespace."""
    from navrl.batch import draw_list

    names: dict[str, Any] = {"__name__": "snippet", "few": draw_list(SimConfig(), "test", 10)}
    for text in texts:
        exec(compile(text, name, "exec"), names)


@pytest.mark.parametrize("name", [name for name in PAGES if blocks(name, "python")])
def test_snippets_run(name: str, desk: Path) -> None:
    texts = snippets(name)
    if any("stable_baselines3" in text for text in texts):
        texts = [text for text in texts if "stable_baselines3" not in text and "sb3" not in text]
    execute(name, texts)


def test_stable_baselines3_trains(desk: Path) -> None:
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: its snippets are not run")
    execute("gymnasium.md", [text for text in snippets("gymnasium.md") if "stable_baselines3" in text])


def test_pages_show_the_example_files() -> None:
    for name, language, file in (
        ("own-world.md", "json", "office.json"),
        ("own-robot.md", "toml", "delivery.toml"),
        ("gymnasium.md", "python", "sb3_vec_env.py"),
    ):
        text = re.sub(r"^# ruff: .*\n", "", (EXAMPLES / file).read_text(encoding="utf-8"))
        assert text in blocks(name, language), file


def test_the_scenario_list_is_what_its_snippet_writes(desk: Path) -> None:
    Path("office.jsonl").unlink()
    execute("own-world.md", snippets("own-world.md")[:1])
    assert Path("office.jsonl").read_bytes() == (EXAMPLES / "office.jsonl").read_bytes()


def test_examples_can_be_used(tmp_path: Path) -> None:
    office = SimConfig(world=WorldConfig(name=str(EXAMPLES / "office.json")))
    _navsim.check_world(config_json(office))
    assert BatchSim(office, num_envs=4).observations.shape == (4, 24)
    scenarios = read_list(EXAMPLES / "office.jsonl", office)
    assert len(scenarios) == 4
    assert load_config(EXAMPLES / "delivery.toml").robot.footprint == "rectangle"


def test_options_exist(capsys: pytest.CaptureFixture[str]) -> None:
    typed = commands()
    assert len(typed) > 15
    for name, words in typed:
        with pytest.raises(SystemExit):
            main([words[0], *(["check"] if words[0] == "config" else []), "--help"])
        known = capsys.readouterr().out
        flags = [word.partition("=")[0] for word in words if word.startswith("--")]
        for flag in flags:
            assert "." in flag or re.search(rf"{flag}\b", known), f"{name}: navrl {' '.join(words)}: no option {flag}"
        keys = [(flag, words[words.index(flag) + 1]) for flag in flags if "." in flag]
        if keys:
            assert main(["config", "show", *(part for pair in keys for part in pair)]) == 0
            capsys.readouterr()


def row(name: str, message: str) -> bool:
    """Whether a table of the page shows the message as code at the end of a row."""
    return any(line.endswith(f"| `{message}` |") for line in page(name).splitlines())


def misspelt(world: World) -> None:
    world["boxs"] = world.pop("boxes")


def too_small(world: World) -> None:
    world["area"] = [0.0, 0.0, 0.3, 0.3]


def too_full(world: World) -> None:
    world["random_boxes"] = {"count": 60, "sides": [1.0, 1.5], "clearance": 0.45}


@pytest.mark.parametrize(
    "edit",
    [
        misspelt,
        lambda world: world.pop("area"),
        lambda world: world.update(area=[8, 0, 0, 8]),
        lambda world: world["random_boxes"].update(sides=[0.6, 0.3]),
        lambda world: world.update(circles=[[2, 2, -0.3]]),
        lambda world: world.update(polygons=[[[4, 4], [3, 3.9], [4, 3.2], [3.9, 3.7]]]),
        too_small,
        too_full,
    ],
)
def test_refused_worlds(edit: Callable[[World], object], tmp_path: Path) -> None:
    world = json.loads((EXAMPLES / "office.json").read_bytes())
    edit(world)
    file = tmp_path / "office.json"
    file.write_text(json.dumps(world))
    sim = SimConfig(world=WorldConfig(name=str(file)))
    with pytest.raises(ValueError, match=re.escape(str(file))) as refusal:
        BatchSim(sim, num_envs=1)
    message = str(refusal.value).partition(f"{file}")[2].lstrip("':").strip()
    assert row("own-world.md", message), message


@pytest.mark.parametrize(
    ("line", "edits"),
    [
        (1, {"start": [2.0, 2.2, 0.0]}),
        (2, {"goal": [6.0, 6.0]}),
        (4, {"goal": [2.9, 7.1]}),
        (4, {"goal": [6.0, 0.4]}),
    ],
)
def test_refused_scenarios(line: int, edits: World, tmp_path: Path) -> None:
    lines = (EXAMPLES / "office.jsonl").read_text(encoding="utf-8").splitlines()
    lines[line - 1] = json.dumps(json.loads(lines[line - 1]) | edits)
    file = tmp_path / "office.jsonl"
    file.write_text("\n".join(lines))
    with pytest.raises(ScenarioError, match=f"line {line}: ") as refusal:
        read_list(file, SimConfig())
    message = str(refusal.value).partition(f"line {line}: ")[2].partition(" (--skip-invalid")[0]
    assert row("own-world.md", message), message


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("omega_max", "omega_limit"),
        ("width = 0.45", 'width = "wide"'),
        ("bins = 30 ", "bins = 300 "),
        ("mount = [0.15, 0.0, 0.0]", "mount = [0.15, 0.1, 0]"),
    ],
)
def test_refused_robots(old: str, new: str, tmp_path: Path) -> None:
    text = (EXAMPLES / "delivery.toml").read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "delivery.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(UserError) as refusal:
        load_config(file)
    assert row("own-robot.md", str(refusal.value).removeprefix(f"{file}: ")), refusal.value


def test_a_run_ends_with_the_lines_that_the_page_shows() -> None:
    from navrl.running.monitor import result_lines

    rates = {"success_rate": 0.941, "success_ci95": [0.92464, 0.95399], "collision_rate": 0.023, "timeout_rate": 0.036}
    counts = {"env_steps": 200192, "updates": 3619, "best_steps": 200192, "train_s": 7.588, "wall_s": 20.44}
    summary = {**counts, **rates, "spl": 0.7953, "scores": {"episodes": 1000}}
    assert "\n".join(result_lines(summary, Path("runs/office"))) in page("own-world.md")


def test_every_page_is_in_the_navigation() -> None:
    text = (DOCS.parent / "mkdocs.yml").read_text(encoding="utf-8")
    assert sorted(re.findall(r"([\w-]+\.md)$", text, re.MULTILINE)) == PAGES


def test_every_page_is_linked_from_the_first_pages() -> None:
    linked = set(re.findall(r"\]\(docs/([\w-]+\.md)", (DOCS.parent / "README.md").read_text(encoding="utf-8")))
    linked |= set(re.findall(r"\]\(([\w-]+\.md)", page("index.md")))
    assert sorted(linked | {"index.md"}) == PAGES


def test_links_lead_somewhere() -> None:
    for name in PAGES:
        for target in re.findall(r"\]\(([^)#]+)", page(name)):
            assert target.startswith("https://") or (DOCS / target).exists(), f"{name}: {target}"
