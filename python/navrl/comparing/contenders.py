"""Who takes part in a comparison: a policy, a controller, or one of them led along the path of a planner.

    entry = enter("default+astar")                              a name, read; policies are loaded
    entry = enter("mine+astar", my_controller)                  one of yours, with or without a planner
    plans = entry.plans(scenarios, sim, config, ...)            the paths that lead it
    drive = entry.driver(scenarios, plans, sim, controllers)    what the evaluator calls in every period

Only a contender with a planner gets the map, and only the planner reads it: what drives has its scan, the goal that it
is led to, and its own speed, as all others have.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navrl.config.levels import REAL, Level
from navrl.controllers import NAMES, Controller, Name
from navrl.errors import UserError
from navrl.evaluate import Contender, Driver, Towards, check_same, driver, own_sim
from navrl.planners import PLANNERS, Lookahead, Plan, Planner, plan_all
from navrl.policy import Policy, load_policy
from navrl.scenarios import robot_radius

if TYPE_CHECKING:
    from navrl.batch import BatchSim, Scenario
    from navrl.config import ControllersConfig, PlannerConfig, SimConfig

LOOKAHEAD = 1.0
"""How far ahead on the path (m) an intermediate goal lies; for "pursuit" as far as `pursuit.lookahead` says."""


@dataclass(frozen=True)
class Entry:
    """A contender by name, before it knows its robot."""

    name: str
    """As typed."""
    local: Contender | Name
    """What drives: a policy, the name of a controller, or what the user gave under the entry's name."""
    planner: Planner | None
    """Who leads it on the map, if anybody."""

    @property
    def policy(self) -> Policy | None:
        """The policy that drives, if one does."""
        return self.local if isinstance(self.local, Policy) else None

    @property
    def policy_sha256(self) -> str | None:
        """Names the policy by its weights and description; None for controllers."""
        if self.policy is None:
            return None
        digest = hashlib.sha256(repr(self.policy.description).encode())
        for name, tensor in sorted(self.policy.weights.items()):
            digest.update(name.encode() + tensor.tobytes())
        return digest.hexdigest()

    @property
    def is_known(self) -> bool:
        """Whether the same contender can be told from another of its name: not so of what a user gave."""
        return isinstance(self.local, (Policy, str))

    def check(self, sim: SimConfig, level: Level) -> None:
        """Refuses a contender for another robot than that of the comparison, but for what the level sets for all.

        Args:
            sim: The comparison's robot.
            level: The comparison's level.

        Raises:
            UserError: With the first difference.
        """
        if isinstance(self.local, str):
            return
        own, apart_from = own_sim(self.local), tuple(REAL["robot"]) if level == "real" else ()
        if own is not None:
            try:
                check_same(own, sim, self.local, apart_from=apart_from)
            except UserError as error:
                raise UserError(f"{self.name}: {error}") from None

    def plans(
        self, scenarios: Sequence[Scenario], sim: SimConfig, config: PlannerConfig, *, num_threads: int
    ) -> list[Plan]:
        """The paths that lead it, one for each scenario; none without a planner.

        Args:
            scenarios: Maps with starts and goals.
            sim: The robot, for its radius.
            config: Settings of the planner.
            num_threads: Scenarios that are planned at once.
        """
        if self.planner is None:
            return []
        radius = robot_radius(sim)
        return plan_all(scenarios, self.planner, radius=radius, config=config, num_threads=num_threads)

    def driver(
        self, scenarios: Sequence[Scenario], plans: Sequence[Plan], sim: SimConfig, controllers: ControllersConfig
    ) -> Driver:
        """What the evaluator calls.

        Args:
            scenarios: Robot k runs scenario k. Of these only the goals are used, and only to end paths at.
            plans: What `plans` gave for them.
            sim: Robot and lidar.
            controllers: Settings.

        Returns:
            The driver.
        """
        contender = Controller(self.local, sim, controllers) if isinstance(self.local, str) else self.local
        if self.planner is None:
            return driver(contender, sim)
        distance = controllers.pursuit.lookahead if self.local == "pursuit" else LOOKAHEAD
        goals = np.array([scenario.goal for scenario in scenarios])
        return driver(contender, sim, towards=along(Lookahead(plans, goals, distance=distance)))


def along(guide: Lookahead) -> Towards:
    """Leads robots along paths, from where they believe to be.

    Args:
        guide: Paths of all robots of a simulator.

    Returns:
        Distance (m) and angle (rad) of the intermediate goals.
    """

    def towards(simulator: BatchSim, running: NDArray[np.intp]) -> NDArray[np.float64]:
        return guide.goal(simulator.odometry)[running]

    return towards


def enter(name: str, contender: Contender | None = None) -> Entry:
    """Reads the name of a contender, or gives one of yours its name.

    Args:
        name: A run folder, a policy folder, "default", a controller, or one of these, "+" and a planner. A name of your
            own, with or without "+" and a planner, for what you give.
        contender: What drives under that name: a controller as a function or an object, or a policy.

    Returns:
        The contender.

    Raises:
        UserError: No such contender, a damaged policy, or the name of another contender for yours.
    """
    local, plus, planner = name.rpartition("+")
    own, taken = contender is not None, (*NAMES, "default")
    if own and (name in taken or local in taken):
        raise UserError(f"{name}: expected a name of your own, none of {', '.join(taken)}")
    if plus and planner in PLANNERS:
        return Entry(name, _local(local) if contender is None else contender, planner)
    if plus and (own or local in taken):
        raise UserError(f"{name}: expected a planner after the +: {', '.join(PLANNERS)}")
    if contender is not None:
        return Entry(name, contender, None)
    if name == "pursuit":
        raise UserError("pursuit: follows a path: name a planner too, such as pursuit+astar")
    return Entry(name, _local(name), None)


def _local(name: str) -> Policy | Name:
    if name in NAMES:
        return name
    try:
        return load_policy(name)
    except UserError as error:
        raise UserError(f"{error}, or a contender of {', '.join(NAMES)}, with or without +PLANNER") from None
