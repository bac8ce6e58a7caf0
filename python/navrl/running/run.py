"""What a training run consists of, and how it is saved and restored; `navrl.train` makes its moves.

Run(config, folder, preset=, test=)              a run that has not begun
Run.restored(folder, inexact=)                   a run where its newest checkpoint left it
    .start_from(policy);  .extend(steps);  .drive(actions)
    .save(log);  .wait_until_saved()
    .share, .ended_by, .progress
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import torch
from numpy.typing import NDArray

from navrl.batch import BatchSim
from navrl.config import Config
from navrl.encoding import encode_observations, encoded_size
from navrl.errors import UserError
from navrl.exploration import Exploration
from navrl.machine import Machine, available_memory, cores
from navrl.metrics import Scores
from navrl.native import learn_threads
from navrl.policy import Policy, Weights
from navrl.policy_description import PolicyDescription
from navrl.replay import Arrays, NonFiniteError, NStepAssembler, Replay, row_width
from navrl.running.checkpoint import CheckpointError, Checkpoints, Saved
from navrl.running.clock import RunClock
from navrl.running.counts import Counts, Limits
from navrl.running.folder import RunFolder
from navrl.running.metrics_log import MetricsLog, ResumePoint
from navrl.running.training_metrics import Progress, TrainingMetrics
from navrl.scenarios import ScenarioList, load_list
from navrl.td3 import TD3, flushed_denormals

ROWS_PER_VALIDATION = 5
"""Rows of metrics.csv from one validation to the next."""
VALIDATIONS_TO_STOP = 2
"""Validations in a row at or above training.until that end a run."""


class Best(NamedTuple):
    """The best policy so far: the highest success rate on the validation list, then the highest SPL, then the first."""

    steps: int
    scores: Scores
    weights: Weights

    @property
    def rank(self) -> tuple[float, float]:
        """What decides."""
        return self.scores.success_rate, self.scores.spl


class _Part(Protocol):
    """A part of a run that can be saved."""

    def state(self) -> Arrays: ...

    def restore(self, state: Arrays) -> None: ...


class Run:
    """The parts of a training run."""

    def __init__(self, config: Config, folder: RunFolder, *, preset: str, test: bool) -> None:
        """Builds all parts of a run that has not begun; nothing is written.

        Args:
            config: All settings.
            folder: Where the run is kept.
            preset: Name of the settings.
            test: Whether to test the best policy at the end.

        Raises:
            UserError: Memory is too small for replay, or the world cannot hold the robot.
        """
        self.config, self.folder, self.preset, self.test = config, folder, preset, test
        self.machine, self.inexact = Machine.here(config), False
        training, every_steps = config.training, config.validation.every_steps
        self.row_period = max(1, every_steps // ROWS_PER_VALIDATION)
        self.plan = Limits(training.steps, training.episodes, training.until)
        """What was to end the run when it began: the step sizes follow it."""
        self.limits = self.plan
        self.learn_threads = learn_threads(config)
        self.threads = config.threads.simulate or max(1, cores() - self.learn_threads)
        inputs = encoded_size(config.lidar.bins, config.networks.encoding)
        # Beside the native kernel little is left to torch, and its threads would only wait for each other.
        torch.set_num_threads(self.learn_threads if self.machine.kernel == "torch" else 1)
        self.replay_bytes = _replay_bytes(self.limits.steps, config.replay.capacity, row_width(inputs))
        try:
            self.sim = BatchSim(config.sim, num_envs=training.num_envs, seed=training.seed, num_threads=self.threads)
        except ValueError as error:
            raise UserError(str(error)) from None
        self.validation_list = self.load_list("validation", config.validation.scenarios)
        try:
            self.replay = Replay(config.replay.capacity, row_width(inputs))
        except MemoryError:
            raise UserError(f"replay.capacity = {config.replay.capacity}: so many rows cannot be reserved") from None
        # As the moves will be made; the simulator above keeps denormal numbers.
        with flushed_denormals():
            self.learner = TD3(config, self.replay)
            self.encoded = self.encode(self.sim.observations)
            """(num_envs, inputs) what the robots see now."""
        self.exploration = Exploration(config.exploration, num_envs=training.num_envs, seed=training.seed)
        self.assembler = NStepAssembler(
            config.learner, num_envs=training.num_envs, encoded_size=inputs, goal_reward=config.reward.goal
        )
        self.metrics = TrainingMetrics(training.num_envs, config.learner.reward_scale)
        self.counts = Counts(next_row=self.row_period, next_validation=every_steps)
        self.best: Best | None = None
        self.clock = RunClock()
        self.checkpoints = Checkpoints(folder.checkpoints)
        self.log_from: ResumePoint | None = None
        """Where metrics.csv continues."""
        self._writer = ThreadPoolExecutor(1, "checkpoint")
        self._writing: Future[None] | None = None
        self.next_save = 0.0
        """Moment of the monotonic clock at which the next checkpoint is due."""

    @classmethod
    def restored(cls, folder: RunFolder, *, inexact: bool) -> Self:
        """Builds a run and puts it where its newest checkpoint left it.

        Args:
            folder: Folder of the run.
            inexact: Go on even where the bits may differ.

        Raises:
            UserError: No checkpoint is sound, its settings were edited, or bits would differ.
        """
        saved = Checkpoints(folder.checkpoints).newest()
        record = saved.record
        config = folder.edited_config(folder.config(record["config"]))
        run = cls(config, folder, preset=record["preset"], test=record["test"])
        differences = Machine(**record["environment"]).differences(run.machine)
        if differences and not inexact:
            raise CheckpointError(
                f"{folder.path}: the run began elsewhere, and its bits would change here: {'; '.join(differences)}; "
                "--inexact resumes it all the same"
            )
        run.inexact = record["inexact"] or bool(differences)
        try:
            with flushed_denormals():
                run._restore(saved)
        except (KeyError, ValueError, TypeError) as error:
            raise CheckpointError(f"{folder.checkpoints}, checkpoint {saved.number}: does not fit: {error}") from None
        return run

    def _restore(self, saved: Saved) -> None:
        record, arrays = saved.record, saved.arrays
        saved.restore_replay(self.replay)
        for name, part in self._parts.items():
            part.restore(_under(name, arrays))
        self.sim.restore(arrays["simulator"].tobytes())
        self.encoded = self.encode(self.sim.observations)
        self.counts = Counts(**record["counts"])
        self.limits = Limits(**record["limits"])
        self.clock.resume(record["clock"])
        if record["best"] is not None:
            scores: dict[str, Any] = record["best"]["scores"]
            scores |= {key: tuple(value) for key, value in scores.items() if isinstance(value, list)}
            weights = {name: array.astype(np.float32) for name, array in _under("best", arrays).items()}
            self.best = Best(record["best"]["steps"], Scores(**scores), weights)
        self.log_from = ResumePoint(record["log_bytes"], self.counts.last_row)

    @property
    def _parts(self) -> dict[str, _Part]:
        return {
            "learner": self.learner,
            "replay": self.replay,
            "assembler": self.assembler,
            "exploration": self.exploration,
            "metrics": self.metrics,
        }

    def save(self, log: MetricsLog) -> None:
        """Takes a checkpoint and lets another thread write it while the run goes on; first waits for the one before.

        Args:
            log: Its rows so far are made durable first, so that a resumed run finds them.

        Raises:
            CheckpointError: The disk refused the checkpoint before; the one before that is complete.
        """
        self.wait_until_saved()
        arrays: dict[str, NDArray[Any]] = {"simulator": np.frombuffer(self.sim.state(), np.uint8)}
        for name, part in self._parts.items():
            arrays |= {f"{name}/{key}": array for key, array in part.state().items()}
        best = None
        if self.best is not None:
            arrays |= {f"best/{key}": array for key, array in self.best.weights.items()}
            best = {"steps": self.best.steps, "scores": self.best.scores.to_json()}
        record = {
            "preset": self.preset,
            "test": self.test,
            "inexact": self.inexact,
            "environment": asdict(self.machine),
            "config": self.folder.tables(self.config),
            "counts": asdict(self.counts),
            "limits": self.limits._asdict(),
            "best": best,
            "log_bytes": log.sync(),
            "clock": self.clock.state(),
        }
        write = self.checkpoints.prepare(record, arrays, self.replay, keep=self.config.checkpoint.keep)
        self._writing = self._writer.submit(write)
        self.next_save = time.monotonic() + self.config.checkpoint.every_s

    def wait_until_saved(self) -> None:
        """Waits until the newest checkpoint is on the disk.

        Raises:
            CheckpointError: The disk refused it; the one before is complete.
        """
        writing, self._writing = self._writing, None
        if writing is not None:
            writing.result()

    def start_from(self, policy: Policy) -> None:
        """Takes the actor of a policy as the first one.

        Args:
            policy: Of the same networks and lidar bins.

        Raises:
            UserError: It does not fit.
        """
        self.description(None).check_first(policy.description)
        weights = {name: torch.from_numpy(array) for name, array in policy.weights.items()}
        for actor in (self.learner.actor, self.learner.actor_target, self.learner.averaged_actor):
            actor.load_state_dict(weights)

    def extend(self, steps: int) -> None:
        """Lets the run end after so many environment steps instead of where it was to end."""
        self.limits = Limits(steps, 0, 0.0 if self.ended_by == "until" else self.limits.until)

    def drive(self, actions: NDArray[np.float32]) -> None:
        """Steps the robots.

        Args:
            actions: (num_envs, 2) in [-1, 1].

        Raises:
            UserError: The world turned out to be too full where a robot was to begin an episode.
            NonFiniteError: An action is NaN or infinite.
        """
        try:
            self.sim.step(actions)
        except ValueError as error:
            if not np.isfinite(actions).all():
                raise NonFiniteError(str(error)) from None
            where = f"training stopped after {self.counts.steps:,} steps"
            raise UserError(f"{where}: {error}; {self.kept}") from error

    def encode(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Encodes observations of the simulator into an array of their own: (num_envs, inputs)."""
        encoded = encode_observations(observations, self.config.networks.encoding)
        return encoded.copy() if encoded is observations else encoded

    def load_list(self, name: Any, count: int | None = None) -> ScenarioList:  # noqa: ANN401 - see load_list
        """A built-in list of scenarios in the run's world."""
        return load_list(self.config.sim, name, count=count, num_threads=cores())

    def description(self, scores: Scores | None) -> PolicyDescription:
        """Describes a policy of this run."""
        return PolicyDescription.from_config(self.config, None if scores is None else scores.to_json())

    @property
    def kept(self) -> str:
        """What is left of the run when an error ends it."""
        saved = self.checkpoints.numbers()
        return f"the last checkpoint in {self.folder.checkpoints} is complete" if saved else "nothing was saved"

    @property
    def progress(self) -> Progress:
        """How far the run is."""
        return Progress(self.counts.steps, self.metrics.episodes, self.learner.updates, self.clock.train_s)

    @property
    def share(self) -> float:
        """Share of the run that is over, in [0, 1]."""
        return self.limits.share(self.counts.steps, self.metrics.episodes)

    @property
    def ended_by(self) -> str:
        """What ended the run: "until", "episodes", "steps", or nothing yet."""
        limits = self.limits
        if limits.until and self.counts.passed >= VALIDATIONS_TO_STOP:
            return "until"
        if limits.episodes and self.metrics.episodes >= limits.episodes:
            return "episodes"
        return "steps" if limits.steps and self.counts.steps >= limits.steps else ""

    @property
    def report_due(self) -> bool:
        """Whether a row of metrics has to be written: every so many steps, and at the end."""
        counts = self.counts
        return counts.steps >= counts.next_row or bool(self.ended_by and counts.last_row < counts.steps)

    @property
    def validation_due(self) -> bool:
        """Whether the policy has to be validated: every so many steps, and at the end."""
        counts = self.counts
        return counts.steps >= counts.next_validation or bool(self.ended_by and counts.last_validation < counts.steps)

    @property
    def complete(self) -> bool:
        """Whether no move is left."""
        return bool(self.ended_by) and self.counts.owed < 1.0 and not self.report_due


def _under(name: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """The arrays whose names begin with `name/`, without it."""
    return {key.removeprefix(f"{name}/"): array for key, array in arrays.items() if key.startswith(f"{name}/")}


def _replay_bytes(steps: int, capacity: int, width: int) -> int:
    """Memory that replay will take (bytes).

    Args:
        steps: Where the run ends, 0 if unknown; one row a step at most.
        capacity: Most rows.
        width: Columns of a row.

    Raises:
        UserError: There is not so much.
    """
    rows = min(capacity, steps) if steps else capacity
    needed, available = rows * width * 4, available_memory()
    if available is not None and needed > available:
        raise UserError(
            f"replay.capacity = {capacity}: {rows:,} rows take {needed / 1e6:,.0f} MB, but {available / 1e6:,.0f} MB "
            f"of memory are available; at most {available // (width * 4)} rows fit"
        )
    return needed
