"""The training loop: act, step, store, update, evaluate, save.

Steps owe updates. One robot with an update phase after each episode makes them before its next step. Many robots with
interleaved updates step beside the updates that the step before owed (`navrl.running.beside`): they act with the
networks as these were before, and the updates draw from replay as it was before. Each turn of the loop makes one move,
after which the run can be saved; a run that is resumed there, in whatever process, makes the same moves to the same
bits. `navrl.running.run` holds the parts of a run, `navrl.running.session` begins, resumes and ends it.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from navrl.evaluate import evaluate
from navrl.machine import cores
from navrl.metrics import Scores
from navrl.policy import Policy, Weights, save_policy
from navrl.replay import NonFiniteError, Transition
from navrl.running.beside import Beside
from navrl.running.interrupt import Interruption
from navrl.running.metrics_log import MetricsLog
from navrl.running.monitor import Monitor
from navrl.running.run import Best, Run
from navrl.scenarios import ScenarioList
from navrl.td3 import flushed_denormals

UPDATES_PER_MOVE = 8
"""Most updates between two moments at which a run can be saved and stopped: 0.1 s with the largest usual networks."""


class Training:
    """The moves of a run, and where they are shown, logged and interrupted."""

    _beside: Beside
    """Where the robots step."""

    def __init__(self, run: Run, *, log: MetricsLog, monitor: Monitor, interruption: Interruption) -> None:
        """Moves nothing yet.

        Args:
            run: Its parts are its own.
            log: Takes the rows of metrics.
            monitor: Shows them.
            interruption: Tells when to stop.
        """
        self.run, self.log, self.monitor, self.interruption = run, log, monitor, interruption
        self._said_busy = False

    def loop(self) -> None:
        """Makes one move after the other until the run has ended.

        Raises:
            KeyboardInterrupt: The user wants to stop; the run can be saved as it is.
            NonFiniteError: NaN or infinity.
        """
        self.run.clock.start()
        with Beside(self.monitor.line, self.run.learner.set_room) as self._beside:
            while self._move():
                pass

    def _move(self) -> bool:
        """Makes a move; returns whether another one follows."""
        run, monitor = self.run, self.monitor
        if self.interruption.requested:
            raise KeyboardInterrupt
        if time.monotonic() >= run.next_save:
            run.save(self.log)
        if monitor.due:
            monitor.show(run.progress, run.metrics.rates(), run.share)
        if self._updates_first:
            self._update()
        elif run.report_due:
            self._report()
        elif run.ended_by:
            return False
        else:
            self._step()
        return True

    @property
    def _updates_first(self) -> bool:
        """Whether updates are owed that cannot be made beside the next step: too many, or there is none."""
        run = self.run
        beside = run.config.training.update_schedule == "interleaved" and not run.ended_by
        return run.counts.owed >= 1.0 + (UPDATES_PER_MOVE if beside else 0)

    def _step(self) -> None:
        """Lets the robots act and step while it makes updates; stores what they met, and owes updates for it."""
        run, counts = self.run, self.run.counts
        run.learner.begin_step()
        # Act and step
        rows = self._beside.do(self._drive, self._update) if counts.owed >= 1.0 else self._drive()
        # Store
        run.replay.add(rows)
        # Owe updates
        training, sim = run.config.training, run.sim
        if counts.steps >= run.config.exploration.random_steps and run.replay.size > 0:
            interleaved = training.update_schedule == "interleaved"
            ended = sim.terminated | sim.truncated
            counts.owed += training.updates_per_step if interleaved else int(sim.episode_steps[ended].sum())
        run.learner.set_progress(run.plan.share(counts.steps, run.metrics.episodes))

    def _drive(self) -> NDArray[np.float32]:
        """Lets the robots act and step; returns rows of replay (n, width).

        Of counts and metrics it changes the steps and what episodes tell, updates what is owed and what they tell.
        """
        run, sim = self.run, self.run.sim
        actions = run.exploration.explore(run.learner.act(run.encoded), sim.observations, run.counts.steps)
        run.drive(actions)
        run.counts.steps += sim.num_envs
        run.exploration.end_episodes(sim.terminated | sim.truncated)
        run.metrics.add_step(sim)
        transition = Transition(
            observations=run.encoded,
            actions=actions,
            rewards=sim.rewards,
            successors=run.encode(sim.final_observations),
            terminated=sim.terminated,
            truncated=sim.truncated,
            outcome=sim.outcome,
        )
        rows = run.assembler.push(transition)
        run.encoded = run.encode(sim.observations)
        if not np.isfinite(run.encoded).all():
            robot = int(np.argwhere(~np.isfinite(run.encoded))[0, 0])
            raise NonFiniteError(f"observation of robot {robot} is not finite: {sim.observations[robot]}")
        return rows

    def _update(self) -> None:
        """Makes some of the updates that are owed."""
        run = self.run
        count = min(int(run.counts.owed), UPDATES_PER_MOVE)
        with run.clock.updating():
            metrics = run.learner.update(count)
        run.counts.owed -= count
        run.metrics.add_updates(metrics, count)
        if run.learner.busy and not self._said_busy:
            self.monitor.line("the machine is busy: one thread learns for a while, with the same results")
            self._said_busy = True

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
        scores = self.evaluate(weights, run.validation_list)
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

    def evaluate(self, weights: Weights, scenarios: ScenarioList) -> Scores:
        """Runs a list as `navrl eval` does; a signal ends it without a trace.

        Args:
            weights: Of the policy's actor.
            scenarios: Each runs once.

        Raises:
            KeyboardInterrupt: A signal came.
        """
        run = self.run
        policy = Policy(weights, run.description(None))
        threads = run.config.threads.simulate or cores()
        # The learner flushes denormal numbers to zero; evaluation elsewhere does not.
        with flushed_denormals(False), run.clock.evaluating(), self.interruption.at_once():
            return evaluate(policy, scenarios, sim=run.config.sim, num_threads=threads).summary


def _next_multiple(period: int, steps: int) -> int:
    """The smallest multiple of `period` above `steps`."""
    return (steps // period + 1) * period
