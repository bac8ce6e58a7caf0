"""What a policy was trained for: the content of policy.json, and the simulator that belongs to it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from navrl.encoding import Encoding, encoded_size
from navrl.errors import UserError, shown
from navrl.rebin import LidarLayout
from navrl.symmetry import why_asymmetric

if TYPE_CHECKING:
    from navrl.config import Config, SimConfig, WorldConfig

SCHEMA = 1
"""Version of policy.json."""
ROBOT_KEYS = ("v_max", "omega_max", "acceleration_max", "angular_acceleration_max")
ROBOT_FAULTS = ("delay_steps", "odometry_noise")
LIDAR_FAULTS = ("noise_per_meter", "resolution", "drop_probability")
"""Keys that policies of a robot and a lidar without these faults may lack, as older ones may lack "symmetric"."""
LIDAR_KEYS = ("beams", "bins", "fov", "range_min", "range_max", "noise", *LIDAR_FAULTS)
TASK_KEYS = ("goal_radius", "collision", "sensor_range")
SIZES = {"disc": ("radius",), "rectangle": ("length", "width")}
"""Keys of a footprint by its kind."""


UNITS_MAX = 1 << 20
"""Widest layer, by common sense."""


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1 << 31


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -1e300 < value < 1e300


def _are_widths(value: object) -> bool:
    return isinstance(value, tuple) and all(_is_whole(width) and 1 <= width <= UNITS_MAX for width in value)


def _is_pose(value: object) -> bool:
    return isinstance(value, tuple) and len(value) == 3 and all(map(_is_number, value))


def _is_footprint(value: object) -> bool:
    return isinstance(value, dict) and all(key == "kind" or _is_number(size) for key, size in value.items())


_TYPES: dict[str, tuple[Callable[[object], bool], str]] = {
    "int": (_is_whole, "a whole number"),
    "float": (_is_number, "a finite number"),
    "bool": (lambda value: isinstance(value, bool), "true or false"),
    "tuple[int, ...]": (_are_widths, f"widths in [1, {UNITS_MAX}]"),
    "tuple[float, float, float]": (_is_pose, "[x, y, yaw]"),
    "dict[str, Any]": (_is_footprint, "a disc or a rectangle"),
}
"""What the values of a field have to be, by the type that it is declared with."""


class PolicyError(UserError, ValueError):
    """A policy that cannot be used; the text names the file and what is wrong with it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolicyDescription:
    """What a policy was trained for: the content of policy.json. The field names are its keys."""

    encoding: Encoding
    """Fixed encoding of observations."""
    hidden_sizes: tuple[int, ...]
    """Units of the hidden layers."""
    v_max: float
    """Largest forward speed, m/s."""
    omega_max: float
    """Largest turning speed, rad/s."""
    acceleration_max: float
    """Largest change of the forward speed, m/s^2; 0 means no limit."""
    angular_acceleration_max: float
    """Largest change of the turning speed, rad/s^2; 0 means no limit."""
    beams: int
    """Beams of the lidar."""
    bins: int
    """Groups into which the beams are pooled by minimum."""
    fov: float
    """Field of view of the lidar, radians."""
    range_min: float
    """Smallest range of the lidar, metres."""
    range_max: float
    """Largest range of the lidar, metres."""
    noise: float
    """Standard deviation of the lidar's noise, metres."""
    mount: tuple[float, float, float]
    """Pose [x, y, yaw] of the lidar in the robot's frame (m, m, rad)."""
    period_s: float
    """Control period, seconds."""
    time_limit_s: float
    """Longest episode of the built-in lists, seconds."""
    goal_radius: float
    """Distance from the goal, metres, at which it counts as reached and `command` stops the robot."""
    collision: Literal["footprint", "sensor"]
    """What counts as a collision: "footprint" or "sensor"."""
    sensor_range: float
    """Range of the rule "sensor", metres."""
    footprint: dict[str, Any]
    """{"kind": "disc", "radius"} or {"kind": "rectangle", "length", "width"}, metres."""
    scores: dict[str, Any] | None
    """Scores on the list that the policy reports, with the key "world"; None before they are known."""
    noise_per_meter: float = 0.0
    """Standard deviation of the lidar's noise that grows with the range, metres per metre."""
    resolution: float = 0.0
    """The lidar's hits are multiples of this, metres; 0 means no rounding."""
    drop_probability: float = 0.0
    """Probability that a beam of the lidar is lost."""
    delay_steps: int = 0
    """Control periods by which a command acts late."""
    odometry_noise: float = 0.0
    """Standard deviation of the scale errors of the odometry from which the goal is seen."""
    symmetric: bool = False
    """Whether it answers by the mean, before the tanh, of its outputs for an observation and for the mirrored one."""

    def __post_init__(self) -> None:
        """Refuses what no robot can have.

        Raises:
            ValueError: Names the first key at fault.
        """
        for field in dataclasses.fields(self):
            fits, expected = _TYPES.get(str(field.type), (lambda _: True, ""))
            if not fits(getattr(self, field.name)):
                raise ValueError(f"{field.name} = {shown(getattr(self, field.name))}: expected {expected}")
        positive = ("v_max", "omega_max", "fov", "range_max", "period_s", "time_limit_s", "goal_radius", "bins")
        kind = str(self.footprint.get("kind"))
        for key, fits, expected in (
            ("encoding", self.encoding in ("inverse", "raw"), '"inverse" or "raw"'),
            *((key, 0 < getattr(self, key) < math.inf, "> 0") for key in positive),
            ("fov", self.fov <= 2 * math.pi, "at most 2 pi rad"),
            ("beams", self.beams >= self.bins, f"at least bins = {self.bins}"),
            ("range_min", 0 <= self.range_min < self.range_max, f"in [0, range_max = {self.range_max})"),
            ("footprint", {"kind", *SIZES.get(kind, ())} == set(self.footprint) > {"kind"}, "a disc or a rectangle"),
        ):
            if not fits:
                raise ValueError(f"{key} = {shown(getattr(self, key))}: expected {expected}")
        why = why_asymmetric(self.beams, self.bins, self.mount) if self.symmetric else None
        if why is not None:
            raise ValueError(f"symmetric = true: expected false where a scan has no mirror image: {why}")

    @classmethod
    def from_config(cls, config: Config, scores: dict[str, Any] | None = None) -> PolicyDescription:
        """Describes the policy that a configuration trains.

        Args:
            config: Configuration of the training run.
            scores: What the policy reached in that configuration's world, if known.

        Returns:
            The description.
        """
        robot, lidar, task = config.robot, config.lidar, config.task
        x, y, yaw = lidar.mount
        return cls(
            encoding=config.networks.encoding,
            hidden_sizes=tuple(config.networks.hidden_sizes),
            symmetric=config.learner.mirror,
            mount=(x, y, yaw),
            period_s=task.period,
            time_limit_s=task.time_limit,
            footprint={"kind": robot.footprint} | {size: getattr(robot, size) for size in SIZES[robot.footprint]},
            scores=None if scores is None else {"world": Path(config.world.name).name, **scores},
            **{key: getattr(robot, key) for key in (*ROBOT_KEYS, *ROBOT_FAULTS)},
            **{key: getattr(lidar, key) for key in LIDAR_KEYS},
            **{key: getattr(task, key) for key in TASK_KEYS},
        )

    def sim_config(self, world: WorldConfig | None = None) -> SimConfig:
        """The simulator that the policy belongs to: its robot, lidar and task.

        Args:
            world: Where to drive; the default world if None.

        Returns:
            Configuration of a simulator.
        """
        from navrl.config import LidarConfig, RobotConfig, SimConfig, TaskConfig, WorldConfig

        sizes = {key: value for key, value in self.footprint.items() if key != "kind"}
        return SimConfig(
            world=WorldConfig() if world is None else world,
            robot=RobotConfig(
                footprint=self.footprint["kind"],
                **sizes,
                **{key: getattr(self, key) for key in (*ROBOT_KEYS, *ROBOT_FAULTS)},
            ),
            lidar=LidarConfig(mount=self.mount, **{key: getattr(self, key) for key in LIDAR_KEYS}),
            task=TaskConfig(
                period=self.period_s,
                time_limit=self.time_limit_s,
                **{key: getattr(self, key) for key in TASK_KEYS},
            ),
        )

    def check_first(self, policy: PolicyDescription) -> None:
        """Refuses a policy that cannot be where the training of this one begins.

        Args:
            policy: Its description.

        Raises:
            PolicyError: Names the first difference in networks or lidar bins.
        """
        for key in ("encoding", "hidden_sizes", "bins"):
            own, given = getattr(self, key), getattr(policy, key)
            if own != given:
                raise PolicyError(f"--init: the policy has {key} = {given}, this run has {own}")

    @property
    def lidar_layout(self) -> LidarLayout:
        """The geometry of the policy's lidar."""
        return LidarLayout(self.beams, self.bins, self.fov, self.range_min, self.range_max)

    @property
    def layer_sizes(self) -> tuple[int, ...]:
        """Widths from the encoded observation to the two actions."""
        return (encoded_size(self.bins, self.encoding), *self.hidden_sizes, 2)

    def to_json(self, actor: bytes) -> str:
        """The text of policy.json.

        Args:
            actor: Content of the weights' file that it describes.

        Returns:
            JSON with the hash of the weights and of itself.
        """
        record: dict[str, Any] = {"schema": SCHEMA, "navrl": metadata.version("navrl")} | dataclasses.asdict(self)
        record["actor_sha256"] = hashlib.sha256(actor).hexdigest()
        record["sha256"] = digest(record)
        return json.dumps(record, indent=2) + "\n"

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> PolicyDescription:
        """Reads a record whose hash and schema were checked.

        Args:
            record: The parsed policy.json.

        Returns:
            The description.

        Raises:
            ValueError: A key is missing or unknown, or a value cannot be.
        """
        fields = {field.name for field in dataclasses.fields(cls)}
        given = set(record) - {"schema", "navrl", "actor_sha256", "sha256"}
        wrong = (fields ^ given) - ({*ROBOT_FAULTS, *LIDAR_FAULTS, "symmetric"} - given)
        if wrong:
            raise ValueError(f"keys missing or unknown: {', '.join(sorted(wrong))}")
        values: dict[str, Any] = {
            key: tuple(record[key]) if isinstance(record[key], list) else record[key] for key in given
        }
        try:
            return cls(**values)
        except (TypeError, AttributeError) as error:
            raise ValueError(f"a value of the wrong type: {error}") from None


def digest(record: Mapping[str, Any]) -> str:
    """Hash of everything in policy.json except the hash itself.

    Args:
        record: Content of policy.json.

    Returns:
        SHA-256 in hexadecimal digits.
    """
    content = {key: value for key, value in record.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
