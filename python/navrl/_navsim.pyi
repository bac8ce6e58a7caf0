"""The Rust core, as navrl sees it. Configurations are JSON texts with every key given; see navrl.batch."""

from collections.abc import Sequence
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "SATURATED",
    "Actor",
    "BatchSim",
    "Controller",
    "Learner",
    "Lookahead",
    "Scenario",
    "UpdateRecord",
    "check_world",
    "draw_list",
    "isa",
    "needs_detour",
    "plan",
    "read_list",
    "shortest_path",
]

SATURATED: float
"""|input of the actor's tanh| beyond which an output counts as saturated: |output| > 0.99, gradient under 0.02."""

class BatchSim:
    def __new__(
        cls,
        config: str,
        num_envs: int,
        seed: int,
        num_threads: int,
        autoreset: bool,
        scenarios: Sequence[Scenario] | None,
        first: int,
    ) -> Self: ...
    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Begins the next episode of all robots, or of those whose mask (num_envs,) is true."""
    def step(self, actions: NDArray[np.float32]) -> None:
        """Drives every robot for one control period; actions (num_envs, 2) are clipped to [-1, 1] (equation 6).

        Raises:
            TypeError: Not a float32 array.
            ValueError: Another shape, NaN or infinity; nothing has moved then.
        """
    def state(self) -> bytes:
        """Everything that the future depends on besides the arguments of the constructor."""
    def restore(self, state: bytes) -> None:
        """Continues bit for bit where `state` was taken, in a simulator made with the same arguments."""
    def scenario(self, robot: int) -> Scenario:
        """What this robot meets in its present episode."""
    @property
    def num_envs(self) -> int: ...
    @property
    def observation_size(self) -> int: ...
    @property
    def observations(self) -> NDArray[np.float32]: ...
    @property
    def rewards(self) -> NDArray[np.float32]: ...
    @property
    def terminated(self) -> NDArray[np.bool_]: ...
    @property
    def truncated(self) -> NDArray[np.bool_]: ...
    @property
    def final_observations(self) -> NDArray[np.float32]: ...
    @property
    def outcome(self) -> NDArray[np.uint8]: ...
    @property
    def ranges(self) -> NDArray[np.float32]: ...
    @property
    def poses(self) -> NDArray[np.float64]: ...
    @property
    def odometry(self) -> NDArray[np.float64]: ...
    @property
    def clearances(self) -> NDArray[np.float32]: ...
    @property
    def goals(self) -> NDArray[np.float64]: ...
    @property
    def velocities(self) -> NDArray[np.float64]: ...
    @property
    def episode_returns(self) -> NDArray[np.float64]: ...
    @property
    def episode_steps(self) -> NDArray[np.uint32]: ...
    @property
    def episode_path(self) -> NDArray[np.float64]: ...
    @property
    def episode_clearance(self) -> NDArray[np.float64]: ...
    @property
    def episodes(self) -> NDArray[np.uint64]: ...

class Controller:
    def __new__(cls, name: str, settings: str, sim: str, seed: int) -> Self: ...
    def forget(self) -> None:
        """Forgets all robots: their next decision is the first."""
    def commands(
        self,
        ranges: NDArray[np.float32],
        goal: NDArray[np.float64],
        velocity: NDArray[np.float64],
        robots: NDArray[np.uint32] | None,
    ) -> NDArray[np.float64]:
        """Commands (N, 2) for ranges (N, beams), goal (N, 2), velocity (N, 2) and robots (N,).

        Raises:
            TypeError: Another dtype.
            ValueError: Another shape, a goal or velocity that is no finite number, a negative distance.
        """

@final
class UpdateRecord:
    """What one update tells."""

    @property
    def critic_loss(self) -> float:
        """Mean squared error of the critics' values, summed over the critics."""
    @property
    def average_q(self) -> float:
        """Mean value over batch and critics."""
    @property
    def maximum_q(self) -> float:
        """Largest value."""
    @property
    def actor_loss(self) -> float:
        """NaN without an actor step, as the next."""
    @property
    def saturated_share(self) -> float:
        """Share of the actor's outputs beyond `SATURATED`."""

@final
class Actor:
    """A trained actor; each layer is (inputs, outputs, place of W, place of b) in its parameters (n,) float32.

    With (permutation, signs) of an observation's mirror it answers by tanh of the mean of its outputs for an
    observation and, mirrored back, for the mirrored one.

    Raises:
        ValueError: Layers that do not follow each other or lie beyond the parameters, a mirror of other columns.
    """

    def __new__(
        cls,
        places: Sequence[tuple[int, int, int, int]],
        parameters: NDArray[np.float32],
        mirror: tuple[Sequence[int], Sequence[float]] | None,
    ) -> Self: ...
    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (n, 2) in [-1, 1] for encoded observations (n, inputs), the same bits for a row in any batch.

        Raises:
            TypeError: An array of another type.
            ValueError: Another shape, or not contiguous.
        """

@final
class Learner:
    """Updates of the networks of one learner; each layer is (inputs, outputs, place of W, place of b) in its vector.

    Raises:
        ValueError: Sizes that do not fit each other.
    """

    def __new__(
        cls,
        *,
        double: bool,
        actor: Sequence[tuple[int, int, int, int]],
        critic: Sequence[tuple[int, int, int, int]],
        action_weight: int,
        critics: int,
        batch: int,
        sizes: Sequence[int],
        policy_delay: int,
        tau: float,
        pretanh_penalty: float,
        bounds: Sequence[float],
        frozen_combined: bool,
        mirror: tuple[Sequence[int], Sequence[float]] | None,
        threads: int,
    ) -> Self: ...
    def set_room(self, room: bool) -> None:
        """Tells, also during updates, whether there is a processor for their second thread; at first there is."""

    def update(
        self,
        *,
        actor: Sequence[NDArray[Any]],
        critic: Sequence[NDArray[Any]],
        rates: Sequence[float],
        steps: Sequence[int],
        replay: NDArray[np.float32],
        indices: NDArray[np.int64],
        mirrored: NDArray[np.bool_],
        noise: NDArray[np.float32],
    ) -> tuple[list[UpdateRecord], bool]:
        """One update for each batch of indices; `actor` and `critic` are parameters, targets, first and second moments.

        Returns:
            A record for each update, and whether the next ones are made by one thread because the machine is busy.

        Raises:
            ArithmeticError: NaN or infinity.
            TypeError: An array of another type, or not contiguous.
            ValueError: Another size, or vectors that overlap.
        """

    def act(self, *, actor: NDArray[Any], observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (n, 2) of the actor with these parameters for observations (n, inputs), also during updates.

        Raises:
            TypeError: An array of another type, or not contiguous.
            ValueError: Another size.
        """

@final
class Scenario:
    """Start, goal and obstacles as a value, in metres and radians; the keys of a scenario list are its arguments.

    Raises:
        ValueError: A number that is not finite or out of range, a shape without extent, a polygon that is not convex.
    """

    def __new__(
        cls,
        *,
        start: Sequence[float],
        goal: Sequence[float],
        goal_radius: float,
        time_limit: float,
        circles: Sequence[Sequence[float]] = ...,
        boxes: Sequence[Sequence[float]] = ...,
        segments: Sequence[Sequence[float]] = ...,
        polygons: Sequence[Sequence[Sequence[float]]] = ...,
        shortest: float | None = None,
    ) -> Self: ...
    @classmethod
    def from_json(cls, line: str) -> Self:
        """Reads one line of a scenario list."""
    def to_json(self) -> str:
        """One line of a scenario list; reads back to an equal scenario."""
    @property
    def start(self) -> tuple[float, float, float]: ...
    @property
    def goal(self) -> tuple[float, float]: ...
    @property
    def goal_radius(self) -> float: ...
    @property
    def time_limit(self) -> float: ...
    @property
    def shortest(self) -> float | None: ...
    @property
    def circles(self) -> list[tuple[float, float, float]]: ...
    @property
    def boxes(self) -> list[tuple[float, float, float, float, float]]: ...
    @property
    def segments(self) -> list[tuple[float, float, float, float]]: ...
    @property
    def polygons(self) -> list[list[tuple[float, float]]]: ...
    def __hash__(self) -> int: ...
    def __eq__(self, value: object, /) -> bool: ...
    def __ne__(self, value: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

def draw_list(config: str, split: str, first: int, count: int, seed: int) -> list[Scenario]:
    """Scenarios first to first + count - 1 of a split of the configured world."""

def read_list(text: str, config: str) -> tuple[list[tuple[int, Scenario]], list[tuple[int, str]]]:
    """Reads JSON Lines: (line, scenario) of those that the configured robot can run, (line, reason) of the others."""

def shortest_path(scenario: Scenario, radius: float) -> float | None:
    """Length (m) of the shortest path of a disc of that radius from the start to the goal circle; None without one."""

def needs_detour(scenario: Scenario, radius: float) -> bool:
    """Whether the segment from start to goal, swept by a disc of that radius, touches an obstacle."""

def plan(
    scenario: Scenario, planner: str, radius: float, config: str, seed: int, index: int
) -> tuple[str, NDArray[np.float64], float, float, int, float]:
    """Status, path (K, 2) m, length (m), clearance (m), expansions and time (s); see navrl.planners.plan."""

class Lookahead:
    def __new__(cls, paths: Sequence[NDArray[np.float64]], goals: NDArray[np.float64], distance: float) -> Self: ...
    def update(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Moves the robots at positions (N, 2) on along their paths and returns their intermediate goals (N, 2), m.

        Raises:
            TypeError: Not a float64 array.
            ValueError: Another shape, NaN or infinity; nothing has changed then.
        """
    @property
    def progress(self) -> NDArray[np.float64]:
        """(N,) how far each robot has come along its path, m."""

def check_world(config: str) -> float:
    """Refuses a configuration whose world cannot hold its robot; returns the cut-off share of the world's free area."""

def isa() -> str:
    """Instruction set of the scan kernels: baseline, avx2 or avx512."""
