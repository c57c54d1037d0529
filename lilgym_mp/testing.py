"""Checks that environments keep this package's contracts, for authors of appearances, wrappers and adapters.

    from lilgym_mp import testing

    def test_my_wrapper():
        single = lambda: MyWrapper(gym.make(id))
        testing.check_env(single)
        testing.check_vector_env(lambda **settings: my_wrapper_v0(gym.make_vec(id, **settings)), single)

Each check plays random episodes and raises AssertionError naming what is wrong. The contract: environment i of a batch
seeded with s plays what a single environment seeded with s + i plays, whichever processes step it and whichever
autoreset mode resets it: the same observations, masks, rewards, flags and infos, in the form of Gymnasium's
`SyncVectorEnv` or of Stable-Baselines3's `DummyVecEnv`.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils import env_checker
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array

from lilgym_mp.envs.masks import attribute
from lilgym_mp.envs.observation import row_of

if TYPE_CHECKING:
    from lilgym_mp.envs.proposer_verifier import BatchedGames

# Of actions: STOP, and any at all; the others are legal
STOP_SHARE = 0.1
ANY_SHARE = 0.1
OUTCOMES = ("success", "wrong_stop", "invalid_action", "horizon")
READ = ("action_masks", "goal_reached")  # methods that are compared, too, before each step
STEP_RESULTS = ("observations", "rewards", "terminated", "truncated", "infos")

SingleEnv = gym.Env[Any, Any]
Results = dict[str, Any]  # of a reset or a step, by name


def check_env(make: Callable[[], SingleEnv], *, exact_masks: bool = True, steps: int = 200) -> None:
    """Checks single environments: Gymnasium's own check, spaces, types, masks, infos, seeds, resets and `close`.

    `exact_masks`: whether every action outside the mask is invalid; False for wrappers that mask valid ones.
    """
    _check_seeds(lambda: _Single(make(), exact_masks=exact_masks), steps)
    env = make()
    action = env.action_space.sample()
    _check_raises(ResetNeeded, "before the first reset", env.step, action)
    env.reset(seed=0)
    while not any(env.step(action)[2:4]):
        pass
    _check_raises(ResetNeeded, "after the end of an episode", env.step, action)
    _check_closed(env, action)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
        env_checker.check_env(make(), skip_render_check=True, skip_close_check=True)


def check_vector_env(
    make: Callable[..., VectorEnv[Any, Any, Any]],
    make_single: Callable[[], SingleEnv],
    *,
    num_envs: int = 9,
    modes: Sequence[AutoresetMode] = tuple(AutoresetMode),
    exact_masks: bool = True,
    steps: int = 40,
) -> None:
    """Checks vector environments, `make(num_envs=, autoreset_mode=)`, against single ones, which `check_env` checks.

    This package's batches run compiled code from eight environments on.
    """
    _check_seeds(lambda: _Single(make_single(), exact_masks=exact_masks), steps)
    for mode in modes:
        _check_same_play(
            lambda mode=mode: _Vector(make(num_envs=num_envs, autoreset_mode=mode)),
            lambda mode=mode: _Vector(SyncVectorEnv([make_single] * num_envs, autoreset_mode=mode)),
            steps,
        )
    env = make(num_envs=num_envs, autoreset_mode=modes[0])
    actions = env.action_space.sample()
    _check_raises(ResetNeeded, "before the first reset", env.step, actions)
    observations, _ = env.reset(seed=0)
    _require(observations in env.observation_space, "a batch's observation is not in its observation space")
    _check_closed(env, actions)


def check_sb3_env(make: Callable[[], Any], make_single: Callable[[], SingleEnv], *, steps: int = 40) -> None:
    """Checks Stable-Baselines3's VecEnvs against single environments, and their seeds."""
    from stable_baselines3.common.vec_env import DummyVecEnv

    with closing(make()) as env:
        count = env.num_envs
    _check_same_play(lambda: _SB3(make()), lambda: _SB3(DummyVecEnv([make_single] * count)), steps)


def check_game(make: Callable[[], Any], *, steps: int = 200) -> None:
    """Checks PettingZoo's parallel form of the game: spaces, masks and seeds."""
    _check_seeds(lambda: _ParallelGames([make()]), steps)


def check_batched_games(
    make: Callable[[int], BatchedGames], make_single: Callable[[], Any], *, num_games: int = 9, steps: int = 40
) -> None:
    """Checks batches of games, `make(num_games)`, against single parallel ones, which `check_game` checks."""
    _check_same_play(
        lambda: _Games(make(num_games)), lambda: _ParallelGames([make_single() for _ in range(num_games)]), steps
    )
    games = make(1)
    actions = {agent: np.zeros(1, np.int64) for agent in games.possible_agents}
    _check_raises(ResetNeeded, "before the first reset", games.step, actions)
    games.reset(seed=0)
    _check_closed(games, actions)


def _check_same_play(make: Callable[[], Any], make_reference: Callable[[], Any], steps: int) -> None:
    """Both play the same, with a seed and when a reset without one continues the generators."""
    with closing(make()) as ours, closing(make_reference()) as theirs:
        for seed in (5, None, 5):
            _check_same(_play(ours, seed, steps), _play(theirs, seed, steps), "of single environments")


def _check_seeds(make: Callable[[], Any], steps: int) -> None:
    """The same seed gives the same play, whatever was played before."""
    with closing(make()) as player, closing(make()) as other:
        state = np.random.get_state(legacy=False)  # noqa: NPY002
        played = _play(player, 0, steps)
        _check_same(_play(other, 0, steps), played, "of another environment with the same seed")
        _check_same(_play(player, 0, steps), played, "before a reset with the same seed")
        assert_same(np.random.get_state(legacy=False), state, "NumPy's global generator")  # noqa: NPY002


def _play(player: Any, seed: int | None, steps: int) -> list[Any]:
    """The results of a reset and of `steps` steps. Checks that later steps do not change them."""
    generators = [np.random.default_rng(env_id) for env_id in range(player.count)]
    played = [player.reset(seed)]
    copies = copy.deepcopy(played)
    for _ in range(steps):
        pairs = zip(player.masks(), generators, strict=True)
        played.append(player.step([_choose(player.action_space, mask, generator) for mask, generator in pairs]))
        copies.append(copy.deepcopy(played[-1]))
    _check_same(played, copies, "before more steps, for an earlier observation")
    return played


def _check_same(ours: list[Any], theirs: list[Any], where: str) -> None:
    for number, (one, other) in enumerate(zip(ours, theirs, strict=True)):
        assert_same(one, other, f"the results of step {number}, compared with those {where},")


def _choose(space: Any, mask: Any, generator: np.random.Generator) -> Any:
    """Mostly a legal action; any where the mask is not one of the space's actions."""
    if isinstance(space, Mapping):
        return {agent: _choose(space[agent], mask[agent], generator) for agent in space}
    if not isinstance(space, spaces.Discrete):
        space.seed(int(generator.integers(2**31)))
        return space.sample()
    kind = generator.random()
    if kind < STOP_SHARE:
        return 0
    return int(generator.integers(space.n) if kind < STOP_SHARE + ANY_SHARE else generator.choice(np.flatnonzero(mask)))


class _Single:
    """A Gymnasium environment, which is reset when its episodes end. Checks what its results say of themselves."""

    count = 1

    def __init__(self, env: SingleEnv, *, exact_masks: bool) -> None:
        self._env = env
        self._exact_masks = exact_masks
        self.action_space = env.action_space
        self.close = env.close

    def reset(self, seed: int | None) -> Results:
        observation, info = self._env.reset(seed=seed)
        _require(observation in self._env.observation_space, "an observation is not in the observation space")
        _require("task" in info, f"infos of a reset name no task: {info}")
        return {"observations": observation, "infos": info}

    def masks(self) -> Sequence[Any]:
        return [attribute(self._env, "action_masks")()]

    def step(self, actions: list[Any]) -> Results:
        action = actions[0]
        before = {name: attribute(self._env, name)() for name in READ}
        results: Results = dict(zip(STEP_RESULTS, self._env.step(action), strict=True))
        observation, *others = results.values()
        _require(observation in self._env.observation_space, "an observation is not in the observation space")
        types = tuple(map(type, others))
        _require(types == (float, bool, bool, dict), f"reward, flags and info must be float, bool, bool, dict: {types}")
        info = results["infos"]
        outcome = info.get("outcome")
        if not (results["terminated"] or results["truncated"]):
            _require("outcome" not in info, f"infos before the end of an episode have an outcome: {info}")
        else:
            _require(outcome in OUTCOMES, f"the outcome must be one of {', '.join(OUTCOMES)}, not {outcome!r}")
            _require(info["is_success"] == (outcome == "success"), f"is_success contradicts the outcome: {info}")
            _require(("invalid_reason" in info) == (outcome == "invalid_action"), f"invalid_reason is wrong: {info}")
            results["started"] = self.reset(None)
        if isinstance(action, int):
            mask, goal = before.values()
            is_valid, is_allowed = outcome != "invalid_action", bool(mask[action])
            _require(is_valid >= is_allowed, f"the mask allows action {action}, which is invalid")
            is_exact = is_valid == is_allowed or not self._exact_masks
            _require(is_exact, f"the mask forbids action {action}, which is valid")
            _require(action or info["is_success"] == goal, f"goal_reached was {goal}, but STOP gave {info}")
        return before | results


class _Vector:
    """A vector environment of Gymnasium, in any autoreset mode."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self._env = env
        self.count = env.num_envs
        self.action_space = env.single_action_space
        self.close = env.close

    def reset(self, seed: int | None, **options: Any) -> Results:
        observations, infos = self._env.reset(seed=seed, **options)
        return {"observations": observations, "infos": _present(infos)}

    def masks(self) -> Sequence[Any]:
        return self._read("action_masks")

    def _read(self, name: str) -> Any:
        if isinstance(self._env, SyncVectorEnv):
            return np.stack([attribute(env, name)() for env in self._env.envs])
        return attribute(self._env, name)()

    def step(self, actions: list[Any]) -> Results:
        batch = concatenate(self.action_space, actions, create_empty_array(self.action_space, self.count))
        results = {name: self._read(name) for name in READ}
        results |= zip(STEP_RESULTS, self._env.step(batch), strict=True)
        results["infos"] = _present(results["infos"])
        ends = results["terminated"] | results["truncated"]
        if self._env.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ends.any():
            if not isinstance(self._env, SyncVectorEnv):
                _check_raises(ResetNeeded, "after the end of an episode", self._env.step, batch)
            results["started"] = self.reset(None, options={"reset_mask": ends})
        return results


def _present(infos: Mapping[str, Any]) -> Results:
    """A vector environment's infos without the entries that their masks, `_name`, exclude."""
    present: Results = {}
    for name, values in infos.items():
        if isinstance(values, Mapping):
            present[name] = _present(values)
        elif np.any(infos.get(f"_{name}", False)):
            present |= {name: values[infos[f"_{name}"]], f"_{name}": infos[f"_{name}"]}
    return present


class _SB3:
    """A VecEnv of Stable-Baselines3."""

    def __init__(self, env: Any) -> None:
        self._env = env
        self.count = env.num_envs
        self.action_space = env.action_space
        self.close = env.close

    def reset(self, seed: int | None) -> Results:
        if seed is not None:
            self._env.seed(seed)
        return {"observations": self._env.reset(), "infos": copy.deepcopy(self._env.unwrapped.reset_infos)}

    def masks(self) -> Sequence[Any]:
        return self._env.env_method("action_masks")

    def step(self, actions: list[Any]) -> Results:
        results = {name: np.array(self._env.env_method(name)) for name in READ}
        results |= zip(("observations", "rewards", "dones", "infos"), self._env.step(np.array(actions)), strict=True)
        results["rewards"] = results["rewards"].astype(np.float32)  # SubprocVecEnv has float64
        for info, done in zip(results["infos"], results["dones"], strict=True):
            info.pop("episode", None)  # of a monitor
            if not done:
                info.pop("TimeLimit.truncated", None)  # which DummyVecEnv adds in every step
        return results


class _Games:
    """A batch of games. Observations, rewards and infos are by agent."""

    def __init__(self, games: BatchedGames) -> None:
        self._env = games
        self.count = games.num_games
        self.action_space = games.single_action_spaces
        self.close = games.close

    def reset(self, seed: int | None) -> list[Any]:
        observations, _ = self._env.reset(seed=seed)
        self._shown = [row_of(observations, index) for index in range(self.count)]
        return self._shown.copy()

    def masks(self) -> Sequence[Any]:
        return [{agent: shown[agent]["action_mask"] for agent in self.action_space} for shown in self._shown]

    def step(self, actions: list[Any]) -> list[Any]:
        batch = {agent: np.array([action[agent] for action in actions]) for agent in self.action_space}
        observations, rewards, terminated, truncated, infos = self._env.step(batch)
        self._shown = [row_of(observations, index) for index in range(self.count)]
        ended = [infos.get(name, [None] * self.count) for name in ("final_observation", "final_info")]
        results = zip(self._shown, terminated, truncated, *ended, strict=True)
        return [{"rewards": row_of(rewards, index), "others": others} for index, others in enumerate(results)]


class _ParallelGames(_Games):
    """Parallel environments of PettingZoo, which are reset when games end. Checks what results say of themselves."""

    def __init__(self, envs: list[Any]) -> None:
        self._envs = envs
        self.count = len(envs)
        self.action_space = {agent: envs[0].action_space(agent) for agent in envs[0].possible_agents}

    def close(self) -> None:
        for env in self._envs:
            env.close()

    def reset(self, seed: int | None) -> list[Any]:
        seeds = [None if seed is None else seed + index for index in range(self.count)]
        self._shown = [env.reset(seed=own)[0] for env, own in zip(self._envs, seeds, strict=True)]
        return self._shown.copy()

    def step(self, actions: list[Any]) -> list[Any]:
        return [self._step(*each) for each in zip(range(self.count), self._envs, actions, strict=True)]

    def _step(self, index: int, env: Any, action: Mapping[str, int]) -> Results:
        observations, rewards, terminated, truncated, infos = env.step(action)
        flags = any(terminated.values()), any(truncated.values())
        ends = any(flags)
        _require(ends != bool(env.agents), f"agents must be empty just after the end, not {env.agents}")
        for agent, info in infos.items():
            _require(
                observations[agent] in env.observation_space(agent), f"an observation of {agent} is not in its space"
            )
            is_illegal = info.get("illegal_choice", False)  # invalid edits are legal choices, with that outcome
            is_allowed = self._shown[index][agent]["action_mask"][action[agent]]
            _require(not (is_allowed and is_illegal), f"the mask allows {agent} {action}, which is illegal")
            _require(ends == ("outcome" in info), f"infos have an outcome if and only if the game ends: {info}")
        self._shown[index] = env.reset()[0] if ends else observations
        ended = (observations, infos) if ends else (None, None)
        return {"rewards": rewards, "others": (self._shown[index], *flags, *ended)}


def assert_same(value: Any, expected: Any, what: str = "the value") -> None:
    """Raises AssertionError unless both are equal in structure, dtype and every value."""
    if isinstance(expected, Mapping):
        _require(isinstance(value, Mapping), f"{what} is a {type(value).__name__}, not a mapping")
        _require(value.keys() == expected.keys(), f"{what} has the entries {[*value]}, not {[*expected]}")
        for key in expected:
            assert_same(value[key], expected[key], f"{key!r} in {what}")
    elif isinstance(expected, list | tuple) or (isinstance(expected, np.ndarray) and expected.dtype.kind == "O"):
        _require(len(value) == len(expected), f"{what} has {len(value)} parts, not {len(expected)}")
        for part, expected_part in zip(value, expected, strict=True):
            assert_same(part, expected_part, f"a part of {what}")
    else:
        one, other = np.asarray(value), np.asarray(expected)
        _require(one.dtype == other.dtype, f"{what} has dtype {one.dtype}, not {other.dtype}")
        if not np.array_equal(one, other):  # texts of arrays are slow
            raise AssertionError(f"{what} is {value!r}, not {expected!r}")


def _require(condition: object, message: str) -> None:
    """Raises AssertionError with the message unless the condition holds, also under `python -O`."""
    if not condition:
        raise AssertionError(message)


def _check_closed(env: Any, action: Any) -> None:
    env.close()
    env.close()
    for method, arguments in ((env.reset, ()), (env.step, (action,))):
        _check_raises(ClosedEnvironmentError, "after close", method, *arguments)


def _check_raises(error: type[Exception], when: str, method: Callable[..., Any], *arguments: Any) -> None:
    try:
        method(*arguments)
    except error:
        return
    raise AssertionError(f"{method.__name__} {when} must raise {error.__name__}")
