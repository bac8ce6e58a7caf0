"""A trained policy: from observations to actions, from a robot's scan to its command, from and to files.

Its network is computed by the native kernel that acts in training. Imports no torch, so that evaluation and deployment
start at once.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navrl import _navsim
from navrl.durable import sync_folder, write_file
from navrl.encoding import GOAL_AND_COMMAND, encode_observations
from navrl.mirror import mirror_encoded
from navrl.policy_description import SCHEMA, PolicyDescription, PolicyError, digest
from navrl.rebin import matches, pool_scan

__all__ = ["Policy", "PolicyDescription", "PolicyError", "Weights", "load_policy", "save_policy"]

WEIGHTS_FILE = "actor.safetensors"
DESCRIPTION_FILE = "policy.json"
PENDING_SUFFIX = ".new"
ANGLE_MAX = float(np.float32(math.pi))

Weights = Mapping[str, NDArray[np.float32]]
"""Tensors of an actor by the names of `navrl.networks.Actor`: hidden.0.weight (outputs, inputs), hidden.0.bias, ...,
output.weight, output.bias."""


class Policy:
    """An actor (equation 8) with the description of the robot that it drives."""

    def __init__(self, weights: Weights, description: PolicyDescription) -> None:
        """Takes over copies of the weights.

        Args:
            weights: Tensors by the names of `navrl.networks.Actor`, float32.
            description: What the policy was trained for.

        Raises:
            ValueError: A tensor is missing, unknown, of another shape or dtype, or not finite.
        """
        self.description = description
        sizes = description.layer_sizes
        self._names = [*(f"hidden.{i}" for i in range(len(description.hidden_sizes))), "output"]
        names = {f"{name}.{part}" for name in self._names for part in ("weight", "bias")}
        if names != set(weights):
            raise ValueError(f"tensors: expected {sorted(names)}, got {sorted(weights)}")
        self._layers: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
        places, end = [], 0
        for name, (inputs, outputs) in zip(self._names, itertools.pairwise(sizes), strict=True):
            weight = _tensor(weights, f"{name}.weight", (outputs, inputs))
            bias = _tensor(weights, f"{name}.bias", (outputs,))
            self._layers.append((weight.copy(), bias.copy()))
            places.append((inputs, outputs, end, end + weight.size))
            end += weight.size + bias.size
        mirror = mirror_encoded(description.bins, description.encoding) if description.symmetric else None
        reflection = mirror and (mirror.permutation.tolist(), mirror.signs.tolist())
        packed = np.concatenate([part.ravel() for layer in self._layers for part in layer])
        self._actor = _navsim.Actor(places, packed, reflection)

    @property
    def weights(self) -> dict[str, NDArray[np.float32]]:
        """Copies of the tensors by the names of `navrl.networks.Actor`."""
        tensors = {}
        for name, (weight, bias) in zip(self._names, self._layers, strict=True):
            tensors[f"{name}.weight"] = weight.copy()
            tensors[f"{name}.bias"] = bias.copy()
        return tensors

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions for observations (equation 2), the same bits for a row alone as for the row in any batch.

        Args:
            observations: (bins + 4,) or (N, bins + 4) float32, raw.

        Returns:
            (2,) or (N, 2) float32 in [-1, 1].

        Raises:
            ValueError: Another shape or dtype, NaN or infinity.
        """
        rows = np.asarray(observations)
        width = self.description.bins + GOAL_AND_COMMAND
        if rows.dtype != np.float32 or rows.ndim not in (1, 2) or rows.shape[-1] != width:
            expected = f"({width},) or (N, {width}) float32"
            raise ValueError(f"observations: expected {expected}, got {rows.shape} {rows.dtype}")
        # The sum is finite exactly if all are: ranges and distances are far below the largest float32.
        if not np.isfinite(rows.sum()):
            bad = np.argwhere(~np.isfinite(np.atleast_2d(rows)))
            if len(bad):
                raise ValueError(f"observations: row {bad[0][0]}, column {bad[0][1]} is not a finite number")
        # Eq. 8: inputs - hidden relu - ... - 2 tanh, of both sides where the policy is symmetric
        encoded = encode_observations(np.atleast_2d(rows), self.description.encoding)
        return self._actor.act(np.ascontiguousarray(encoded)).reshape(*rows.shape[:-1], 2)

    def command(
        self,
        ranges: ArrayLike,
        angle_min: float,
        angle_increment: float,
        goal_in_robot: Sequence[float],
        last_command: Sequence[float],
        *,
        rebin: bool = False,
    ) -> tuple[float, float]:
        """The robot's next command from what it has: a scan, its goal and the velocity that it reached.

        `navrl.rebin` lists what becomes of infinite, missing and invalid readings. The robot is told to stop (0, 0)
        when no beam in the policy's field of view is valid, and within the goal radius.

        Args:
            ranges: (beams,) float, metres; a lidar mounted as the policy's `mount` says.
            angle_min: Direction of the first beam, radians, counter-clockwise from the lidar's x axis.
            angle_increment: Angle from one beam to the next, radians, negative for a clockwise scan.
            goal_in_robot: (x, y) of the goal in the robot's frame, metres, x forward, y left.
            last_command: (v, omega) reached in the last period, m/s and rad/s: the last command, but where
                acceleration limits kept the robot from it; (0, 0) at first.
            rebin: Accept a lidar other than the policy's own and pool its beams by angle.

        Returns:
            v (m/s, in [0, v_max]) and omega (rad/s, in [-omega_max, omega_max]).

        Raises:
            ValueError: A lidar other than the policy's own without `rebin`, or numbers that are not finite.
        """
        own, layout = self.description, self.description.lidar_layout
        goal, last = _pair(goal_in_robot, "goal_in_robot"), _pair(last_command, "last_command")
        pooled = pool_scan(layout, ranges, angle_min, angle_increment)
        beams = np.shape(ranges)[0]
        if not (rebin or matches(layout, beams, angle_min, angle_increment)):
            raise ValueError(
                f"scan of {beams} beams from {angle_min:.4g} rad in steps of {angle_increment:.4g} rad: this policy's"
                f" lidar has {own.beams} from {layout.first_angle:.4g} rad in steps of {layout.step:.4g} rad;"
                " rebin=True pools another lidar's beams by angle"
            )
        distance = math.hypot(*goal)
        if pooled is None or distance < own.goal_radius:
            return 0.0, 0.0
        # Eq. 2: bins, goal distance, goal angle, v / v_max in [0, 1], omega / omega_max in [-1, 1]
        angle = min(max(math.atan2(goal[1], goal[0]), -ANGLE_MAX), ANGLE_MAX)
        speed = min(max(last[0] / own.v_max, 0.0), 1.0)
        turn = min(max(last[1] / own.omega_max, -1.0), 1.0)
        observation = np.concatenate([pooled, np.array([distance, angle, speed, turn], np.float32)])
        a1, a2 = (float(a) for a in self.act(observation))
        # Eq. 6: v = v_max (a1 + 1) / 2, omega = omega_max a2
        return own.v_max * (a1 + 1) / 2, own.omega_max * a2


def _pair(values: Sequence[float], name: str) -> tuple[float, float]:
    pair = np.asarray(values, np.float64)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise ValueError(f"{name}: expected two finite numbers, got {values}")
    return float(pair[0]), float(pair[1])


def _tensor(weights: Weights, name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    tensor = np.asarray(weights[name])
    if tensor.dtype != np.float32 or tensor.shape != shape:
        raise ValueError(f"tensor {name}: expected {shape} float32, got {tensor.shape} {tensor.dtype}")
    if not np.isfinite(tensor).all():
        raise ValueError(f"tensor {name}: holds NaN or infinity")
    return tensor


def save_policy(folder: str | Path, weights: Weights, description: PolicyDescription) -> None:
    """Writes a policy folder; a crash at any moment leaves the old policy or the new one complete.

    Args:
        folder: Made if missing; an older policy in it is replaced.
        weights: Tensors by the names of `navrl.networks.Actor`, float32.
        description: What the policy was trained for.

    Raises:
        ValueError: The weights do not fit the description.
    """
    from safetensors.numpy import save

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    tensors = Policy(weights, description).weights
    actor = save(tensors)
    # The description's rename makes the new policy valid; until the weights' rename, a reader finds them beside.
    write_file(folder / (WEIGHTS_FILE + PENDING_SUFFIX), actor)
    write_file(folder / DESCRIPTION_FILE, description.to_json(actor).encode())
    os.replace(folder / (WEIGHTS_FILE + PENDING_SUFFIX), folder / WEIGHTS_FILE)
    sync_folder(folder)


def load_policy(path: str | Path) -> Policy:
    """Loads a policy; nothing in the files is executed.

    Args:
        path: A run folder, a policy folder, or "default" for the policy that ships with navrl.

    Returns:
        The policy.

    Raises:
        PolicyError: There is no policy, or a file is damaged, incomplete, or of another version.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    folder = _find_folder(path)
    record = _read_description(folder / DESCRIPTION_FILE)
    actor_file, actor = _read_actor(folder, record["actor_sha256"])
    try:
        description = PolicyDescription.from_record(record)
    except ValueError as error:
        raise PolicyError(f"{folder / DESCRIPTION_FILE}: {error}") from None
    try:
        return Policy(load(actor), description)
    except (ValueError, SafetensorError) as error:
        raise PolicyError(f"{actor_file}: {error}") from None


def _find_folder(path: str | Path) -> Path:
    if not str(path):
        raise PolicyError("policy: expected a run folder, a policy folder or default, got nothing")
    if path == "default":
        folder = Path(str(resources.files("navrl"))) / "default_policy"
        if not (folder / DESCRIPTION_FILE).is_file():
            raise PolicyError("default: no trained policy in this installation; name a run folder or a policy folder")
        return folder
    for folder in (Path(path), Path(path) / "policy"):
        if (folder / DESCRIPTION_FILE).is_file():
            return folder
    if not Path(path).exists():
        raise PolicyError(f"{path}: no such folder; expected a run folder, a policy folder or default")
    raise PolicyError(f"{path}: neither a policy folder ({DESCRIPTION_FILE}, {WEIGHTS_FILE}) nor a run folder with one")


def _read_description(file: Path) -> dict[str, Any]:
    try:
        record = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise PolicyError(f"{file}: cannot be read: {error}") from None
    if not isinstance(record, dict) or not isinstance(record.get("actor_sha256"), str):
        raise PolicyError(f"{file}: not the description of a policy")
    if record.get("schema") != SCHEMA:
        raise PolicyError(f"{file}: schema {record.get('schema')}, but this navrl reads schema {SCHEMA}")
    if record.get("sha256") != digest(record):
        raise PolicyError(f"{file}: damaged or edited: its content does not fit its sha256")
    return record


def _read_actor(folder: Path, sha256: str) -> tuple[Path, bytes]:
    found = []
    # A save that was cut short leaves the weights that belong to the description beside the older ones.
    for file in (folder / WEIGHTS_FILE, folder / (WEIGHTS_FILE + PENDING_SUFFIX)):
        try:
            actor = file.read_bytes()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise PolicyError(f"{file}: cannot be read: {error}") from None
        found.append(hashlib.sha256(actor).hexdigest())
        if found[-1] == sha256:
            return file, actor
    file = folder / WEIGHTS_FILE
    if not found:
        raise PolicyError(f"{file}: missing")
    raise PolicyError(f"{file}: damaged: its sha256 is {found[0][:12]}..., {DESCRIPTION_FILE} says {sha256[:12]}...")
