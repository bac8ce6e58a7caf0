"""Who takes part in a comparison: a contender has a name, a pilot that drives, and maybe a planner that leads it.

    contender = enter("default+astar")                          a name, read; policies are loaded
    contender = enter("mine+astar", my_controller)              a pilot of yours, with or without a planner
    plans = list(contender.plans(scenarios, sim, config))       the paths that lead it
    drive = contender.driver(scenarios, plans, sim, controllers, config)    what the evaluator calls in every period

Only a contender with a planner gets the map, and only the planner reads it: the pilot has its scan, the goal that it is
led to, and its own speed, as all others have.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navrl.comparing.pilot_errors import naming
from navrl.config.levels import REAL, Level
from navrl.controllers import NAMES as CONTROLLERS
from navrl.controllers import Controller
from navrl.controllers import Name as ControllerName
from navrl.errors import UserError
from navrl.evaluate import Driver, Pilot, Towards, check_same, driver, own_sim
from navrl.planners import PLANNERS, Lookahead, Plan, Planner, plan
from navrl.policy import Policy, load_policy
from navrl.scenarios import robot_radius

if TYPE_CHECKING:
    from navrl.batch import BatchSim, Scenario
    from navrl.config import ControllersConfig, PlannerConfig, SimConfig


@dataclass(frozen=True)
class Contender:
    """Who takes part, before it knows its robot."""

    name: str
    """As typed."""
    pilot: Pilot | ControllerName
    """What drives: a policy, the name of a controller, or what the user gave under the contender's name."""
    planner: Planner | None
    """Who leads the pilot on the map, if anybody."""

    @property
    def policy(self) -> Policy | None:
        """The policy that drives, if one does."""
        return self.pilot if isinstance(self.pilot, Policy) else None

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
        return isinstance(self.pilot, Policy | str)

    def check(self, sim: SimConfig, level: Level) -> None:
        """Refuses a contender for another robot than that of the comparison, but for what the level sets for all.

        Args:
            sim: The comparison's robot.
            level: The comparison's level.

        Raises:
            UserError: With the first difference.
        """
        if isinstance(self.pilot, str):
            return
        own, apart_from = own_sim(self.pilot), tuple(REAL["robot"]) if level == "real" else ()
        if own is not None:
            try:
                check_same(own, sim, self.pilot, apart_from=apart_from)
            except UserError as error:
                raise UserError(f"{self.name}: {error}") from None

    def plans(self, scenarios: Sequence[Scenario], sim: SimConfig, config: PlannerConfig) -> Iterator[Plan]:
        """The paths that lead it, one for each scenario, planned one after the other; none without a planner.

        Args:
            scenarios: Maps with starts and goals.
            sim: The robot, for its radius.
            config: Settings of the planner.

        Raises:
            UserError: Its cells are too small for so large a map.
        """
        if self.planner is not None:
            for index, scenario in enumerate(scenarios):
                try:
                    yield plan(scenario, self.planner, radius=robot_radius(sim), config=config, index=index)
                except ValueError as error:
                    raise UserError(str(error)) from None

    def driver(
        self,
        scenarios: Sequence[Scenario],
        plans: Sequence[Plan],
        sim: SimConfig,
        controllers: ControllersConfig,
        planner: PlannerConfig,
        *,
        first: int = 0,
    ) -> Driver:
        """What the evaluator calls.

        Args:
            scenarios: Robot k runs scenario k. Of these only the goals are used, and only to end paths at.
            plans: What `plans` gave for them.
            sim: Robot and lidar.
            controllers: Settings.
            planner: Says how far ahead on its path an intermediate goal lies, for "pursuit" `pursuit.lookahead` does.
            first: Place of the first of these scenarios in its list, for what is said when the user's pilot fails.

        Returns:
            The driver.

        Raises:
            UserError: A look-ahead distance of less than a third of the goal's radius.
        """
        pilot = Controller(self.pilot, sim, controllers) if isinstance(self.pilot, str) else self.pilot
        towards = None
        if self.planner is not None:
            distance = (controllers.pursuit if self.pilot == "pursuit" else planner).lookahead
            # A controller that has been so near to its goal in vain looks for it elsewhere.
            least = sim.task.goal_radius / 3
            if distance < least:
                key = "pursuit.lookahead" if self.pilot == "pursuit" else "planner.lookahead"
                raise UserError(f"{key} = {distance}: must be at least {least:.4g}, a third of task.goal_radius")
            goals = np.array([scenario.goal for scenario in scenarios])
            towards = along(Lookahead(plans, goals, distance=distance))
        drive = driver(pilot, sim, towards=towards)
        return drive if self.is_known else naming(drive, self.name, first=first)


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


def enter(name: str, pilot: Pilot | None = None) -> Contender:
    """Reads the name of a contender, or gives a pilot of yours a name.

    Args:
        name: A run folder, a policy folder, "default", a controller, or one of these, "+" and a planner. A name of your
            own, with or without "+" and a planner, for what you give.
        pilot: What drives under that name: a controller as a function or an object, or a policy.

    Returns:
        The contender.

    Raises:
        UserError: No such contender, a damaged policy, or the name of another contender for yours.
        TypeError: What you give is no pilot.
    """
    before, plus, after = name.rpartition("+")
    own, taken = pilot is not None, (*CONTROLLERS, "default")
    if own and (name in taken or before in taken):
        raise UserError(f"{name}: expected a name of your own, none of {', '.join(taken)}")
    if plus and after not in PLANNERS and (own or before in taken):
        raise UserError(f"{name}: expected a planner after the +: {', '.join(PLANNERS)}")
    planner = after if plus and after in PLANNERS else None
    if pilot is not None:
        if not any(callable(getattr(pilot, method, None)) for method in ("act", "command", "__call__")):
            raise TypeError(
                f"{name}: {type(pilot).__name__} is neither a policy with act nor a controller with command"
            )
        return Contender(name, pilot, planner)
    if name == "pursuit":
        raise UserError("pursuit: follows a path: name a planner too, such as pursuit+astar")
    return Contender(name, _known_pilot(name if planner is None else before), planner)


def _known_pilot(name: str) -> Policy | ControllerName:
    if name in CONTROLLERS:
        return name
    try:
        return load_policy(name)
    except UserError as error:
        raise UserError(f"{error}, or a contender of {', '.join(CONTROLLERS)}, with or without +PLANNER") from None
