"""`lilgym_mp.testing` passes on all that the package makes, and fails on environments that break one contract each."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorWrapper

from lilgym_mp import testing
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.wrappers import action_mask_v0, stop_forcing_v0

TOWER, TOWER_FLIPIT = "lilgym_mp/TowerScratch-v0", "lilgym_mp/TowerFlipIt-v0"
SCATTER, SCATTER_FLIPIT = "lilgym_mp/ScatterScratch-v0", "lilgym_mp/ScatterFlipIt-v0"
SCALAR, COMPILED = 3, 9  # environments

pytestmark = pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")


@pytest.mark.parametrize(
    ("id", "rules"),
    [(TOWER, "paper"), (TOWER_FLIPIT, "release"), (SCATTER, "release"), (SCATTER_FLIPIT, "paper")],
)
def test_single(id: str, rules: str) -> None:
    testing.check_env(lambda: gym.make(id, rules=rules))


@pytest.mark.parametrize(
    ("id", "num_envs", "settings"),
    [
        (TOWER, SCALAR, {}),
        (TOWER, COMPILED, {"horizon": 3, "observation": "arrays"}),
        (TOWER_FLIPIT, COMPILED, {"rules": "release", "image_size": "native"}),
        (TOWER_FLIPIT, 1, {"split": "dev"}),
        (SCATTER, COMPILED, {"horizon": 3, "rules": "release"}),
        (SCATTER_FLIPIT, SCALAR, {"rules": "release", "image_size": "native", "split": "dev"}),
        (SCATTER_FLIPIT, COMPILED, {"grid": (38, 10), "observation": "arrays"}),
    ],
    ids=str,
)
def test_batch(id: str, num_envs: int, settings: dict[str, Any]) -> None:
    check = partial(testing.check_vector_env, num_envs=num_envs, steps=12)
    check(partial(gym.make_vec, id, **settings), lambda: gym.make(id, **settings))


def test_batch__of_official_tasks(official_data: object) -> None:
    for id in (TOWER, TOWER_FLIPIT, SCATTER, SCATTER_FLIPIT):
        settings: Any = {"corpus": "lilgym", "split": "dev", "rules": "release"}
        one = lambda id=id, settings=settings: gym.make(id, **settings)  # noqa: E731
        testing.check_vector_env(partial(gym.make_vec, id, **settings), one, modes=[AutoresetMode.SAME_STEP], steps=10)


@pytest.mark.parametrize(
    ("id", "num_envs", "settings", "modes"),
    [
        (SCATTER_FLIPIT, 18, {"num_workers": 2, "start_method": "fork"}, AutoresetMode),  # compiled in each process
        (TOWER, 7, {"num_workers": 3, "start_method": "fork", "rules": "release"}, [AutoresetMode.NEXT_STEP]),
        (TOWER, 4, {"num_workers": 1}, [AutoresetMode.DISABLED]),
        (SCATTER, 5, {"num_workers": 2, "start_method": "forkserver"}, [AutoresetMode.NEXT_STEP]),
        (SCATTER, 5, {"num_workers": 2, "start_method": "spawn", "rules": "release"}, [AutoresetMode.SAME_STEP]),
    ],
    ids=str,
)
def test_workers(id: str, num_envs: int, settings: dict[str, Any], modes: list[AutoresetMode]) -> None:
    rules = settings.get("rules", "paper")
    check = partial(testing.check_vector_env, num_envs=num_envs, modes=tuple(modes), steps=12)
    check(partial(WorkerVectorEnv, id, **settings), lambda: gym.make(id, rules=rules))


@pytest.mark.parametrize(
    ("id", "backend", "settings"),
    [
        (TOWER_FLIPIT, "batched", {"wrap": action_mask_v0}),
        (SCATTER_FLIPIT, "batched", {"wrap": partial(stop_forcing_v0, mode="replace"), "rules": "release"}),
        (TOWER_FLIPIT, "dummy", {"wrap": partial(stop_forcing_v0, mode="mask")}),
        (TOWER_FLIPIT, "subproc", {"wrap": partial(stop_forcing_v0, mode="mask"), "start_method": "fork"}),
        (SCATTER_FLIPIT, "workers", {"wrap": partial(stop_forcing_v0, mode="mask"), "num_workers": 2}),
    ],
)
def test_sb3(id: str, backend: str, settings: dict[str, Any]) -> None:
    pytest.importorskip("stable_baselines3", reason="needs the extra: pip install 'lilgym-mp[sb3]'")
    from lilgym_mp.sb3 import make_vec_env

    wrap, rules = settings.get("wrap", lambda env: env), settings.get("rules", "paper")
    single = lambda: wrap(gym.make(id, observation="arrays", rules=rules))  # noqa: E731
    testing.check_sb3_env(lambda: make_vec_env(id, 4, backend, **settings), single, steps=15)


VIEWS = {"proposer_0": {"history": 2}, "verifier_0": {"scene": "structured", "history": 1}}
GAMES: list[dict[str, Any]] = [
    {"protocol": "veto", "views": VIEWS, "rewards": "hidden", "message_size": 1},
    {"protocol": "joint", "rewards": "correctness", "message_cost": 0.25, "message_size": 2},
    {"protocol": "audit", "views": {"statement": "text"}, "rewards": "correctness"},
    {"protocol": "critique", "exchanges": 1, "homogeneous": True, "views": {"statement": "none", "target": False}},
    {"protocol": "veto", "rules": "release", "start": "flipit", "reveal_truth": True},
    {"protocol": "joint", "appearance": "scatter", "start": "flipit", "image_size": "native"},
    {"protocol": "critique", "appearance": "scatter", "views": {"scene": "structured", "proposed_scene": True}},
    {"protocol": "audit", "views": {"proposed_scene": True}, "horizon": 4, "rewards": "hidden"},
]


@pytest.mark.parametrize("settings", GAMES, ids=str)
def test_game(settings: dict[str, Any]) -> None:
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    from lilgym_mp.envs.proposer_verifier import BatchedGames, parallel_env

    one = partial(parallel_env, **settings)
    testing.check_game(one, steps=60)
    testing.check_batched_games(lambda count: BatchedGames(count, **settings), one, steps=12)


# Each of these breaks one contract.


Method = tuple[str, Callable[..., Any]]


def results_changed(change: Callable[..., Any]) -> Method:
    """A `step` whose results `change` modifies."""
    return "step", lambda self, action: change(*self.env.step(action))


def info_changed(**entries: Any) -> Method:
    return results_changed(
        lambda image, reward, terminated, truncated, info: (
            image,
            reward,
            terminated,
            truncated,
            {**info, **entries} if terminated else info,
        )
    )


def unseeded(self: Any, *, seed: Any = None, options: Any = None) -> Any:
    return self.env.reset(options=options)


def globally_random(self: Any, *, seed: Any = None, options: Any = None) -> Any:
    np.random.random()  # noqa: NPY002
    return self.env.reset(seed=seed, options=options)


def unnamed(self: Any, *, seed: Any = None, options: Any = None) -> Any:
    return self.env.reset(seed=seed, options=options)[0], {}


def stepping_on(self: Any, action: int) -> Any:
    if self.unwrapped._ended:
        self.env.reset()
    return self.env.step(action)


def overwriting(self: Any, action: int) -> Any:
    observation, *rest = self.env.step(action)
    vars(self).setdefault("image", observation["image"])[:] = observation["image"]
    return {**observation, "image": self.image}, *rest


SINGLES: dict[str, Method] = {
    "the mask allows action": ("action_masks", lambda self: np.ones(13, np.bool_)),
    "the mask forbids action": ("action_masks", lambda self: np.arange(13) == 0),
    "goal_reached was": ("goal_reached", lambda self: True),
    "the outcome must be one of": info_changed(outcome="win"),
    "is_success contradicts": info_changed(is_success=True),
    "invalid_reason is wrong": info_changed(invalid_reason="overlap"),
    "have an outcome": results_changed(lambda *results: (*results[:4], {"outcome": "horizon", "is_success": False})),
    "must be float, bool": results_changed(lambda image, reward, *rest: (image, np.float64(reward), *rest)),
    "not in the observation space": results_changed(lambda seen, *rest: ({**seen, "target": 2}, *rest)),
    "name no task": ("reset", unnamed),
    "with the same seed": ("reset", unseeded),
    "global generator": ("reset", globally_random),
    "an earlier observation": ("step", overwriting),
    "after the end of an episode must raise ResetNeeded": ("step", stepping_on),
    "reset after close must raise": ("close", lambda self: None),
}


@pytest.mark.parametrize("message", SINGLES)
def test_check_env__finds(message: str) -> None:
    changed: Any = type("Changed", (gym.Wrapper,), dict([SINGLES[message]]))
    with pytest.raises(AssertionError, match=message):
        testing.check_env(lambda: changed(gym.make(TOWER)))


class ChangedVector(VectorWrapper):
    """A batch with one part of its results changed."""

    def __init__(self, change: Callable[..., Any], **settings: Any) -> None:
        super().__init__(gym.make_vec(TOWER, **settings))
        self.change, self.ended = change, np.zeros(self.num_envs, np.bool_)

    def step(self, actions: Any) -> Any:
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        self.change(self, observations, rewards, infos, self.ended)
        self.ended = terminated | truncated
        return observations, rewards, terminated, truncated, infos


def show_next(env: Any, observations: Any, rewards: Any, infos: Any, ended: Any) -> None:
    for env_id in np.flatnonzero(infos.get("_final_obs", [])):
        infos["final_obs"][env_id]["image"] = observations["image"][env_id]


def swap(env: Any, observations: Any, rewards: Any, infos: Any, ended: Any) -> None:
    rewards[[0, 1]] = rewards[[1, 0]]


def pay(env: Any, observations: Any, rewards: Any, infos: Any, ended: Any) -> None:
    rewards[ended] = -0.1


def mark(env: Any, observations: Any, rewards: Any, infos: Any, ended: Any) -> None:
    for name in ("_task", "_outcome"):
        if name in infos:
            infos[name] = np.ones_like(infos[name])


def restart(env: Any, observations: Any, rewards: Any, infos: Any, ended: Any) -> None:
    env.env._buffers.ended[:] = False


VECTORS = {
    (AutoresetMode.SAME_STEP, show_next): "'image' in a part of 'final_obs'",
    (AutoresetMode.SAME_STEP, swap): "'rewards' in the results of step",
    (AutoresetMode.NEXT_STEP, pay): "'rewards' in the results of step",
    (AutoresetMode.NEXT_STEP, mark): "'(task|outcome)' in 'infos'",
    (AutoresetMode.DISABLED, restart): "after the end of an episode must raise ResetNeeded",
}


@pytest.mark.parametrize(("mode", "change"), VECTORS)
def test_check_vector_env__finds(mode: AutoresetMode, change: Callable[..., Any]) -> None:
    with pytest.raises(AssertionError, match=VECTORS[mode, change]):
        testing.check_vector_env(partial(ChangedVector, change), lambda: gym.make(TOWER), num_envs=3, modes=[mode])


def test_check_sb3_env__finds() -> None:
    pytest.importorskip("stable_baselines3", reason="needs the extra: pip install 'lilgym-mp[sb3]'")
    from stable_baselines3.common.vec_env import VecEnvWrapper

    from lilgym_mp.sb3 import make_vec_env

    class ChangedSB3(VecEnvWrapper):
        def __init__(self, name: str, change: Callable[[Any], Any]) -> None:
            super().__init__(make_vec_env(TOWER, 3))
            self.name, self.change = name, change

        def reset(self) -> Any:
            return self.venv.reset()

        def step_wait(self) -> Any:
            *results, infos = self.venv.step_wait()
            for env_id in np.flatnonzero(results[2]):
                infos[env_id][self.name] = self.change(infos[env_id][self.name])
            return *results, infos

    for name, change, message in (
        (
            "terminal_observation",
            lambda last: {**last, "image": last["image"] * 0},
            "'image' in 'terminal_observation'",
        ),
        ("TimeLimit.truncated", lambda truncated: not truncated, "'TimeLimit.truncated' in a part of 'infos'"),
        ("is_success", lambda success: not success, "'is_success' in a part of 'infos'"),
    ):
        with pytest.raises(AssertionError, match=message):
            testing.check_sb3_env(
                lambda name=name, change=change: ChangedSB3(name, change), lambda: gym.make(TOWER, observation="arrays")
            )


def test_check_game__finds(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    from lilgym_mp.envs.proposer_verifier import BatchedGames, parallel_env

    class Allowing(BatchedGames):
        def _observations(self) -> Any:
            observations = super()._observations()
            for observation in observations.values():
                observation["action_mask"] = np.ones_like(observation["action_mask"])
            return observations

    class Swapping(BatchedGames):
        def step(self, actions: Any) -> Any:
            observations, rewards, *rest = super().step(actions)
            return observations, dict(zip(rewards, reversed(rewards.values()), strict=True)), *rest

    class Unending(BatchedGames):
        def _final_infos(self, ended: Any) -> Any:
            infos = super()._final_infos(ended)
            return {
                **infos,
                "final_info": tuple(each and {agent: {} for agent in each} for each in infos["final_info"]),
            }

    for broken, message in (
        (Allowing, "'action_mask' in"),
        (Swapping, "'proposer_0' in 'rewards'"),
        (Unending, "'proposer_0' in a part of 'others'"),
    ):
        with pytest.raises(AssertionError, match=message):
            testing.check_batched_games(
                lambda count, broken=broken: broken(count, rewards="correctness"),
                partial(parallel_env, rewards="correctness"),
            )
    monkeypatch.setattr("lilgym_mp.envs.checks.checked_seed", lambda seed: seed)
    game = parallel_env()
    monkeypatch.setattr(game, "reset", lambda seed=None, options=None: type(game).reset(game))
    with pytest.raises(AssertionError, match="with the same seed"):
        testing.check_game(lambda: game)


BROKEN = """
import gymnasium as gym
from lilgym_mp import testing

class Doubled(gym.Wrapper):
    def step(self, action):
        observation, reward, *others = self.env.step(action)
        return observation, str(reward), *others

try:
    testing.check_env(lambda: Doubled(gym.make("lilgym_mp/TowerFlipIt-v0")), steps=5)
except AssertionError as fault:
    print(__debug__, fault)
"""


def test_check_env__finds_a_broken_environment_under_python_o() -> None:
    done = subprocess.run([sys.executable, "-O", "-c", BROKEN], capture_output=True, text=True, check=False)
    assert done.stdout.startswith("False reward, flags and info must be float, bool, bool, dict"), done.stderr


def test_testing__has_no_assert_statements() -> None:
    tree = ast.parse(Path(testing.__file__).read_text())
    assert not any(isinstance(node, ast.Assert) for node in ast.walk(tree))
