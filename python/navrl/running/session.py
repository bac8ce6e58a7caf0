"""How a run begins, is resumed, and ends - whatever ends it; `navrl.train` holds the loop between.

train(config, out, preset=, init=, test=) -> run folder
resume(out, steps=, inexact=) -> run folder
NonFiniteError (exit code 3), Interrupted (exit code 130)
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from navrl.config import Config
from navrl.errors import UserError
from navrl.machine import available_memory
from navrl.policy import load_policy, save_policy
from navrl.replay import NonFiniteError
from navrl.running.checkpoint import CheckpointError, Checkpoints
from navrl.running.folder import RunFolder
from navrl.running.interrupt import Interrupted, Interruption
from navrl.running.metrics_log import MetricsLog
from navrl.running.monitor import Monitor, result_lines
from navrl.running.run import Run
from navrl.running.summary import summarize_run
from navrl.td3 import flushed_denormals
from navrl.train import Training

__all__ = ["Interrupted", "NonFiniteError", "resume", "train"]


def train(
    config: Config, out: str | Path, *, preset: str = "fast", init: str | Path | None = None, test: bool = True
) -> Path:
    """Trains a policy.

    Args:
        config: All settings.
        out: Folder of the run, new or empty.
        preset: Name of the settings, for the summary.
        init: A policy whose actor is the first one.
        test: Whether to test the best policy at the end.

    Returns:
        The run folder.

    Raises:
        UserError: The folder is taken, memory is too small, the first policy does not fit, or the disk is full.
        NonFiniteError: NaN or infinity; the last checkpoint is sound.
        Interrupted: Stopped by the user, and saved.
    """
    first_policy = None if init is None else load_policy(init)
    with RunFolder.create(Path(out)) as folder:
        try:
            config = folder.keep_world(config)
            run = Run(config, folder, preset=preset, test=test)
            if first_policy is not None:
                run.start_from(first_policy)
            folder.write_config(config)
            _to_the_end(run)
        except BaseException:
            if not Checkpoints(folder.checkpoints).numbers():
                folder.empty()
            raise
        return folder.path


def resume(out: str | Path, *, steps: int | None = None, inexact: bool = False) -> Path:
    """Continues a run from its newest checkpoint to the bits of a run that was never interrupted.

    Args:
        out: Folder of the run.
        steps: Where the run ends now, in environment steps, instead of where it was to end. The step sizes keep the
            plan that the run began with: beyond its end they stay at their final values.
        inexact: Also where bits may differ: on another processor, with other builds or another number of threads.

    Returns:
        The run folder.

    Raises:
        UserError: There is no run, no sound checkpoint, or bits would differ.
        NonFiniteError: NaN or infinity; the last checkpoint is sound.
        Interrupted: Stopped by the user, and saved.
    """
    with RunFolder.open(Path(out)) as folder:
        run = Run.restored(folder, inexact=inexact)
        if steps is not None:
            run.extend(steps)
        summary = folder.summary()
        if run.complete and summary is not None and summary["updates"] == run.learner.updates:
            print(f"the run in {folder.path} is finished; --resume {folder.path} --steps N makes it longer")
        else:
            _to_the_end(run)
        return folder.path


def _to_the_end(run: Run) -> None:
    """Trains, tests and reports; whatever happens, the last checkpoint is complete."""
    log = MetricsLog(run.folder.path, run.log_from)
    monitor = Monitor(run.limits.steps, run.limits.episodes)
    interruption = Interruption(monitor.leave)
    training = Training(run, log=log, monitor=monitor, interruption=interruption)
    monitor.line(_introduction(run))
    try:
        with interruption, flushed_denormals():
            try:
                run.save(log)
                run.wait_until_saved()
                training.loop()
                _finish(training)
            except KeyboardInterrupt:
                _save_and_leave(training)
    except NonFiniteError as error:
        where = f"after {run.counts.steps:,} steps and {run.learner.updates:,} updates"
        raise NonFiniteError(f"training stopped {where}: {error}; {run.kept}") from None
    except BrokenPipeError:
        raise  # who read our output has gone; nothing is wrong with the run
    except OSError as error:
        raise UserError(f"{error.filename or run.folder.path}: {error.strerror}; {run.kept}") from error
    finally:
        with suppress(CheckpointError):  # said already, or of no account beside another error
            run.wait_until_saved()
        monitor.close()
        log.close()


def _introduction(run: Run) -> str:
    """One line: robots, threads and memory."""
    robots, learn = run.config.training.num_envs, run.learn_threads
    memory = available_memory()
    available = "" if memory is None else f" of {memory / 1e6:,.0f} MB free"
    return (
        f"{robots} {'robot' if robots == 1 else 'robots'}; threads: simulate {run.threads}, learn {learn}; "
        f"replay up to {run.replay_bytes / 1e6:,.0f} MB{available}"
    )


def _finish(training: Training) -> None:
    """Saves, tests the best policy and writes the summary."""
    run = training.run
    run.save(training.log)
    run.wait_until_saved()
    if run.best is None:
        raise AssertionError("a run ends with a validation")
    scores = training.evaluate(run.best.weights, run.load_list("test")) if run.test else None
    save_policy(run.folder.policy, run.best.weights, run.description(scores or run.best.scores))
    summary = summarize_run(run, scores)
    run.folder.write_summary(summary)
    training.monitor.close()
    print("\n".join(result_lines(summary, run.folder.path)), flush=True)


def _save_and_leave(training: Training) -> NoReturn:
    """Saves where a signal came.

    Raises:
        Interrupted: Always; its text says how to resume.
    """
    run, monitor = training.run, training.monitor
    with suppress(OSError):  # a terminal that was closed
        monitor.line("stopping; Ctrl+C again leaves at once, with the last checkpoint")
    run.save(training.log)
    run.wait_until_saved()
    folder = run.folder.path
    message = f"stopped after {run.counts.steps:,} steps and saved; resume with: navrl train --resume {folder}"
    with suppress(OSError):
        monitor.close()
        monitor.line(message)
    raise Interrupted(message)
