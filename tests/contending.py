"""Scenarios and policies for contenders."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from navrl.batch import Scenario
from navrl.config import Config, SimConfig
from navrl.policy import PolicyDescription, save_policy

SIM = SimConfig()


def scenario(**changes: object) -> Scenario:
    values = {"start": (0.0, 0.0, 0.0), "goal": (3.0, 0.0), "goal_radius": 0.3, "time_limit": 30.0} | changes
    return Scenario(**values)  # type: ignore[arg-type]


def policy_folder(folder: Path, sim: SimConfig = SIM, seed: int = 0) -> Path:
    """An untrained policy for a robot."""
    config = Config(robot=sim.robot, lidar=sim.lidar)
    description = replace(PolicyDescription.from_config(config), hidden_sizes=(8, 8))
    generator = np.random.Generator(np.random.Philox(seed))
    sizes = {"hidden.0": (8, 26), "hidden.1": (8, 8), "output": (2, 8)}
    weights = {f"{n}.weight": generator.normal(0, 0.5, s).astype(np.float32) for n, s in sizes.items()}
    weights |= {f"{n}.bias": np.zeros(s[0], np.float32) for n, s in sizes.items()}
    save_policy(folder, weights, description)
    return folder
