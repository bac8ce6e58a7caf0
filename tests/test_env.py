"""Gymnasium environments: the library's own checker, the three autoreset modes step by step, determinism."""

import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from navrl.batch import BatchSim
from navrl.config import SimConfig, TaskConfig, WorldConfig
from navrl.env import NavigationEnv, NavigationVectorEnv

SHORT = SimConfig(task=TaskConfig(time_limit=0.5))
"""Episodes of 5 steps, which end by the time limit unless a goal is very near."""
STAY = np.array([-1.0, 0.0], np.float32)
AHEAD = np.array([1.0, 0.0], np.float32)
IDS = {"navrl/TD3World-v0": "td3", "navrl/Boxes-v0": "boxes", "navrl/Open8-v0": "open8"}


def actions_of(step: int, robots: int) -> NDArray[np.float32]:
    """Actions (robots, 2) of which row k depends on the step and k only."""
    k = np.arange(robots)
    return np.stack([np.sin(0.3 * step + k), np.cos(0.7 * step + 2 * k)], axis=1).astype(np.float32)


@pytest.mark.parametrize("environment_id", IDS)
def test_gymnasiums_checker_has_nothing_to_say(environment_id: str) -> None:
    environment = gymnasium.make(environment_id, disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment.unwrapped, skip_render_check=True)
    environment.close()


def test_ids_make_their_worlds() -> None:
    for environment_id, world in IDS.items():
        assert gymnasium.make(environment_id).unwrapped.config.world.name == world  # type: ignore[attr-defined]
        vector = gymnasium.make_vec(environment_id, num_envs=3)
        assert isinstance(vector, NavigationVectorEnv)
        assert (vector.config.world.name, vector.num_envs) == (world, 3)


def test_ids_are_known_after_importing_the_environments_in_either_order() -> None:
    for imports in ("import gymnasium, navrl.env", "import navrl.env, gymnasium"):
        code = f"{imports}; gymnasium.make('navrl/Boxes-v0').reset(seed=0)"
        subprocess.run([sys.executable, "-c", code], check=True)


def test_the_environment_shows_what_the_simulator_shows() -> None:
    environment, simulator = NavigationEnv(SHORT), BatchSim(SHORT, num_envs=1, seed=7, autoreset=False)
    observation, infos = environment.reset(seed=7)
    assert np.array_equal(observation, simulator.observations[0])
    assert infos == {"outcome": 0, "is_success": False}
    for step in range(5):
        action = actions_of(step, 1)
        simulator.step(action)
        observation, reward, terminated, truncated, infos = environment.step(action[0])
        assert np.array_equal(observation, simulator.observations[0])
        assert (reward, terminated) == (simulator.rewards[0], simulator.terminated[0])
        assert (truncated, infos["outcome"]) == (step == 4, 3 * (step == 4))
    observation, _ = environment.reset()
    simulator.reset()
    assert np.array_equal(observation, simulator.observations[0])


def test_a_seed_names_the_episodes() -> None:
    environment = NavigationEnv()
    first, _ = environment.reset(seed=3)
    second, _ = environment.reset()
    assert not np.array_equal(first, second)
    again, _ = environment.reset(seed=3)
    assert np.array_equal(first, again)
    assert np.array_equal(environment.reset()[0], second)
    assert not np.array_equal(environment.reset(seed=4)[0], first)


def test_a_seed_may_be_any_whole_number() -> None:
    for environment in (NavigationEnv(), NavigationVectorEnv(2)):
        first, _ = environment.reset(seed=3)
        again, _ = environment.reset(seed=np.int64(3))  # type: ignore[arg-type]
        assert np.array_equal(first, again)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([5, 0, 1], r"action: expected shape \(2,\), got \(3,\)"),
        ([[0.0, 0.0]], r"action: expected shape \(2,\), got \(1, 2\)"),
        ([0.0, np.nan], r"action: expected finite numbers, got \[0\.0, nan\]"),
    ],
)
def test_bad_actions_are_named(action: Any, message: str) -> None:  # noqa: ANN401 - what a user may pass
    environment = NavigationEnv()
    environment.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        environment.step(action)


def test_an_id_and_a_configuration_agree_about_the_world() -> None:
    own = SimConfig(world=WorldConfig(name="boxes", boxes=3))
    with pytest.raises(ValueError, match=r'"td3".*"boxes".*NavigationEnv') as refusal:
        gymnasium.make("navrl/TD3World-v0", config=own)
    assert "\n" not in str(refusal.value)
    with pytest.raises(ValueError, match=r'"open8".*"boxes".*NavigationVectorEnv'):
        gymnasium.make_vec("navrl/Open8-v0", num_envs=2, config=own)
    assert gymnasium.make("navrl/Boxes-v0", config=own).unwrapped.config == own  # type: ignore[attr-defined]
    # A configuration that says nothing of the world takes the id's.
    other = gymnasium.make("navrl/Boxes-v0", config=SHORT).unwrapped.config  # type: ignore[attr-defined]
    assert (other.world, other.task) == (WorldConfig(name="boxes"), SHORT.task)


def test_a_world_that_is_not_there_is_one_line() -> None:
    with pytest.raises(ValueError, match=r"^world\.name = .offic\.json.: must be .*existing \.json file$"):
        gymnasium.make("navrl/TD3World-v0", world="offic.json")


def test_step_before_reset_is_refused() -> None:
    for environment in (NavigationEnv(), NavigationVectorEnv(2)):
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
            environment.step(STAY)


def test_other_modes_are_refused() -> None:
    with pytest.raises(ValueError, match='expected None or "rgb_array"'):
        NavigationEnv(render_mode="human")
    with pytest.raises(ValueError, match="AutoresetMode"):
        NavigationVectorEnv(2, autoreset_mode="sometimes")


def test_spaces_hold_every_observation() -> None:
    vector = NavigationVectorEnv(16, autoreset_mode=AutoresetMode.SAME_STEP)
    observations, _ = vector.reset(seed=0)
    for step in range(60):
        assert vector.observation_space.contains(observations)
        observations, *_ = vector.step(actions_of(step, 16))


def started(mode: AutoresetMode, num_envs: int = 3) -> tuple[NavigationVectorEnv, BatchSim, NDArray[np.float32]]:
    """A vector environment, a simulator of the same episodes for the expected observations, and actions that stay."""
    vector = NavigationVectorEnv(num_envs, SHORT, autoreset_mode=mode)
    assert vector.metadata["autoreset_mode"] is mode
    simulator = BatchSim(SHORT, num_envs=num_envs, seed=5, autoreset=False)
    observations, _ = vector.reset(seed=5)
    assert np.array_equal(observations, simulator.observations)
    return vector, simulator, np.tile(STAY, (num_envs, 1))


def test_next_step_mode() -> None:
    vector, simulator, stay = started(AutoresetMode.NEXT_STEP)
    for step in range(5):
        simulator.step(stay)
        observations, _, terminated, truncated, _ = vector.step(stay)
        assert np.array_equal(observations, simulator.observations)
        assert not terminated.any()
        assert truncated.all() == (step == 4)
    # The episode has ended: the next step ignores the action and begins the next one.
    simulator.reset()
    observations, rewards, terminated, truncated, infos = vector.step(np.tile(AHEAD, (3, 1)))
    assert np.array_equal(observations, simulator.observations)
    assert rewards.tolist() == [0.0] * 3
    assert not (terminated | truncated).any()
    assert infos["outcome"].tolist() == [0] * 3
    # And the one after drives again.
    simulator.step(np.tile(AHEAD, (3, 1)))
    observations, rewards, *_ = vector.step(np.tile(AHEAD, (3, 1)))
    assert np.array_equal(observations, simulator.observations)
    assert rewards.tolist() == simulator.rewards.tolist()


def test_same_step_mode() -> None:
    vector, simulator, stay = started(AutoresetMode.SAME_STEP)
    for step in range(5):
        simulator.step(stay)
        observations, rewards, terminated, truncated, infos = vector.step(stay)
        assert rewards.tolist() == simulator.rewards.tolist()
        assert ("final_obs" in infos) == (step == 4)
    assert truncated.all()
    assert not terminated.any()
    assert np.array_equal(infos["final_obs"], simulator.observations)
    assert infos["_final_obs"].tolist() == [True] * 3
    assert infos["final_info"]["outcome"].tolist() == [3] * 3
    assert infos["final_info"]["_outcome"].tolist() == [True] * 3
    # The observations are already those of the next episode, which has all its steps before it.
    simulator.reset()
    assert np.array_equal(observations, simulator.observations)
    for step in range(5):
        _, _, _, truncated, _ = vector.step(stay)
        assert truncated.all() == (step == 4)


def test_disabled_mode() -> None:
    vector, simulator, stay = started(AutoresetMode.DISABLED)
    for _ in range(5):
        simulator.step(stay)
        observations, _, _, truncated, _ = vector.step(stay)
    assert truncated.all()
    # Nothing moves until it is told to.
    after, rewards, _, truncated, _ = vector.step(np.tile(AHEAD, (3, 1)))
    assert np.array_equal(after, observations)
    assert rewards.tolist() == [0.0] * 3
    assert truncated.all()
    mask = np.array([True, False, True])
    simulator.reset(mask)
    observations, _ = vector.reset(options={"reset_mask": mask})
    assert np.array_equal(observations, simulator.observations)
    _, _, _, truncated, infos = vector.step(stay)
    assert truncated.tolist() == [False, True, False]
    assert infos["outcome"].tolist() == [0, 3, 0]


def test_robots_that_end_apart_are_reset_apart() -> None:
    """Robots drive ahead until walls end their episodes one by one: in both modes others are not disturbed."""
    config = SimConfig()
    logs: dict[AutoresetMode, list[list[tuple[float, bool]]]] = {}
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
        vector = NavigationVectorEnv(8, config, autoreset_mode=mode)
        vector.reset(seed=1)
        log: list[list[tuple[float, bool]]] = [[] for _ in range(8)]
        ended = np.zeros(8, np.bool_)
        for _ in range(400):
            _, rewards, terminated, truncated, _ = vector.step(np.tile(AHEAD, (8, 1)))
            for k in range(8):
                # NEXT_STEP spends one step on each reset, which is no step of an episode.
                if not (mode is AutoresetMode.NEXT_STEP and ended[k]):
                    log[k].append((float(rewards[k]), bool(terminated[k] | truncated[k])))
            ended = terminated | truncated
        logs[mode] = log
    for next_step, same_step in zip(*logs.values(), strict=True):
        assert sum(end for _, end in next_step) > 3
        assert same_step[: len(next_step)] == next_step


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_robot_k_is_the_same_in_any_batch_and_for_any_threads(mode: AutoresetMode) -> None:
    def run(num_envs: int, num_threads: int) -> list[NDArray[Any]]:
        vector = NavigationVectorEnv(num_envs, num_threads=num_threads, autoreset_mode=mode)
        observations, _ = vector.reset(seed=9)
        log = [observations[0]]
        for step in range(150):
            observations, rewards, terminated, *_ = vector.step(actions_of(step, num_envs))
            log += [observations[0], rewards[0], terminated[0]]
        return log

    expected = run(1, 1)
    for num_envs, num_threads in ((64, 1), (64, 2)):
        assert all(np.array_equal(a, b) for a, b in zip(run(num_envs, num_threads), expected, strict=True))


def test_results_are_the_callers_to_keep() -> None:
    vector = NavigationVectorEnv(2)
    first, _ = vector.reset(seed=0)
    kept = first.copy()
    second, rewards, terminated, truncated, infos = vector.step(np.tile(AHEAD, (2, 1)))
    vector.step(np.tile(AHEAD, (2, 1)))
    assert np.array_equal(first, kept)
    for result in (first, second, rewards, terminated, truncated, infos["outcome"]):
        result[:] = 0


def test_a_list_of_seeds_names_the_episodes_as_a_whole() -> None:
    vector = NavigationVectorEnv(2)
    first, _ = vector.reset(seed=[1, 2])
    other, _ = vector.reset(seed=[1, 3])
    again, _ = vector.reset(seed=[1, 2])
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("mask", [[True, False], np.array([1, 0]), np.array([True]), np.array([[True, False]])])
def test_bad_masks_are_refused(mask: object) -> None:
    vector = NavigationVectorEnv(2)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match=r"reset_mask.*expected a bool array of shape \(2,\)"):
        vector.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="a seed names the episodes of all robots"):
        vector.reset(seed=1, options={"reset_mask": np.array([True, False])})


def test_wrappers_of_gymnasium_work() -> None:
    vector = gymnasium.wrappers.vector.RecordEpisodeStatistics(
        gymnasium.make_vec("navrl/TD3World-v0", num_envs=4, config=SHORT, autoreset_mode=AutoresetMode.SAME_STEP)
    )
    vector.reset(seed=0)
    for _ in range(5):
        *_, infos = vector.step(np.tile(STAY, (4, 1)))
    assert infos["episode"]["l"].tolist() == [5] * 4
    listed = gymnasium.wrappers.vector.DictInfoToList(NavigationVectorEnv(2))
    _, infos_of_each = listed.reset(seed=0)
    assert infos_of_each == [{"outcome": 0, "is_success": False}] * 2


def test_pictures_show_the_way_of_the_episode() -> None:
    environment = NavigationEnv(SimConfig(world=WorldConfig(name="boxes")), render_mode="rgb_array")
    environment.reset(seed=0)
    first = environment.render()
    for _ in range(10):
        environment.step(AHEAD)
    second = environment.render()
    environment.reset()
    assert first is not None
    assert second is not None
    assert first.shape == second.shape
    assert first.dtype == np.uint8
    assert first.shape[2] == 3
    assert (first != second).any()
    vector = NavigationVectorEnv(2, render_mode="rgb_array")
    vector.reset(seed=0)
    pictures = vector.render()
    assert pictures is not None
    assert len(pictures) == 2
    assert NavigationVectorEnv(2).render() is None
