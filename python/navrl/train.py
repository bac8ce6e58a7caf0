"""The training loop: act, step, store, update, evaluate, save.

    train(config, out, preset=, init=, test=) -> run folder
    resume(out, steps=, inexact=) -> run folder
    NonFiniteError (exit code 3), Interrupted (exit code 130)

One robot with an update phase after each episode and many robots with interleaved updates are the same loop: steps owe
updates, and owed updates come first. Each turn of the loop makes one move, after which the run can be saved; a run that
is resumed there, in whatever process, makes the same moves to the same bits.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from navrl.checkpoint import CheckpointError
from navrl.config import Config
from navrl.errors import UserError
from navrl.evaluate import evaluate
from navrl.interrupt import Interrupted, Interruption
from navrl.machine import available_memory, cores
from navrl.metrics import Scores
from navrl.metrics_log import MetricsLog
from navrl.monitor import Monitor, result_lines
from navrl.policy import Policy, Weights, load_policy, save_policy
from navrl.replay import NonFiniteError, Transition
from navrl.run import Best, Run
from navrl.run_folder import RunFolder
from navrl.scenarios import ScenarioList
from navrl.td3 import flushed_denormals

__all__ = ["Interrupted", "NonFiniteError", "resume", "train"]

UPDATES_PER_MOVE = 8
"""Most updates between two moments at which a run can be saved and stopped: 0.1 s with the largest usual networks."""


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
        run = Run(config, folder, preset=preset, test=test)
        if first_policy is not None:
            run.start_from(first_policy)
        folder.write_config(config)
        _Training(run).to_the_end()
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
            _Training(run).to_the_end()
        return folder.path


class _Training:
    """The moves that bring a run to its end, and what a user sees and does meanwhile."""

    def __init__(self, run: Run) -> None:
        """Opens the log and the display; the run's parts are its own."""
        self.run = run
        self.log = MetricsLog(run.folder.path, run.log_from)
        self.monitor = Monitor(run.limits.steps, run.limits.episodes)
        self.interruption = Interruption(self.monitor.leave)

    def to_the_end(self) -> None:
        """Trains, tests and reports; whatever happens, the last checkpoint is complete."""
        run = self.run
        self.monitor.line(_introduction(run))
        try:
            with self.interruption, flushed_denormals():
                try:
                    run.save(self.log)
                    run.wait_until_saved()
                    self._loop()
                    self._finish()
                except KeyboardInterrupt:
                    self._save_and_leave()
        except NonFiniteError as error:
            where = f"after {run.counts.steps:,} steps and {run.learner.updates:,} updates"
            kept = f"the last checkpoint in {run.folder.checkpoints} is sound"
            raise NonFiniteError(f"training stopped {where}: {error}; {kept}") from None
        except BrokenPipeError:
            raise  # who read our output has gone; nothing is wrong with the run
        except OSError as error:
            kept = f"the last checkpoint in {run.folder.checkpoints} is complete"
            raise UserError(f"{error.filename or run.folder.path}: {error.strerror}; {kept}") from error
        finally:
            with suppress(CheckpointError):  # said already, or of no account beside another error
                run.wait_until_saved()
            self.monitor.close()
            self.log.close()

    def _loop(self) -> None:
        """Makes one move after the other until the run has ended."""
        run, monitor = self.run, self.monitor
        run.clock.start()
        while True:
            if self.interruption.requested:
                raise KeyboardInterrupt
            if time.monotonic() >= run.next_save:
                run.save(self.log)
            if monitor.due:
                monitor.show(run.progress, run.metrics.rates(), run.share)
            if run.counts.owed >= 1.0:
                self._update()
            elif run.report_due:
                self._report()
            elif run.ended_by:
                return
            else:
                self._step()

    def _step(self) -> None:
        """Acts, steps the robots and stores what they met; owes updates for it."""
        run, sim, counts = self.run, self.run.sim, self.run.counts
        run.learner.average_actor()
        # Act
        actions = run.exploration.explore(run.learner.act(run.encoded), sim.observations, counts.steps)
        # Step
        self._drive(actions)
        ended = sim.terminated | sim.truncated
        counts.steps += sim.num_envs
        run.exploration.end_episodes(ended)
        run.metrics.add_step(sim)
        # Store
        transition = Transition(
            observations=run.encoded,
            actions=actions,
            rewards=sim.rewards,
            successors=run.encode(sim.final_observations),
            terminated=sim.terminated,
            truncated=sim.truncated,
            outcome=sim.outcome,
        )
        run.replay.add(run.assembler.push(transition))
        run.encoded = run.encode(sim.observations)
        if not np.isfinite(run.encoded).all():
            robot = int(np.argwhere(~np.isfinite(run.encoded))[0, 0])
            raise NonFiniteError(f"observation of robot {robot} is not finite: {sim.observations[robot]}")
        # Owe updates
        training = run.config.training
        if counts.steps >= run.config.exploration.random_steps and run.replay.size > 0:
            interleaved = training.update_schedule == "interleaved"
            counts.owed += training.updates_per_step if interleaved else int(sim.episode_steps[ended].sum())
        run.learner.set_progress(run.plan.share(counts.steps, run.metrics.episodes))

    def _drive(self, actions: NDArray[np.float32]) -> None:
        """Steps the robots.

        Args:
            actions: (num_envs, 2) in [-1, 1].

        Raises:
            UserError: The world turned out to be too full where a robot was to begin an episode.
            NonFiniteError: An action is NaN or infinite.
        """
        try:
            self.run.sim.step(actions)
        except ValueError as error:
            if not np.isfinite(actions).all():
                raise NonFiniteError(str(error)) from None
            where = f"training stopped after {self.run.counts.steps:,} steps"
            kept = f"the last checkpoint in {self.run.folder.checkpoints} is complete"
            raise UserError(f"{where}: {error}; {kept}") from error

    def _update(self) -> None:
        """Makes some of the updates that are owed."""
        run = self.run
        count = min(int(run.counts.owed), UPDATES_PER_MOVE)
        with run.clock.updating():
            metrics = run.learner.update(count)
        run.counts.owed -= count
        run.metrics.add_updates(metrics, count)

    def _report(self) -> None:
        """Evaluates when it is time to, and writes a row of metrics."""
        run, counts = self.run, self.run.counts
        scores = self._validate() if run.validation_due else None
        row = run.metrics.row(run.progress, scores)
        self.log.add(row)
        self.monitor.check_saturation(row["saturated_share"])
        counts.last_row = counts.steps
        counts.next_row = _next_multiple(run.row_period, counts.steps)

    def _validate(self) -> Scores:
        """Runs the validation list; keeps the policy if it is the best so far."""
        run, counts, weights = self.run, self.run.counts, self.run.learner.policy_weights()
        scores = self._evaluate(weights, run.validation_list)
        candidate = Best(counts.steps, scores, weights)
        better = run.best is None or candidate.rank > run.best.rank
        if better:
            run.best = candidate
            save_policy(run.folder.policy, weights, run.description(scores))
        self.monitor.validation(counts.steps, scores, best=better)
        counts.passed = counts.passed + 1 if scores.success_rate >= run.limits.until else 0
        counts.last_validation = counts.steps
        counts.next_validation = _next_multiple(run.config.validation.every_steps, counts.steps)
        return scores

    def _evaluate(self, weights: Weights, scenarios: ScenarioList) -> Scores:
        """Runs a list as `navrl eval` does; a signal ends it without a trace."""
        run = self.run
        policy = Policy(weights, run.description(None))
        threads = run.config.threads.simulate or cores()
        # The learner flushes denormal numbers to zero; evaluation elsewhere does not.
        with flushed_denormals(False), run.clock.evaluating(), self.interruption.at_once():
            return evaluate(policy, scenarios, sim=run.config.sim, num_threads=threads).summary

    def _finish(self) -> None:
        """Saves, tests the best policy and writes the summary."""
        run = self.run
        run.save(self.log)
        run.wait_until_saved()
        if run.best is None:
            raise AssertionError("a run ends with a validation")
        scores = self._evaluate(run.best.weights, run.load_list("test")) if run.test else None
        save_policy(run.folder.policy, run.best.weights, run.description(scores or run.best.scores))
        summary = run.summary(scores)
        run.folder.write_summary(summary)
        self.monitor.close()
        print("\n".join(result_lines(summary, run.folder.path, run.config.world.name)), flush=True)

    def _save_and_leave(self) -> None:
        """Saves where a signal came.

        Raises:
            Interrupted: Always; its text says how to resume.
        """
        self.monitor.line("stopping; Ctrl+C again leaves at once, with the last checkpoint")
        self.run.save(self.log)
        self.run.wait_until_saved()
        self.monitor.close()
        folder = self.run.folder.path
        message = f"stopped after {self.run.counts.steps:,} steps and saved; resume with: navrl train --resume {folder}"
        self.monitor.line(message)
        raise Interrupted(message)


def _introduction(run: Run) -> str:
    """One line: robots, threads and memory."""
    robots, learn = run.config.training.num_envs, run.config.threads.learn
    memory = available_memory()
    available = "" if memory is None else f" of {memory / 1e6:,.0f} MB free"
    return (
        f"{robots} {'robot' if robots == 1 else 'robots'}; threads: simulate {run.threads}, learn {learn}; "
        f"replay up to {run.replay_bytes / 1e6:,.0f} MB{available}"
    )


def _next_multiple(period: int, steps: int) -> int:
    """The smallest multiple of `period` above `steps`."""
    return (steps // period + 1) * period
