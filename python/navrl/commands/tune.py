"""`navrl tune`: finds settings of a classical controller on the tuning list."""

import sys
from argparse import Namespace
from pathlib import Path

from navrl.commands.options import given_settings, threads, whole_number
from navrl.commands.selection import check_boxes
from navrl.config import Config
from navrl.config.files import load_config
from navrl.errors import UserError
from navrl.exit_codes import DONE


def tune(options: Namespace) -> int:
    """Searches until the budget is spent, and prints the settings."""
    check_boxes(options)
    settings = given_settings(options, "world", "boxes")
    config = load_config(options.config, robot=options.robot, level=options.level, options=settings)
    trials = whole_number("--trials", options.trials, 1, 10**6)
    episodes = whole_number("--episodes", options.episodes, 1, 10**6)
    seed = whole_number("--seed", options.seed, 0, 2**31)

    from navrl import tune as search

    search.tunable(options.name)
    folder = _folder(options, config, seed) if options.out is None else Path(options.out)
    if folder.exists() and not folder.is_dir():
        raise UserError(f"--out {folder}: is not a folder")
    print(
        f"navrl: tuning {options.name}, {trials} trial{'s' * (trials > 1)} of {episodes} scenarios; {folder}",
        file=sys.stderr,
    )
    best = search.tune(
        options.name,
        config,
        folder,
        trials=trials,
        episodes=episodes,
        seed=seed,
        num_threads=threads(options.threads),
        command=options.typed,
        report=lambda line: print(f"navrl: {line}", file=sys.stderr),
    )
    for what, count in (("cut short, and not counted", best.cut), ("refused", best.refused)):
        if count:
            print(f"navrl: {count} trial{'s' * (count > 1)} {what}", file=sys.stderr)
    for key in best.at_ends:
        print(f"navrl: {key} lies at the end of what was searched: a start beyond it widens that", file=sys.stderr)
    low, high = best.scores["success_ci95"]
    rate = f"success {100 * best.scores['success_rate']:.2f} % (95 % interval {100 * low:.2f} to {100 * high:.2f} %)"
    print(f"{options.name}: {rate}, SPL {best.scores['spl']:.3f} on the tuning list")
    print(f"settings: {folder / search.BEST_FILE}")
    return DONE


def _folder(options: Namespace, config: Config, seed: int) -> Path:
    """The same for the same search, which continues there."""
    boxes = f"{config.world.boxes}" if config.world.name == "boxes" else ""
    world = Path(config.world.name).stem + boxes
    return Path("runs") / f"tune-{options.name}-{world}-{options.level}-seed{seed}"
