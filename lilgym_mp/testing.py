"""Checks that environments keep this package's contracts, for authors of appearances, wrappers and adapters.

    from lilgym_mp import testing

    def test_my_wrapper():
        single = lambda: MyWrapper(gym.make(id))
        testing.check_env(single)
        testing.check_vector_env(lambda **settings: my_wrapper_v0(gym.make_vec(id, **settings)), single)

Each check plays random episodes and raises AssertionError naming what is wrong. The contract: environment i of a batch
seeded with s plays what a single environment seeded with s + i plays, whichever processes step it and whichever
autoreset mode resets it: the same observations, masks, rewards, flags and infos.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils import env_checker
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array

from lilgym_mp.envs.masks import action_masks, attribute
from lilgym_mp.envs.observation import row_of

if TYPE_CHECKING:
    from lilgym_mp.envs.proposer_verifier import BatchedGames

# Of actions: STOP, any at all, and one of the last legal ones, which are REMOVEs; the others are legal
STOP_SHARE = 0.1
ANY_SHARE = 0.1
LAST_SHARE = 0.2
LAST = 9  # actions
RUNNING = {"TimeLimit.truncated": False}  # an info that SB3 has before an end too
ADDED = ("episode", "agent")  # infos that only this package's VecEnvs have
RESET = ("observation", "info")
STEP = ("observation", "reward", "terminated", "truncated", "info")
OUTCOMES = ("success", "wrong_stop", "invalid_action", "horizon")

SingleEnv = gym.Env[Any, Any]
Results = dict[str, Any]  # of a reset or step, by name


def check_env(make: Callable[[], SingleEnv], *, exact_masks: bool = True, steps: int = 200) -> None:
    """Checks single environments: Gymnasium's own check, spaces, types, masks, infos, seeds, resets and `close`.

    `exact_masks`: whether every action outside the mask is invalid; False for wrappers that mask valid ones.
    """
    _check_single(make, steps, exact_masks=exact_masks)
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
    """Checks vector environments, `make(num_envs=, autoreset_mode=)`, against a `SyncVectorEnv` of single ones.

    Checks the single ones as `check_env` does. This package's batches run compiled code from eight environments on.
    """
    for mode in modes:
        reference = SyncVectorEnv([make_single] * num_envs, autoreset_mode=mode)
        _check_same_play(_Vector(make(num_envs=num_envs, autoreset_mode=mode)), _Reference(reference), steps)
    _check_single(make_single, steps, exact_masks=exact_masks)
    env = make(num_envs=num_envs, autoreset_mode=modes[0])
    actions = env.action_space.sample()
    _check_raises(ResetNeeded, "before the first reset", env.step, actions)
    env.reset(seed=0)
    _check_closed(env, actions)


def check_sb3_env(make: Callable[[], Any], make_single: Callable[[], SingleEnv], *, steps: int = 40) -> None:
    """Checks Stable-Baselines3's VecEnvs against its `DummyVecEnv` of single environments, and these as `check_env`."""
    _check_sb3(_SB3, make(), make_single, steps)
    _check_single(make_single, steps, exact_masks=False)


def check_sb3_games(make: Callable[[], Any], make_single: Callable[[], SingleEnv], *, steps: int = 40) -> None:
    """Checks Stable-Baselines3's VecEnvs of one seat of the game against a `DummyVecEnv` of `SingleAgentView`s."""
    _check_sb3(_SB3Seats, make(), make_single, steps)


def _check_sb3(player: Callable[[Any], _Player], env: Any, make_single: Callable[[], SingleEnv], steps: int) -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv

    _check_same_play(player(env), player(DummyVecEnv([make_single] * env.num_envs)), steps)


def check_game(make: Callable[[], Any], *, steps: int = 200) -> None:
    """Checks PettingZoo's parallel form of the game: spaces, masks and seeds."""
    _, *steps_taken = _check_seeds(lambda: _ParallelGames([make()]), steps)
    for results in steps_taken:
        (mask,), (action,), (infos,), (step,) = (results[name] for name in ("mask", "action", "info", "step"))
        proposer, *_ = mask
        for agent, info in infos.items():
            is_edit = agent == proposer and mask[agent].sum() > 1  # otherwise it waits
            is_wrong = "illegal_choice" in info or (is_edit and info.get("outcome") == "invalid_action")
            _require(not (mask[agent][action[agent]] and is_wrong), f"the mask allows {agent} {action[agent]}: {info}")
            _require(
                ("info" in step) == ("outcome" in info), f"infos have an outcome if and only if the game ends: {info}"
            )


def check_batched_games(
    make: Callable[[int], BatchedGames], make_single: Callable[[], Any], *, num_games: int = 9, steps: int = 40
) -> None:
    """Checks batches of games, `make(num_games)`, against single parallel ones, and these as `check_game` does."""
    _check_same_play(_Games(make(num_games)), _ParallelGames([make_single() for _ in range(num_games)]), steps)
    check_game(make_single, steps=steps)
    games = make(1)
    actions = {agent: np.zeros(1, np.int64) for agent in games.possible_agents}
    _check_raises(ResetNeeded, "before the first reset", games.step, actions)
    games.reset(seed=0)
    _check_closed(games, actions)


def _check_same_play(ours: _Player, reference: _Player, steps: int) -> None:
    """Both play the same with a seed, again with this seed, and when a reset without one continues the generators."""
    with closing(ours), closing(reference), _global_generator_unused():
        for seed in (5, 5, None):
            expected = _play(reference, seed, steps)
            _check_same_history(_play(ours, seed, steps), expected, "compared with single environments")


def _check_seeds(make: Callable[[], _Player], steps: int) -> list[Results]:
    """The play of one seed, which must be the same in two environments and after another reset."""
    with closing(make()) as player, closing(make()) as other, _global_generator_unused():
        history = _play(player, 0, steps)
        _check_same_history(_play(other, 0, steps), history, "in another environment with the same seed")
        _check_same_history(_play(player, 0, steps), history, "before a reset with the same seed")
    return history


@contextmanager
def _global_generator_unused() -> Iterator[None]:
    state = np.random.get_state(legacy=False)  # noqa: NPY002
    yield
    assert_same(np.random.get_state(legacy=False), state, "NumPy's global generator")  # noqa: NPY002


def _check_single(make: Callable[[], SingleEnv], steps: int, *, exact_masks: bool) -> None:
    """Checks what single environments say of themselves, and their seeds."""
    space = make().observation_space
    for results in _check_seeds(lambda: _Single(make()), steps):
        start = results.get("start", results)
        for each in (results, start):
            _require(each["observation"] in space, "an observation is not in the observation space")
        if "action" in results:
            _check_step(results, exact_masks=exact_masks)
        if "action" not in start:
            _require("task" in start["info"], f"infos of a reset name no task: {start['info']}")


def _check_step(step: Results, *, exact_masks: bool) -> None:
    info = step["info"]
    (action,) = step["action"]
    (mask,) = step["mask"]
    types = tuple(type(step[name]) for name in ("reward", "terminated", "truncated", "info"))
    _require(types == (float, bool, bool, dict), f"reward, flags and info must be float, bool, bool, dict: {types}")
    outcome = info.get("outcome")
    if not (step["terminated"] or step["truncated"]):
        _require("outcome" not in info, f"infos before the end of an episode have an outcome: {info}")
    else:
        _require(outcome in OUTCOMES, f"the outcome must be one of {', '.join(OUTCOMES)}, not {outcome!r}")
        _require(info["is_success"] == (outcome == "success"), f"is_success contradicts the outcome: {info}")
        _require(("invalid_reason" in info) == (outcome == "invalid_action"), f"invalid_reason is wrong: {info}")
    if isinstance(action, int):
        is_valid = outcome != "invalid_action"
        is_allowed = bool(mask[action])
        _require(is_valid >= is_allowed, f"the mask allows action {action}, which is invalid")
        _require(not exact_masks or is_valid == is_allowed, f"the mask forbids action {action}, which is valid")
        _require(action or info["is_success"] == step["goal"], f"goal_reached was {step['goal']}, but STOP gave {info}")


def _play(player: _Player, seed: int | None, steps: int) -> list[Results]:
    """The results of a reset and `steps` steps. Checks that later steps do not change them."""
    history = [player.reset(seed)]
    copies = copy.deepcopy(history)
    for number in range(steps):
        before = player.look()
        before["mask"] = copy.deepcopy(before["mask"])
        actions = [
            _choose(player.action_space, mask, np.random.default_rng([number, index]))
            for index, mask in enumerate(before["mask"])
        ]
        results = player.step(actions)
        history.append({**before, "action": actions, **results})
        copies.append(copy.deepcopy(results))
    for results, copied in zip(history, copies, strict=True):
        for name, value in copied.items():
            assert_same(results[name], value, f"an earlier {name}, after more steps,")
    return history


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
    if kind < STOP_SHARE + ANY_SHARE:
        return int(generator.integers(space.n))
    legal = np.flatnonzero(mask)
    if kind < STOP_SHARE + ANY_SHARE + LAST_SHARE:
        legal = legal[-LAST:]
    return int(generator.choice(legal))


class _Player(Protocol):
    """Environments that are stepped together and reset when their episodes end."""

    action_space: Any  # of one environment; in the game, by agent

    def reset(self, seed: int | None) -> Results: ...
    def step(self, actions: list[Any]) -> Results: ...

    def look(self) -> Results:
        """The mask of each, and whatever else there is to compare before a step."""
        ...

    def close(self) -> None: ...


def _named(names: Sequence[str], values: Sequence[Any]) -> Results:
    return dict(zip(names, values, strict=True))


class _Env:
    """An environment or VecEnv."""

    def __init__(self, env: Any) -> None:
        self.env = env
        self.action_space = env.action_space
        self.close = env.close


class _Single(_Env):
    """A Gymnasium environment."""

    def reset(self, seed: int | None) -> Results:
        return _named(RESET, self.env.reset(seed=seed))

    def step(self, actions: list[Any]) -> Results:
        results = _named(STEP, self.env.step(actions[0]))
        if results["terminated"] or results["truncated"]:
            results["start"] = self.reset(None)
        return results

    def look(self) -> Results:
        goal = attribute(self.env, "goal_reached")()
        state = attribute(self.env, "state")
        return {"mask": [action_masks(self.env)], "goal": goal, "state": state}


class _Vector:
    """A vector environment of Gymnasium, in any autoreset mode."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self.env = env
        self.action_space = env.single_action_space
        self.close = env.close

    def reset(self, seed: int | None, **options: Any) -> Results:
        return self.checked(_named(RESET, self.env.reset(seed=seed, **options)))

    def step(self, actions: list[Any]) -> Results:
        batch = concatenate(self.action_space, actions, create_empty_array(self.action_space, len(actions)))
        results = self.checked(_named(STEP, self.env.step(batch)))
        ends = results["terminated"] | results["truncated"]
        if ends.any() and self.env.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            self.check_step_after_end(batch)
            results["start"] = self.reset(None, options={"reset_mask": ends})
        return results

    def checked(self, results: Results) -> Results:
        space = self.env.observation_space
        _require(results["observation"] in space, "a batch's observation is not in its observation space")
        return {**results, "info": _present(results["info"])}

    def check_step_after_end(self, actions: Any) -> None:
        _check_raises(ResetNeeded, "after the end of an episode", self.env.step, actions)

    def look(self) -> Results:
        goals, states = (attribute(self.env, name)() for name in ("goal_reached", "states"))
        return {"mask": action_masks(self.env), "goal": goals, "state": states}


class _Reference(_Vector):
    """Gymnasium's own vector environment of single ones."""

    env: SyncVectorEnv

    def check_step_after_end(self, actions: Any) -> None:
        """Checks nothing: Gymnasium asserts it."""

    def look(self) -> Results:
        masks, goals = (self.env.call(name) for name in ("action_masks", "goal_reached"))
        return {"mask": np.array(masks), "goal": np.array(goals), "state": self.env.get_attr("state")}


class _SB3(_Env):
    """A VecEnv of Stable-Baselines3."""

    def reset(self, seed: int | None) -> Results:
        if seed is not None:
            self.env.seed(seed)
        return {"observation": self.env.reset(), **self.starts()}

    def starts(self) -> Results:
        return {"start": copy.copy(self.env.unwrapped.reset_infos)}

    def step(self, actions: list[Any]) -> Results:
        observations, rewards, ends, infos = self.env.step(np.array(actions))
        for env_id in range(len(infos)):
            seen = row_of(observations, env_id)
            _require(seen in self.env.observation_space, "an observation is not in the observation space")
        own = [{**RUNNING, **{key: info[key] for key in info if key not in ADDED}} for info in infos]
        return {"observation": observations, "reward": np.float32(rewards), "end": ends, "info": own, **self.starts()}

    def look(self) -> Results:
        ask = self.env.env_method
        return {"mask": ask("action_masks"), "goal": ask("goal_reached"), "state": self.env.get_attr("state")}


class _SB3Seats(_SB3):
    """A VecEnv of one seat of the game, which reports no infos of resets."""

    def starts(self) -> Results:
        return {}

    def look(self) -> Results:
        return {"mask": self.env.env_method("action_masks")}


class _ParallelGames:
    """Parallel environments of PettingZoo."""

    def __init__(self, games: list[Any]) -> None:
        self.games = games
        first = games[0]
        self.action_space = {agent: first.action_space(agent) for agent in first.possible_agents}
        self.observation_space = {agent: first.observation_space(agent) for agent in first.possible_agents}

    def reset(self, seed: int | None) -> Results:
        seeds = [None if seed is None else seed + index for index in range(len(self.games))]
        return self.see([game.reset(seed=own)[0] for game, own in zip(self.games, seeds, strict=True)])

    def see(self, observations: list[Any]) -> Results:
        self.seen = observations
        for agent, space in self.observation_space.items():
            for own in observations:
                _require(own[agent] in space, f"an observation of {agent} is not in its space")
        return {"observation": [*observations]}

    def step(self, actions: list[Any]) -> Results:
        ends: list[Results] = []
        infos: list[Any] = []
        for index, (game, action) in enumerate(zip(self.games, actions, strict=True)):
            self.seen[index], rewards, terminated, truncated, info = game.step(action)
            flags = any(terminated.values()), any(truncated.values())
            _require(any(flags) != bool(game.agents), f"agents must be empty just after the end, not {game.agents}")
            ends.append(_step_of_game(self.seen[index], rewards, *flags, info))
            infos.append(info)
            if any(flags):
                self.seen[index], _ = game.reset()
        return {"step": ends, "info": infos, **self.see(self.seen)}

    def look(self) -> Results:
        return {"mask": [{agent: own["action_mask"] for agent, own in each.items()} for each in self.seen]}

    def close(self) -> None:
        for game in self.games:
            game.close()


class _Games(_ParallelGames):
    """A batch of games, which reports infos of ends alone."""

    def __init__(self, games: BatchedGames) -> None:
        self.batch = games
        self.close = games.close
        self.action_space = games.single_action_spaces
        self.observation_space = games.single_observation_spaces

    def reset(self, seed: int | None) -> Results:
        return self.see(self._rows(self.batch.reset(seed=seed)[0]))

    def _rows(self, batch: Any) -> list[Any]:
        return [row_of(batch, index) for index in range(self.batch.num_games)]

    def step(self, actions: list[Any]) -> Results:
        joint = {agent: np.array([action[agent] for action in actions]) for agent in self.action_space}
        observations, rewards, terminated, truncated, infos = self.batch.step(joint)
        rows = self._rows(observations)
        last, last_infos = (infos.get(name, rows) for name in ("final_observation", "final_info"))
        ends = terminated | truncated
        columns = (np.where(ends, last, rows), self._rows(rewards), terminated, truncated, last_infos)
        return {"step": [_step_of_game(*row) for row in zip(*columns, strict=True)], **self.see(rows)}


def _step_of_game(observation: Any, rewards: Any, terminated: Any, truncated: Any, info: Any) -> Results:
    ends = {"info": info} if terminated or truncated else {}
    return {"observation": observation, "reward": rewards, "terminated": terminated, "truncated": truncated, **ends}


def _present(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Infos of a batch without the values of environments for which the mask, `_key`, is false."""

    def present(key: str, value: Any) -> Any:
        return _present(value) if isinstance(value, Mapping) else value[infos[f"_{key}"]]

    return {key: value if key.startswith("_") else present(key, value) for key, value in infos.items()}


def _check_same_history(ours: list[Results], theirs: list[Results], where: str) -> None:
    for number, (one, other) in enumerate(zip(ours, theirs, strict=True)):
        for name in one.keys() & other.keys():
            assert_same(one[name], other[name], f"{name} of step {number}, {where}")


def assert_same(value: Any, expected: Any, what: str = "the value") -> None:
    """Raises AssertionError unless both are equal in structure, dtype and every value."""
    if isinstance(expected, Mapping):
        _require(isinstance(value, Mapping), f"{what} is a {type(value).__name__}, not a mapping")
        _require(value.keys() == expected.keys(), f"{what} has the entries {[*value]}, not {[*expected]}")
        for key in expected:
            assert_same(value[key], expected[key], f"{key!r} in {what}")
    elif isinstance(expected, list | tuple) or (isinstance(expected, np.ndarray) and expected.dtype.kind == "O"):
        _require(len(value) == len(expected), f"{what} has {len(value)} parts, not {len(expected)}")
        for index, (part, expected_part) in enumerate(zip(value, expected, strict=True)):
            assert_same(part, expected_part, f"part {index} of {what}")
    else:
        one = np.asarray(value)
        other = np.asarray(expected)
        if one.dtype != other.dtype or not np.array_equal(one, other):  # texts of arrays are slow
            raise AssertionError(f"{what} is {value!r} ({one.dtype}), not {expected!r} ({other.dtype})")


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
