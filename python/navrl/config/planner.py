"""Settings of the planners: part of the configuration tree."""

from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from navrl.config.faults import STRICT, one_line
from navrl.config.searching import Search

SPACING_MIN = 1e-3
"""Least distance (m) of neighbouring points, if there is one."""


def _spacing(value: float) -> float:
    if 0 < value < SPACING_MIN:
        raise ValueError("points that close would be too many")
    return value


_Spacing = Annotated[
    float, Field(ge=0, le=1000, description="0 or a number in [0.001, 1000]"), AfterValidator(_spacing)
]
_Cell = Annotated[float, Field(ge=1e-3, le=100)]
_Crew = Annotated[int, Field(ge=1, le=10_000)]


@one_line
@dataclass(frozen=True, config=STRICT)
class PlannerConfig:
    """Paths through a known world: `navrl.planners`; each planner reads its own settings."""

    margin: Annotated[float, Field(ge=0, le=100), Search(0.005, 1, log=True)] = 0.1
    """Clearance (m) wanted beyond the radius. Where start, goal or every way is narrower, half of it; then none."""
    resolution: _Cell = 0.05
    """Side of a cell (m) of "astar", "dijkstra" and "fmm"; a map has at most 10 million cells."""
    ant_resolution: _Cell = 0.2
    """Side of a cell (m) of "antcolony": on small cells its ants lose their way; at most 1 million cells."""
    step: Annotated[float, Field(ge=1e-3, le=1000)] = 0.5
    """How far (m) a tree grows towards a sample at most; "rrtstar" then joins its points at any distance."""
    samples: Annotated[int, Field(ge=1, le=10_000_000)] = 5000
    """Samples of "rrtstar"; of "rrt" at most."""
    goal_bias: Annotated[float, Field(ge=0, lt=1)] = 0.05
    """Share of the samples of a tree that are the goal; of "rrtstar" until it has a path."""
    ants: _Crew = 32
    """Ants of a round of "antcolony"."""
    rounds: _Crew = 30
    """Rounds of "antcolony"."""
    evaporation: Annotated[float, Field(gt=0, le=1)] = 0.2
    """Share of a trail of the ants that is lost, and set anew along the best ways, in a round."""
    goal_weight: Annotated[float, Field(ge=0, le=20)] = 2.0
    """How strongly the goal draws ants: a step at an angle a from it has the odds exp(goal_weight cos a)."""
    time_limit: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Longest search (s) of "rrt", "rrtstar" and "antcolony"; 0: none, and then a seed always gives the same path."""
    shortcut: bool = True
    """Whether a path is pulled tight."""
    spacing: _Spacing = 0.1
    """Largest distance (m) of neighbouring points of a path, 0 or at least 0.001; 0 leaves its corners only."""
    lookahead: Annotated[float, Field(ge=1e-3, le=1000), Search(0.2, 5, log=True)] = 1.0
    """How far ahead on its path (m) the intermediate goal of a led contender lies; of `pursuit` `pursuit.lookahead`."""
