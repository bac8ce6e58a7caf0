"""Gymnasium ids of the built-in worlds, registered by importing this module; it loads nothing else of navrl."""

from __future__ import annotations

WORLDS_BY_ID = {"navrl/TD3World-v0": "td3", "navrl/Boxes-v0": "boxes", "navrl/Open8-v0": "open8"}
"""World of each id."""


def register() -> None:
    """Makes the ids known to Gymnasium; further calls change nothing."""
    from gymnasium.envs import registration

    for environment_id, world in WORLDS_BY_ID.items():
        if environment_id not in registration.registry:
            registration.register(
                id=environment_id,
                entry_point="navrl.env:NavigationEnv",
                vector_entry_point="navrl.env:NavigationVectorEnv",
                kwargs={"world": world},
            )


register()
