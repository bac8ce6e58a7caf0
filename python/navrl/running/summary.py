"""What a finished run reports: the content of summary.json.

summarize_run(run, test_scores) -> names and values
"""

from __future__ import annotations

from typing import Any

from navrl.metrics import Scores
from navrl.running.run import Run

SCHEMA = 1
"""Version of summary.json."""


def summarize_run(run: Run, test_scores: Scores | None) -> dict[str, Any]:
    """Sums a run up.

    Args:
        run: It has ended.
        test_scores: Scores of the best policy on the test list, if it was tested.

    Returns:
        Names and values; the scores stand under "scores" and, but for their number of episodes, beside it too.
    """
    here, clock = run.machine, run.clock
    scores = {} if test_scores is None else test_scores.to_json()
    facts = {
        "schema": SCHEMA,
        "navrl": here.navrl,
        "torch": here.torch,
        "preset": run.preset,
        "algorithm": run.config.learner.algorithm,
        "seed": run.config.training.seed,
        "cpu": here.cpu,
        "isa": here.isa,
        "kernel": here.kernel,
        "threads": {"sim": run.threads, "learn": run.learn_threads},
        "env_steps": run.counts.steps,
        "updates": run.learner.updates,
        "episodes": run.metrics.episodes,
        "train_s": clock.trained_s,
        "update_s": clock.update_s,
        "eval_s": clock.eval_s,
        "wall_s": clock.wall_s,
        "stopped_by": run.ended_by,
        "inexact": run.inexact,
        "best_steps": None if run.best is None else run.best.steps,
    }
    return {**facts, **{key: value for key, value in scores.items() if key not in facts}, "scores": scores or None}
