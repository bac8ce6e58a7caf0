"""Settings of the classical controllers: part of the configuration tree, with the ranges that `navrl tune` searches.

Not searched are: weights that are the unit of the others (`dwa.heading`, `gap.goal`, `mppi.goal`), numbers of samples,
and the margins, which are there for what a scan cannot show.
"""

from typing import Annotated, Literal, get_args

from pydantic import Field
from pydantic.dataclasses import dataclass

from navrl.config.faults import STRICT, one_line
from navrl.config.searching import Search

_Weight = Field(ge=0, le=1e6)
_Gain = Field(ge=0, le=1000)
_Distance = Field(ge=1e-3, le=1000)
_Margin = Annotated[float, Field(ge=0, le=10)]


@one_line
@dataclass(frozen=True, config=STRICT)
class DwaConfig:
    """Dynamic window `dwa` (Fox, Burgard, Thrun 1997).

    `dwa-1997` has the weights 2, 0.2 per metre as far as the lidar sees and 0.2, horizon 1 s, interval 0.25 s; of this
    table the margin, the reaction and the samples.

    Found by `navrl tune dwa --world mixed --trials 150 --episodes 300`: trial 144, 181 s of CPU, seed 0. It began with
    clearance 31.7, speed 7.025, horizon 2.98, clearance_max 2.78, reaction 0.4106, of 200 trials among 16 boxes.
    The interval, which does nothing where accelerations have no limits, was set by hand.
    """

    heading: Annotated[float, _Weight] = 1.0
    """Weight of the share of a half turn by which the robot at the horizon looks to the goal."""
    clearance: Annotated[float, _Weight, Search(0.01, 1000, log=True)] = 144.0
    """Weight of the free way along the arc as a share of clearance_max."""
    speed: Annotated[float, _Weight, Search(0.01, 1000, log=True)] = 327.4
    """Weight of the forward speed as a share of v_max."""
    horizon: Annotated[float, Field(ge=1e-3, le=60), Search(0.1, 20, log=True)] = 0.2355
    """Time after which the heading is judged (s); at most half the way to the goal."""
    clearance_max: Annotated[float, _Distance, Search(0.1, 10, log=True)] = 4.966
    """A free way of this length (m), or to the goal, counts in full."""
    margin: _Margin = 0.02
    """Added to the robot's radius (m): the end of a wall can hide between two beams."""
    reaction: Annotated[float, Field(ge=0, le=10), Search(0.01, 3, log=True)] = 0.962
    """Time (s) that a command acts before the robot can brake."""
    interval: Annotated[float, Field(ge=1e-3, le=10), Search(0.02, 3, log=True)] = 0.4
    """Time (s) in which the speeds of the window can be reached; without acceleration limits all are at once."""
    v_samples: Annotated[int, Field(ge=2, le=1001)] = 11
    """Forward speeds that are tried, from the window's smallest to its largest."""
    omega_samples: Annotated[int, Field(ge=2, le=1001)] = 21
    """Turning speeds that are tried, from the window's smallest to its largest."""


@one_line
@dataclass(frozen=True, config=STRICT)
class ApfConfig:
    """Artificial potential field `apf` (Khatib 1986): an attraction of 1 and the repulsion of all beams.

    Found by `navrl tune apf --world mixed --trials 150 --episodes 300`: trial 72, 38 s of CPU, seed 0. It began with
    repulsion 0.002932, reach 1.357, turn_gain 0.6484, of 40 trials among 16 boxes.
    """

    repulsion: Annotated[float, _Weight, Search(1e-5, 10, log=True)] = 0.006824
    """Weight of the repulsion (m^2 per radian of beams)."""
    reach: Annotated[float, _Distance, Search(0.05, 10, log=True)] = 5.283
    """Clearance at which the repulsion begins (m)."""
    turn_gain: Annotated[float, _Gain, Search(0.05, 50, log=True)] = 15.92
    """Turning speed per angle to the force (1/s)."""


@one_line
@dataclass(frozen=True, config=STRICT)
class GapConfig:
    """Gap following `gap` in the manner of VFH+ (Ulrich, Borenstein 1998).

    Found by `navrl tune gap --world mixed --trials 150 --episodes 300`: trial 145, 148 s of CPU, seed 0. It began with
    reach 1.613, heading 0.7139, border 0.2857, turn_gain 3.455, slow_distance 0.6331, of 100 trials among 16 boxes.
    """

    reach: Annotated[float, _Distance, Search(0.1, 10, log=True)] = 1.524
    """A direction is free if the robot can drive so far in it (m), or to the goal."""
    margin: _Margin = 0.02
    """Added to the robot's radius (m)."""
    goal: Annotated[float, _Weight] = 1.0
    """Cost of a direction per angle to the goal (1/rad)."""
    heading: Annotated[float, _Weight, Search(0.005, 50, log=True)] = 0.7304
    """Cost of a direction per angle to the heading (1/rad)."""
    border: Annotated[float, Field(ge=0, le=3.2), Search(0, 1.6)] = 1.29
    """How far from the border of a wide gap the robot aims (rad)."""
    turn_gain: Annotated[float, _Gain, Search(0.05, 50, log=True)] = 30.37
    """Turning speed per angle to the chosen direction (1/s)."""
    slow_distance: Annotated[float, _Distance, Search(0.02, 10, log=True)] = 0.5241
    """Free way ahead (m) below which the robot slows."""


@one_line
@dataclass(frozen=True, config=STRICT)
class MppiConfig:
    """Model predictive path integral control `mppi` (Williams and others 2017).

    Found by `navrl tune mppi --mppi.samples 250 --world mixed --trials 60 --episodes 100`: trial 47, 166 s of CPU, seed
    0; a quarter of the samples makes four times the trials. It began with step 0.2434, temperature 0.3729, hold 14,
    v_noise 0.4877, omega_noise 1.101, obstacle 0.383, inflation 0.9775, of 13 trials among 16 boxes, hold by hand.
    v_noise was searched from 0.05 on, at the end of which it lies.
    """

    samples: Annotated[int, Field(ge=1, le=65536)] = 1000
    """Sampled sequences of commands."""
    steps: Annotated[int, Field(ge=1, le=1000)] = 56
    """Commands of a sequence."""
    step: Annotated[float, Field(ge=1e-3, le=10), Search(0.05, 0.6, log=True)] = 0.4655
    """Time that a command of a sequence lasts (s)."""
    temperature: Annotated[float, Field(ge=1e-6, le=1e6), Search(0.03, 10, log=True)] = 3.302
    """Cost by which a sequence loses a factor e of weight."""
    hold: Annotated[int, Field(ge=1, le=1000), Search(2, 56, log=True)] = 4
    """Steps that a draw of noise lasts: noise that changes with every step hardly turns the robot."""
    v_noise: Annotated[float, Field(ge=0, le=100), Search(0.01, 2, log=True)] = 0.05102
    """Standard deviation of the forward speed's noise (m/s)."""
    omega_noise: Annotated[float, Field(ge=0, le=100), Search(0.2, 5, log=True)] = 0.5079
    """Standard deviation of the turning speed's noise (rad/s)."""
    goal: Annotated[float, _Weight] = 6.558
    """Cost per metre to the goal and second."""
    obstacle: Annotated[float, _Weight, Search(0.03, 100, log=True)] = 0.1011
    """Cost per second at an obstacle; it falls with the square of the clearance to 0 at inflation."""
    inflation: Annotated[float, _Distance, Search(0.1, 3, log=True)] = 0.5015
    """Clearance (m) at which obstacles begin to cost."""
    margin: _Margin = 0.02
    """Added to the robot's radius (m)."""
    collision: Annotated[float, _Weight] = 1000.0
    """Cost per second in contact."""


@one_line
@dataclass(frozen=True, config=STRICT)
class PursuitConfig:
    """Regulated pure pursuit `pursuit` (Macenski and others 2023): follows a path or a goal, steps aside, or stops.

    Found by `navrl tune pursuit+astar --world mixed --trials 150 --episodes 300`: trial 128, 81 s of CPU, seed 0. It
    began with settings by hand: lookahead 0.35, turn_in_place 0.8, turn_gain 3, detour 1, radius_min 0.6, approach 0.3,
    v_min 0.05, stop_time 0.2. For the planner's margin it found 0.024; 0.1 stays, as planners lead others too.
    """

    lookahead: Annotated[float, _Distance, Search(0.12, 3, log=True)] = 0.57
    """Distance (m) of the point of the path that is pursued."""
    turn_in_place: Annotated[float, Field(ge=0, le=3.2), Search(0.05, 3.2, log=True)] = 1.135
    """A larger angle to that point is turned away in place (rad)."""
    turn_gain: Annotated[float, _Gain, Search(0.2, 50, log=True)] = 43.68
    """Turning speed per angle while turning in place (1/s)."""
    detour: Annotated[float, Field(ge=0, le=3.2), Search(0, 3.2)] = 1.057
    """Angle (rad) up to which arcs beside one on which an obstacle stands are tried; 0: none, it only stops."""
    radius_min: Annotated[float, Field(ge=0, le=1000), Search(0.005, 5, log=True)] = 0.01118
    """Arcs of a smaller radius (m) are driven slower in proportion."""
    approach: Annotated[float, Field(ge=0, le=1000), Search(0.005, 5, log=True)] = 0.007598
    """Distance to the goal (m) below which the robot slows in proportion."""
    v_min: Annotated[float, Field(ge=0, le=100), Search(0.002, 1, log=True)] = 0.02618
    """Slowest forward speed (m/s) while it slows."""
    stop_time: Annotated[float, Field(ge=0, le=60), Search(0.002, 5, log=True)] = 0.003346
    """The robot slows so that it could still stop on the free way along its arc, a period and this time (s) later."""
    margin: _Margin = 0.02
    """Added to the robot's radius (m); half of the clearance where that is less."""


@one_line
@dataclass(frozen=True, config=STRICT)
class ControllersConfig:
    """The settings of all classical controllers."""

    dwa: DwaConfig = DwaConfig()
    apf: ApfConfig = ApfConfig()
    gap: GapConfig = GapConfig()
    mppi: MppiConfig = MppiConfig()
    pursuit: PursuitConfig = PursuitConfig()


Tunable = Literal["dwa", "apf", "gap", "mppi", "pursuit"]
TUNABLE: tuple[Tunable, ...] = get_args(Tunable)
"""Controllers that have settings to search; `pursuit` only behind a planner."""
