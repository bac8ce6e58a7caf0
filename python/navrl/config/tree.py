"""The configuration: one tree of frozen dataclasses, whose defaults are the preset "fast".

Types and ranges stand once, in the annotations below, and hold for files, options and Python alike. What breaks them is
put into words by `navrl.config.faults`; settings that exclude each other are refused by `navrl.config.checks`; files,
presets and options are read by `navrl.config.files`.
Sections and equations are those of the paper; docs/equations.md lists them. Units are SI, angles in radians.
"""

from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic.dataclasses import dataclass

from navrl.config.checks import check_config, check_sim
from navrl.config.controllers import ApfConfig, ControllersConfig, DwaConfig, GapConfig, MppiConfig, PursuitConfig
from navrl.config.faults import STRICT, one_line
from navrl.config.planner import PlannerConfig

WORLDS = ("td3", "boxes", "open8", "walls", "mixed")
THREADS_MAX = 256
"""Most threads of a simulator, as the core has it."""


def _world(name: Any) -> Any:  # noqa: ANN401 - any value may stand in a file
    if isinstance(name, str) and name not in WORLDS:
        name.encode()  # a file name that is not text cannot be written to config.toml
        if not (name.endswith(".json") and Path(name).is_file()):
            raise ValueError("neither a world nor an existing file")
    return name


def _tuple(value: Any) -> Any:  # noqa: ANN401 - any value may stand in a file
    return tuple(value) if isinstance(value, list) else value


_WORLDS = ", ".join(f'"{name}"' for name in WORLDS)
_World = Annotated[str, BeforeValidator(_world), Field(description=f"{_WORLDS} or the path of an existing .json file")]
_List = BeforeValidator(_tuple)
_Sizes = Annotated[tuple[Annotated[int, Field(ge=1, le=8192)], ...], Field(min_length=2, max_length=8), _List]
_Coordinate = Annotated[float, Field(ge=-10, le=10)]
_Pose = Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], _List]
_Speed = Annotated[float, Field(gt=0, le=100)]
_Length = Annotated[float, Field(gt=0, le=10)]
_NotNegative = Annotated[float, Field(ge=0, le=1e6)]
_Sigma = Annotated[float, Field(ge=0, le=10)]
_Fraction = Annotated[float, Field(ge=0, le=1)]
_Count = Annotated[int, Field(ge=0, le=10**12)]
_Rate = Annotated[float, Field(gt=0, le=1)]


@one_line
@dataclass(frozen=True, config=STRICT)
class WorldConfig:
    """Where the robot drives and how far its goals lie (section IV, figure 5)."""

    name: _World = "td3"
    """A built-in world or a world file. "td3" is the paper's room; "boxes", "open8" and "walls" are 10 m squares,
    the last with narrow gaps and dead ends; in "mixed" each robot, and each scenario of a list, has one of all."""
    boxes: Annotated[int, Field(ge=0, le=64)] = 8
    """Random boxes of the world "boxes"; the other worlds know their own number."""
    random_yaw: bool = True
    """Whether the boxes of "td3" take a uniform yaw, or yaw 0 as in the published world."""
    goal_range_start: Annotated[float, Field(gt=0, le=1000)] = 10.0
    """Goals of training lie at start + uniform(-u, u) per axis; u (m) in a robot's first episode."""
    goal_range_growth: Annotated[float, Field(ge=0, le=1000)] = 0.004
    """Growth of u (m) with each episode of that robot."""
    goal_range_max: Annotated[float, Field(gt=0, le=1000)] = 10.0
    """Largest u (m); evaluation always uses it."""


@one_line
@dataclass(frozen=True, config=STRICT)
class RobotConfig:
    """Shape and limits of the robot (section III, equation 6)."""

    footprint: Literal["disc", "rectangle"] = "disc"
    """Shape that must not touch anything, centred on the point that drives the arcs."""
    radius: _Length = 0.25
    """Radius of the disc (m)."""
    length: _Length = 0.5
    """Extent of the rectangle along the robot's x axis (m)."""
    width: _Length = 0.4
    """Extent of the rectangle along the robot's y axis (m)."""
    v_max: _Speed = 0.5
    """Largest forward speed (m/s), reached at a1 = 1 (equation 6)."""
    omega_max: _Speed = 1.0
    """Largest turning speed (rad/s), reached at a2 = 1 (equation 6)."""
    acceleration_max: _NotNegative = 0.0
    """Largest change of the forward speed (m/s^2); 0 means no limit."""
    angular_acceleration_max: _NotNegative = 0.0
    """Largest change of the turning speed (rad/s^2); 0 means no limit."""
    delay_steps: Annotated[int, Field(ge=0, le=100)] = 0
    """Control periods by which a command acts late; the robot stands until the first one acts."""
    odometry_noise: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Standard deviation of odometry's scale errors, drawn once an episode; the goal is seen from where it leads to."""


@one_line
@dataclass(frozen=True, config=STRICT)
class LidarConfig:
    """Geometry and noise of the lidar (section III, equation 2)."""

    beams: Annotated[int, Field(ge=1, le=4096)] = 180
    """Number of beams; beam i points at -fov/2 + (i + 1/2) fov/beams, right to left."""
    fov: Annotated[float, Field(gt=0, le=2 * pi)] = pi
    """Field of view (rad), centred on the lidar's x axis."""
    range_min: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """Smallest range that is reported (m)."""
    range_max: Annotated[float, Field(gt=0, le=1000)] = 10.0
    """Largest range (m); a beam that meets nothing reports exactly this."""
    noise: Annotated[float, Field(ge=0, le=10)] = 0.008
    """Standard deviation of the Gaussian noise on hits (m)."""
    noise_per_meter: _Fraction = 0.0
    """Standard deviation (m per m) of a second noise that grows with the range; sigma^2 = noise^2 + (it x range)^2."""
    resolution: _Fraction = 0.0
    """Hits are rounded to multiples of this (m); 0 means none."""
    drop_probability: _Fraction = 0.0
    """Probability that a beam is lost: its range is NaN, its bin keeps the other beams, and without any reads 0."""
    mount: _Pose = (0.0, 0.0, 0.0)
    """Pose [x, y, yaw] of the lidar in the robot's frame (m, m, rad)."""
    bins: Annotated[int, Field(ge=1, le=4096)] = 20
    """Groups of neighbouring beams that an observation keeps the smallest range of (equation 2)."""
    caster: Literal["auto", "raster", "parry"] = "auto"
    """How rays are cast: vectorised ("raster"), by the reference ("parry"), or the faster that fits ("auto")."""


@one_line
@dataclass(frozen=True, config=STRICT)
class TaskConfig:
    """The episode: period, limits and what ends it (section IV, equation 3)."""

    period: Annotated[float, Field(ge=1e-3, le=10)] = 0.1
    """Control period (s): one step of the environment."""
    time_limit: Annotated[float, Field(gt=0, le=1e7)] = 50.0
    """Longest episode (s); it ends after round(time_limit / period) steps."""
    goal_radius: Annotated[float, Field(gt=0, le=100)] = 0.3
    """eta_D: the goal is reached when its distance from the robot's centre is smaller (m, equation 3)."""
    collision: Literal["footprint", "sensor"] = "footprint"
    """What counts as a collision: the footprint touches, or also a bin under sensor_range (the published rule)."""
    sensor_range: Annotated[float, Field(ge=0, le=1000)] = 0.35
    """Range under which the rule "sensor" calls the nearest bin a collision (m)."""


@one_line
@dataclass(frozen=True, config=STRICT)
class RewardConfig:
    """What a step is worth (section II, equations 3 and 5)."""

    goal: _NotNegative = 100.0
    """r_g: reward of the step that reaches the goal (equation 3)."""
    collision: Annotated[float, Field(ge=-1e6, le=0)] = -445.0
    """r_c: reward of the step that collides (equation 3)."""
    form: Literal["paper", "halves"] = "paper"
    """Motion term of equation 3: v - abs(omega) in SI, or (v/v_max - abs(omega)/omega_max)/2 as was published."""
    progress: _NotNegative = 35.0
    """Added for each metre by which the goal came nearer in the step (1/m)."""


@one_line
@dataclass(frozen=True, config=STRICT)
class NetworksConfig:
    """Actor and critic (section III, equations 7 and 8)."""

    hidden_sizes: _Sizes = (128, 128)
    """Units of the hidden layers (equation 8); the critic joins the action in the second."""
    encoding: Literal["inverse", "raw"] = "inverse"
    """Fixed encoding of observations: bins as 1/(range + 0.3) - 1, the goal's angle as sine and cosine; or as is."""
    initialization: Literal["zero_bias", "torch"] = "zero_bias"
    """First weights: biases 0 and the actor's last layer times output_scale, or those of the framework."""
    output_scale: Annotated[float, Field(gt=0, le=10)] = 0.3
    """Factor on the first weights of the actor's last layer, for "zero_bias"."""
    frozen_combined: bool = False
    """Ablation: leave the weights of the critic's combined layer (equation 7) untrained."""


@one_line
@dataclass(frozen=True, config=STRICT)
class LearnerConfig:
    """The update (section III "TD3 Network", equations 4, 9 and 10)."""

    algorithm: Literal["td3", "ddpg"] = "td3"
    """TD3, or DDPG: one critic, no target noise, no minimum, an actor step with every update."""
    kernel: Literal["auto", "native", "torch"] = "auto"
    """What computes the update: the native kernel, which "auto" takes too, or torch."""
    batch_size: Annotated[int, Field(ge=1, le=65536)] = 96
    """Rows of replay per update."""
    critic_lr: _Rate = 2.5e-3
    """Adam's step size for the critics."""
    actor_lr: _Rate = 7.5e-4
    """Adam's step size for the actor."""
    final_lr_fraction: _Fraction = 0.3
    """Both step sizes fall linearly to this fraction of themselves over the run; 1 keeps them."""
    tau: _Rate = 0.035
    """Share of the online weights in a soft update of the targets (equation 10)."""
    policy_delay: Annotated[int, Field(ge=1, le=1000)] = 3
    """Updates of the critics per update of the actor and the targets (equation 10)."""
    gamma: Annotated[float, Field(ge=0, lt=1)] = 1 - 1 / 215
    """Discount per step (equation 9)."""
    n_step: Annotated[int, Field(ge=1, le=10000)] = 11
    """Rewards summed before the target bootstraps (equation 9 has 1)."""
    delayed_steps: Annotated[int, Field(ge=0, le=10000)] = 0
    """n of the delayed attributed reward (equation 4): steps before a goal that share it; 0 turns it off."""
    reward_scale: Annotated[float, Field(gt=0, le=1e6)] = 0.065
    """Factor on rewards as the learner sees them."""
    policy_noise: Annotated[float, Field(ge=0, le=2)] = 0.04
    """Standard deviation of the noise on the target's actions (equation 9)."""
    noise_clip: Annotated[float, Field(ge=0, le=2)] = 0.5
    """Largest noise on the target's actions (equation 9)."""
    pretanh_penalty: Annotated[float, Field(ge=0, le=1000)] = 0.003
    """Weight in the actor's loss of the mean squared input of its tanh, against saturation; 0 turns it off."""
    mirror: bool = True
    """Whether half of the sampled rows are mirrored left to right (data augmentation, section I), and the policy takes
    the mean of what its actor answers to an observation and to the mirrored one."""
    averaging_rate: _Fraction = 0.005
    """The policy is an average of the actor that takes this share per vector step; 0: the policy is the actor."""
    clip_targets: bool = False
    """Whether targets are clipped to the bounds that the reward settings imply."""


@one_line
@dataclass(frozen=True, config=STRICT)
class ReplayConfig:
    """Memory of past steps (section III "TD3 Network")."""

    capacity: Annotated[int, Field(ge=1, le=10**9)] = 500_000
    """Rows kept; the oldest make room."""


@one_line
@dataclass(frozen=True, config=STRICT)
class ExplorationConfig:
    """Noise on training actions (section III "Training", equations 11 and 12)."""

    schedule: Literal["spread", "linear"] = "spread"
    """One sigma for each robot, spread evenly from sigma_min to sigma_max; or equation 11, the same for all robots."""
    sigma_min: _Sigma = 0.14
    """"spread": sigma of the first robot, in units of the action."""
    sigma_max: _Sigma = 0.43
    """"spread": sigma of the last robot, in units of the action."""
    sigma_start: _Sigma = 1.0
    """"linear": sigma at the first step (equation 11)."""
    sigma_end: _Sigma = 0.1
    """"linear": sigma after sigma_steps (equation 11)."""
    sigma_steps: Annotated[int, Field(ge=1, le=10**12)] = 500_000
    """"linear": environment steps from sigma_start to sigma_end (equation 11)."""
    random_steps: _Count = 2_000
    """Environment steps with uniform random actions before the policy acts."""
    forced: bool = False
    """Whether forced consistent actions are on (equation 12)."""
    forced_probability: _Fraction = 0.15
    """Chance per step to begin one near an obstacle (equation 12: u > 0.85)."""
    forced_range: Annotated[float, Field(gt=0, le=1000)] = 0.6
    """It begins only if the nearest front bin is closer (m, equation 12)."""
    forced_steps_min: Annotated[int, Field(ge=1, le=10000)] = 8
    """Fewest steps that it lasts (equation 12)."""
    forced_steps_max: Annotated[int, Field(ge=1, le=10000)] = 15
    """Most steps that it lasts (equation 12)."""


@one_line
@dataclass(frozen=True, config=STRICT)
class TrainingConfig:
    """Length and rhythm of a run (section III "Training")."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    """Names every random stream of the run."""
    num_envs: Annotated[int, Field(ge=1, le=65536)] = 256
    """Robots stepped together; one such vector step is num_envs environment steps."""
    steps: _Count = 1_000_000
    """Environment steps after which the run ends; 0 means no limit."""
    episodes: _Count = 0
    """Episodes after which the run ends; 0 means no limit."""
    update_schedule: Literal["interleaved", "per_episode"] = "interleaved"
    """Updates after each vector step; or, with one robot, as many after an episode as it had steps (the paper)."""
    updates_per_step: Annotated[float, Field(gt=0, le=10000)] = 4.67
    """"interleaved": updates per vector step; fractions add up."""
    until: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Stop once two validations in a row reach this success rate; 0 turns it off."""


@one_line
@dataclass(frozen=True, config=STRICT)
class ValidationConfig:
    """Tests during training, which choose the best checkpoint (section III "Training", equation 13)."""

    every_steps: Annotated[int, Field(ge=1, le=10**12)] = 25_000
    """Environment steps between validations."""
    scenarios: Annotated[int, Field(ge=1, le=1000)] = 1000
    """Scenarios per validation, the first of the world's validation list."""


@one_line
@dataclass(frozen=True, config=STRICT)
class CheckpointConfig:
    """Saved states, from which a run resumes."""

    every_s: Annotated[float, Field(ge=0, le=1e6)] = 10.0
    """Seconds between checkpoints; 0 saves after every vector step."""
    keep: Annotated[int, Field(ge=2, le=1000)] = 2
    """Newest checkpoints kept."""


@one_line
@dataclass(frozen=True, config=STRICT)
class ThreadsConfig:
    """Processor threads."""

    simulate: Annotated[int, Field(ge=0, le=THREADS_MAX)] = 0
    """Threads that step the robots; 0: the cores less those that learn, at least 1. Never changes results."""
    learn: Annotated[int, Field(ge=0, le=THREADS_MAX)] = 0
    """Threads of the update; 0: 2 of the native kernel, which uses no more and gives the same bits with 1, but 1 for
    very small networks and batches; and 1 of torch, where resuming bitwise needs the same number."""


@one_line
@dataclass(frozen=True, config=STRICT)
class SimConfig:
    """All that the simulator needs: the part of a configuration that the core reads."""

    world: WorldConfig = WorldConfig()
    robot: RobotConfig = RobotConfig()
    lidar: LidarConfig = LidarConfig()
    task: TaskConfig = TaskConfig()
    reward: RewardConfig = RewardConfig()

    def __post_init__(self) -> None:
        """Refuses settings that exclude each other.

        Raises:
            ConfigError: with the first of them.
        """
        check_sim(self)


@one_line
@dataclass(frozen=True, config=STRICT)
class Config:
    """All settings of a run; the defaults are the preset "fast"."""

    world: WorldConfig = WorldConfig()
    robot: RobotConfig = RobotConfig()
    lidar: LidarConfig = LidarConfig()
    task: TaskConfig = TaskConfig()
    reward: RewardConfig = RewardConfig()
    networks: NetworksConfig = NetworksConfig()
    learner: LearnerConfig = LearnerConfig()
    replay: ReplayConfig = ReplayConfig()
    exploration: ExplorationConfig = ExplorationConfig()
    training: TrainingConfig = TrainingConfig()
    validation: ValidationConfig = ValidationConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
    threads: ThreadsConfig = ThreadsConfig()
    dwa: DwaConfig = DwaConfig()
    apf: ApfConfig = ApfConfig()
    gap: GapConfig = GapConfig()
    mppi: MppiConfig = MppiConfig()
    pursuit: PursuitConfig = PursuitConfig()
    planner: PlannerConfig = PlannerConfig()

    def __post_init__(self) -> None:
        """Refuses settings that exclude each other.

        Raises:
            ConfigError: with the first of them.
        """
        check_config(self)

    @property
    def sim(self) -> SimConfig:
        """The part that the simulator reads."""
        return SimConfig(world=self.world, robot=self.robot, lidar=self.lidar, task=self.task, reward=self.reward)

    @property
    def controllers(self) -> ControllersConfig:
        """The part that classical controllers read."""
        return ControllersConfig(dwa=self.dwa, apf=self.apf, gap=self.gap, mppi=self.mppi, pursuit=self.pursuit)
