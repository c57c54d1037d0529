"""`lilgym_mp.testing` passes on all that the package makes, and fails on environments that break one contract each."""

import ast
from functools import partial
from pathlib import Path

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
def test_single(id, rules):
    testing.check_env(lambda: gym.make(id, rules=rules), steps=100)


@pytest.mark.parametrize(
    ("id", "num_envs", "settings"),
    [
        (TOWER, SCALAR, {}),
        (TOWER_FLIPIT, COMPILED, {"horizon": 3, "observation": "arrays"}),
        (TOWER_FLIPIT, 1, {"rules": "release", "image_size": "native"}),
        (SCATTER, COMPILED, {"horizon": 3, "rules": "release"}),
        (SCATTER_FLIPIT, SCALAR, {"rules": "release", "image_size": "native", "split": "dev"}),
    ],
    ids=str,
)
def test_batch(id, num_envs, settings):
    check_batch(id, settings, num_envs=num_envs)


@pytest.mark.usefixtures("official_data")
@pytest.mark.parametrize("id", [TOWER_FLIPIT, SCATTER_FLIPIT])
def test_batch__of_official_tasks(id):
    check_batch(id, {"corpus": "lilgym", "split": "dev", "rules": "release"}, modes=[AutoresetMode.SAME_STEP])


def check_batch(id, settings, **options):
    make, single = partial(gym.make_vec, id, **settings), partial(gym.make, id, **settings)
    testing.check_vector_env(make, single, steps=10, **options)


@pytest.mark.parametrize(
    ("id", "num_envs", "settings", "modes"),
    [
        (SCATTER_FLIPIT, 16, {"start_method": "fork"}, [AutoresetMode.SAME_STEP]),  # compiled in each process
        (TOWER, 7, {"num_workers": 3, "start_method": "fork", "rules": "release"}, [AutoresetMode.NEXT_STEP]),
        (TOWER, 4, {"num_workers": 1}, [AutoresetMode.DISABLED]),
        *(
            pytest.param(SCATTER, 5, {"start_method": start}, [AutoresetMode.SAME_STEP], marks=pytest.mark.long)
            for start in ("forkserver", "spawn")
        ),
    ],
    ids=str,
)
def test_workers(id, num_envs, settings, modes):
    rules = settings.get("rules", "paper")
    check = partial(testing.check_vector_env, num_envs=num_envs, modes=tuple(modes), steps=8)
    check(partial(WorkerVectorEnv, id, **{"num_workers": 2, **settings}), lambda: gym.make(id, rules=rules))


MASKED = {"wrap": partial(stop_forcing_v0, mode="mask")}


@pytest.mark.parametrize(
    ("id", "backend", "settings"),
    [
        (TOWER_FLIPIT, "batched", {"wrap": action_mask_v0}),
        (SCATTER_FLIPIT, "batched", {"wrap": partial(stop_forcing_v0, mode="replace"), "rules": "release"}),
        (TOWER_FLIPIT, "dummy", MASKED),
        pytest.param(TOWER_FLIPIT, "subproc", {**MASKED, "start_method": "fork"}, marks=pytest.mark.long),
        (SCATTER_FLIPIT, "workers", {**MASKED, "num_workers": 2}),
    ],
)
def test_sb3(id, backend, settings):
    pytest.importorskip("stable_baselines3")
    from lilgym_mp.sb3 import make_vec_env

    wrap, rules = settings["wrap"], settings.get("rules", "paper")
    single = lambda: wrap(gym.make(id, observation="arrays", rules=rules))  # noqa: E731
    testing.check_sb3_env(lambda: make_vec_env(id, 4, backend, **settings), single, steps=15)


VIEWS = {"proposer_0": {"history": 2}, "verifier_0": {"scene": "structured", "history": 1}}
GAMES = [
    {"protocol": "veto", "views": VIEWS, "rewards": "hidden", "message_size": 1},
    {"protocol": "joint", "rewards": "correctness", "message_cost": 0.25, "message_size": 2},
    {"protocol": "audit", "views": {"statement": "text", "proposed_scene": True}, "horizon": 4, "rewards": "hidden"},
    {"protocol": "critique", "exchanges": 1, "homogeneous": True, "views": {"statement": "none", "target": False}},
    {"protocol": "veto", "rules": "release", "start": "flipit", "reveal_truth": True},
    {"protocol": "critique", "appearance": "scatter", "views": {"scene": "structured", "proposed_scene": True}},
]


@pytest.mark.parametrize("settings", GAMES, ids=str)
def test_game(settings):
    pytest.importorskip("pettingzoo")
    from lilgym_mp.envs.proposer_verifier import BatchedGames, parallel_env

    one = partial(parallel_env, **settings)
    testing.check_batched_games(lambda count: BatchedGames(count, **settings), one, num_games=8, steps=10)


# Each of these breaks one contract.


def results_changed(change):
    """A `step` whose results `change` modifies."""
    return "step", lambda self, action: change(*self.env.step(action))


def info_changed(**entries):
    return results_changed(lambda *results: (*results[:4], {**results[4], **entries} if results[2] else results[4]))


def unseeded(self, *, seed=None, options=None):
    return self.env.reset(options=options)


def globally_random(self, *, seed=None, options=None):
    np.random.random()  # noqa: NPY002
    return self.env.reset(seed=seed, options=options)


def unnamed(self, *, seed=None, options=None):
    return self.env.reset(seed=seed, options=options)[0], {}


def stepping_on(self, action):
    if self.unwrapped._ended:
        self.env.reset()
    return self.env.step(action)


def overwriting(self, action):
    observation, *rest = self.env.step(action)
    vars(self).setdefault("image", observation["image"])[:] = observation["image"]
    return {**observation, "image": self.image}, *rest


SINGLES = {
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
def test_check_env__finds(message):
    changed = type("Changed", (gym.Wrapper,), dict([SINGLES[message]]))
    with pytest.raises(AssertionError, match=message):
        testing.check_env(lambda: changed(gym.make(TOWER)), steps=60)


class ChangedVector(VectorWrapper):
    """A batch with one part of its results changed."""

    def __init__(self, change, **settings):
        super().__init__(gym.make_vec(TOWER, **settings))
        self.change, self.ended = change, np.zeros(self.num_envs, np.bool_)

    def step(self, actions):
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        self.change(self, observations, rewards, infos, self.ended)
        self.ended = terminated | truncated
        return observations, rewards, terminated, truncated, infos


def show_next(env, observations, rewards, infos, ended):
    for env_id in np.flatnonzero(infos.get("_final_obs", [])):
        infos["final_obs"][env_id]["image"] = observations["image"][env_id]


def swap(env, observations, rewards, infos, ended):
    rewards[[0, 1]] = rewards[[1, 0]]


def pay(env, observations, rewards, infos, ended):
    rewards[ended] = -0.1


def mark(env, observations, rewards, infos, ended):
    for name in ("_task", "_outcome"):
        if name in infos:
            infos[name] = np.ones_like(infos[name])


def restart(env, observations, rewards, infos, ended):
    env.env._buffers.ended[:] = False


VECTORS = {
    (AutoresetMode.SAME_STEP, show_next): "'image' in part . of 'final_obs' in info of step",
    (AutoresetMode.SAME_STEP, swap): "reward of step",
    (AutoresetMode.NEXT_STEP, pay): "reward of step",
    (AutoresetMode.NEXT_STEP, mark): "in info of step",
    (AutoresetMode.DISABLED, restart): "after the end of an episode must raise ResetNeeded",
}


@pytest.mark.parametrize(("mode", "change"), VECTORS)
def test_check_vector_env__finds(mode, change):
    with pytest.raises(AssertionError, match=VECTORS[mode, change]):
        testing.check_vector_env(partial(ChangedVector, change), lambda: gym.make(TOWER), num_envs=3, modes=[mode])


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("terminal_observation", lambda last: {**last, "image": last["image"] * 0}, "'image' in 'terminal_"),
        ("TimeLimit.truncated", lambda truncated: not truncated, "'TimeLimit.truncated' in part"),
    ],
)
def test_check_sb3_env__finds(name, change, message):
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.vec_env import VecEnvWrapper

    from lilgym_mp.sb3 import make_vec_env

    class ChangedSB3(VecEnvWrapper):
        def reset(self):
            return self.venv.reset()

        def step_wait(self):
            *results, infos = self.venv.step_wait()
            for env_id in np.flatnonzero(results[2]):
                infos[env_id][name] = change(infos[env_id][name])
            return *results, infos

    single = partial(gym.make, TOWER, observation="arrays")
    with pytest.raises(AssertionError, match=message):
        testing.check_sb3_env(lambda: ChangedSB3(make_vec_env(TOWER, 3)), single)


def test_check_game__finds(monkeypatch):
    pytest.importorskip("pettingzoo")
    from lilgym_mp.envs.proposer_verifier import BatchedGames, parallel_env

    class Allowing(BatchedGames):
        def _observations(self):
            observations = super()._observations()
            for observation in observations.values():
                observation["action_mask"] = np.ones_like(observation["action_mask"])
            return observations

    class Swapping(BatchedGames):
        def step(self, actions):
            observations, rewards, *rest = super().step(actions)
            return observations, dict(zip(rewards, reversed(rewards.values()), strict=True)), *rest

    single = partial(parallel_env, rewards="correctness")
    for broken, message in ((Allowing, "'action_mask' in"), (Swapping, "'proposer_0' in 'reward' in part . of step")):
        with pytest.raises(AssertionError, match=message):
            testing.check_batched_games(partial(broken, rewards="correctness"), single, num_games=3, steps=12)
    game = parallel_env()
    monkeypatch.setattr(game, "reset", lambda seed=None, options=None: type(game).reset(game))
    with pytest.raises(AssertionError, match="with the same seed"):
        testing.check_game(lambda: game, steps=12)


def test_testing__has_no_assert_statements_which_python_o_would_leave_out():
    tree = ast.parse(Path(testing.__file__).read_text())
    assert not any(isinstance(node, ast.Assert) for node in ast.walk(tree))
