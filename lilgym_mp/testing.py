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
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils import env_checker
from gymnasium.vector import AutoresetMode, VectorEnv
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
SB3_INFOS = {"terminal_observation", "TimeLimit.truncated", "episode", "agent"}  # entries that VecEnvs add
OUTCOMES = ("success", "wrong_stop", "invalid_action", "horizon")

SingleEnv = gym.Env[Any, Any]


class Event(NamedTuple):
    """The results of one environment's reset (`action` is None) or step. In the game, values by agent."""

    observation: Any
    info: Any  # None where a batch does not report it
    reward: Any = 0.0
    terminated: Any = False
    truncated: Any = False
    action: Any = None
    mask: Any = None  # before the action
    goal: Any = None  # whether STOP would succeed, before the action
    state: Any = None  # before the action

    @property
    def ends(self) -> bool:
        """Whether the step ends the episode, for whichever reason."""
        return bool(self.terminated or self.truncated)


def check_env(make: Callable[[], SingleEnv], *, exact_masks: bool = True, steps: int = 200) -> None:
    """Checks single environments: Gymnasium's own check, spaces, types, masks, infos, seeds, resets and `close`.

    `exact_masks`: whether every action outside the mask is invalid; False for wrappers that mask valid ones.
    """
    for event in _check_player(lambda: _Singles([make()]), steps, exact_masks=exact_masks):
        types = tuple(map(type, (event.reward, event.terminated, event.truncated, event.info)))
        _require(types == (float, bool, bool, dict), f"reward, flags and info must be float, bool, bool, dict: {types}")
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
    """Checks vector environments, `make(num_envs=, autoreset_mode=)`, against single ones and as `check_env` does.

    This package's batches run compiled code from eight environments on.
    """
    for mode in modes:

        def player(mode: AutoresetMode = mode) -> _Vector:
            return _Vector(make(num_envs=num_envs, autoreset_mode=mode))

        _check_same_play(player, lambda: _Singles([make_single() for _ in range(num_envs)]), steps)
    make_first = partial(make, num_envs=num_envs, autoreset_mode=modes[0])
    list(_check_player(lambda: _Vector(make_first()), steps, exact_masks=exact_masks))
    env = make_first()
    actions = env.action_space.sample()
    _check_raises(ResetNeeded, "before the first reset", env.step, actions)
    env.reset(seed=0)
    _check_closed(env, actions)


def check_sb3_env(make: Callable[[], Any], make_single: Callable[[], SingleEnv], *, steps: int = 40) -> None:
    """Checks Stable-Baselines3's VecEnvs against single environments, and as `check_env` does."""

    def single() -> _Singles:
        return _Singles([make_single() for _ in range(make().num_envs)], _as_in_sb3)

    _check_same_play(lambda: _SB3(make()), single, steps)
    list(_check_player(lambda: _SB3(make()), steps, exact_masks=False))


def check_sb3_games(make: Callable[[], Any], make_single: Callable[[], SingleEnv], *, steps: int = 40) -> None:
    """Checks Stable-Baselines3's VecEnvs of one seat of the game against `SingleAgentView`s."""
    count = make().num_envs
    _check_same_play(lambda: _SB3Seats(make()), lambda: _Seats([make_single() for _ in range(count)]), steps)


def _as_in_sb3(event: Event) -> Event:
    return event._replace(reward=np.float32(event.reward), truncated=event.truncated and not event.terminated)


def check_game(make: Callable[[], Any], *, steps: int = 200) -> None:
    """Checks PettingZoo's parallel form of the game: spaces, masks and seeds."""
    list(_check_player(lambda: _ParallelGames([make()]), steps))


def check_batched_games(
    make: Callable[[int], BatchedGames], make_single: Callable[[], Any], *, num_games: int = 9, steps: int = 40
) -> None:
    """Checks batches of games, `make(num_games)`, against single parallel ones, and as `check_game` does."""
    _check_same_play(
        lambda: _Games(make(num_games)), lambda: _ParallelGames([make_single() for _ in range(num_games)]), steps
    )
    list(_check_player(lambda: _Games(make(num_games)), steps))
    games = make(1)
    actions = {agent: np.zeros(1, np.int64) for agent in games.possible_agents}
    _check_raises(ResetNeeded, "before the first reset", games.step, actions)
    games.reset(seed=0)
    _check_closed(games, actions)


def _check_same_play(make: Callable[[], _Player], make_reference: Callable[[], _Player], steps: int) -> None:
    """Both play the same, with a seed and when a reset without one continues the generators."""
    with closing(make()) as ours, closing(make_reference()) as theirs:
        _check_same_histories(_play(ours, 5, steps), _play(theirs, 5, steps), "in a single environment")
        for player in (ours, theirs):
            player.reset(7)
        _check_same_histories(_play(ours, None, steps), _play(theirs, None, steps), "in a single environment")


def _check_player(make: Callable[[], _Player], steps: int, *, exact_masks: bool = True) -> Iterator[Event]:
    """Checks seeds and every event; gives the events."""
    with closing(make()) as player, closing(make()) as other:
        state = np.random.get_state(legacy=False)  # noqa: NPY002
        histories = _play(player, 0, steps)
        _check_same_histories(_play(other, 0, steps), histories, "in another environment with the same seed")
        _check_same_histories(_play(player, 0, steps), histories, "before a reset with the same seed")
        assert_same(np.random.get_state(legacy=False), state, "NumPy's global generator")  # noqa: NPY002
        for event in (event for history in histories for event in history):
            player.check(event, exact_masks=exact_masks)
            yield event


def _play(player: _Player, seed: int | None, steps: int) -> list[list[Event]]:
    """The events of each environment in `steps` steps. Checks that later steps do not change observations."""
    histories = [[event] for event in player.reset(seed)]
    generators = [np.random.default_rng(env_id) for env_id in range(player.count)]
    copies = [[copy.deepcopy(event.observation)] for (event,) in histories]
    for _ in range(steps):
        masks = [copy.copy(mask) for mask in player.masks()]
        goals = player.goals()
        states = player.states()
        waiting = [history[-1].ends for history in histories]  # NEXT_STEP: for a reset, which ignores the action
        actions = [
            history[-1].action if waits else _choose(player.action_space, mask, generator)
            for history, waits, mask, generator in zip(histories, waiting, masks, generators, strict=True)
        ]
        for env_id, events in enumerate(player.step(actions, waiting)):
            if not waiting[env_id]:
                events[0] = events[0]._replace(
                    action=actions[env_id], mask=masks[env_id], goal=goals[env_id], state=states[env_id]
                )
            histories[env_id] += events
            copies[env_id] += [copy.deepcopy(event.observation) for event in events]
    for history, observations in zip(histories, copies, strict=True):
        assert_same([event.observation for event in history], observations, "an earlier observation, after more steps")
    return histories


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


class _Player:
    """Environments that are stepped together and reset when their episodes end. This base is for the MDP.

    `step` gives for each environment the step's event, and the reset's; in NEXT_STEP the reset's alone where it waits.
    """

    count: int
    action_space: Any  # of one environment; in the game, by agent
    observation_space: Any

    env: Any  # the batch, if they are one

    def reset(self, seed: int | None) -> list[Event]: ...
    def step(self, actions: list[Any], waiting: list[bool]) -> list[list[Event]]: ...
    def masks(self) -> Sequence[Any]: ...

    def goals(self) -> Sequence[Any]:
        return [None] * self.count

    states = goals

    def close(self) -> None:
        self.env.close()

    def check(self, event: Event, *, exact_masks: bool) -> None:
        """Checks what an event says of itself."""
        info, action = event.info, event.action
        _require(event.observation in self.observation_space, "an observation is not in the observation space")
        if action is None:
            _require("task" in info, f"infos of a reset name no task: {info}")
        elif not event.ends:
            _require("outcome" not in info, f"infos before the end of an episode have an outcome: {info}")
        else:
            outcome = info.get("outcome")
            _require(outcome in OUTCOMES, f"the outcome must be one of {', '.join(OUTCOMES)}, not {outcome!r}")
            _require(info["is_success"] == (outcome == "success"), f"is_success contradicts the outcome: {info}")
            _require(("invalid_reason" in info) == (outcome == "invalid_action"), f"invalid_reason is wrong: {info}")
        if isinstance(action, int):
            is_valid, is_allowed = info.get("outcome") != "invalid_action", bool(event.mask[action])
            _require(is_valid >= is_allowed, f"the mask allows action {action}, which is invalid")
            _require(not exact_masks or is_valid == is_allowed, f"the mask forbids action {action}, which is valid")
            _require(action or info["is_success"] == event.goal, f"goal_reached was {event.goal}, but STOP gave {info}")


class _Singles(_Player):
    """Gymnasium environments."""

    def __init__(self, envs: list[Any], convert: Callable[[Event], Event] = lambda event: event) -> None:
        self.envs, self.count, self._convert = envs, len(envs), convert
        self.action_space = envs[0].action_space
        self.observation_space = envs[0].observation_space

    def reset(self, seed: int | None) -> list[Event]:
        seeds = [None if seed is None else seed + env_id for env_id in range(self.count)]
        return [Event(*env.reset(seed=one)) for env, one in zip(self.envs, seeds, strict=True)]

    def step(self, actions: list[Any], waiting: list[bool]) -> list[list[Event]]:
        stepped = [self._step(env, action) for env, action in zip(self.envs, actions, strict=True)]
        return [
            [event, Event(*env.reset())] if event.ends else [event]
            for env, event in zip(self.envs, stepped, strict=True)
        ]

    def _step(self, env: Any, action: Any) -> Event:
        observation, reward, terminated, truncated, info = env.step(action)
        return self._convert(Event(observation, info, reward, terminated, truncated))

    def masks(self) -> Sequence[Any]:
        return [action_masks(env) for env in self.envs]

    def goals(self) -> Sequence[Any]:
        return [attribute(env, "goal_reached")() for env in self.envs]

    def states(self) -> Sequence[Any]:
        return [attribute(env, "state") for env in self.envs]

    def close(self) -> None:
        for env in self.envs:
            env.close()


class _Vector(_Player):
    """A vector environment of Gymnasium, in any autoreset mode."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        self.env, self.count, self.mode = env, env.num_envs, env.metadata["autoreset_mode"]
        self.action_space = env.single_action_space
        self.observation_space = env.single_observation_space

    def reset(self, seed: int | None) -> list[Event]:
        return self._starts(*self.env.reset(seed=seed))

    def _starts(self, observations: Any, infos: Any) -> list[Event]:
        _require(observations in self.env.observation_space, "a batch's observation is not in its observation space")
        return [Event(row_of(observations, env_id), _info(infos, env_id)) for env_id in range(self.count)]

    def step(self, actions: list[Any], waiting: list[bool]) -> list[list[Event]]:
        batch = concatenate(self.action_space, actions, create_empty_array(self.action_space, self.count))
        observations, rewards, terminated, truncated, infos = self.env.step(batch)
        ends = terminated | truncated
        events: list[list[Event]] = []
        for env_id, now in enumerate(self._starts(observations, infos)):
            outcome = rewards[env_id], terminated[env_id], truncated[env_id]
            if waiting[env_id]:
                _require(not any(outcome), f"reward and flags of a reset in mode NEXT_STEP must be 0, not {outcome}")
                events.append([now])
            elif ends[env_id] and self.mode is AutoresetMode.SAME_STEP:
                last = Event(infos["final_obs"][env_id], _info(infos["final_info"], env_id), *outcome)
                events.append([last, now])
            else:
                events.append([Event(now.observation, now.info, *outcome)])
        if self.mode is AutoresetMode.DISABLED and ends.any():
            _check_raises(ResetNeeded, "after the end of an episode", self.env.step, batch)
            started = self._starts(*self.env.reset(options={"reset_mask": ends}))
            for env_id in np.flatnonzero(ends).tolist():
                events[env_id].append(started[env_id])
        return events

    def masks(self) -> Sequence[Any]:
        return list(action_masks(self.env))

    def goals(self) -> Sequence[Any]:
        return attribute(self.env, "goal_reached")()

    def states(self) -> Sequence[Any]:
        return attribute(self.env, "states")()


class _SB3(_Player):
    """A VecEnv of Stable-Baselines3."""

    def __init__(self, env: Any) -> None:
        self.env, self.count = env, env.num_envs
        self.action_space = env.action_space
        self.observation_space = env.observation_space

    def reset(self, seed: int | None) -> list[Event]:
        if seed is not None:
            self.env.seed(seed)
        observations = self.env.reset()
        return [self._start(observations, env_id) for env_id in range(self.count)]

    def _start(self, observations: Any, env_id: int) -> Event:
        return Event(row_of(observations, env_id), dict(self.env.unwrapped.reset_infos[env_id]))

    def step(self, actions: list[Any], waiting: list[bool]) -> list[list[Event]]:
        observations, rewards, dones, infos = self.env.step(np.array(actions))
        events: list[list[Event]] = []
        for env_id, info in enumerate(infos):
            own = {key: value for key, value in info.items() if key not in SB3_INFOS}
            reward = np.float32(rewards[env_id])
            if dones[env_id]:
                cut = info["TimeLimit.truncated"]
                last = Event(info["terminal_observation"], own, reward, not cut, cut)
                events.append([last, self._start(observations, env_id)])
            else:
                events.append([Event(row_of(observations, env_id), own, reward)])
        return events

    def masks(self) -> Sequence[Any]:
        return self.env.env_method("action_masks")

    def goals(self) -> Sequence[Any]:
        return self.env.env_method("goal_reached")

    def states(self) -> Sequence[Any]:
        return self.env.get_attr("state")


class _Seats(_Singles):
    """Single-agent views of the game."""

    def __init__(self, envs: list[Any]) -> None:
        super().__init__(envs, _as_in_sb3)

    goals = states = _Player.goals


class _SB3Seats(_SB3):
    """A VecEnv of one seat of the game."""

    def _start(self, observations: Any, env_id: int) -> Event:
        return Event(row_of(observations, env_id), None)

    goals = states = _Player.goals


class _GamePlayer(_Player):
    """Games; actions, masks, rewards and infos are by agent."""

    last: list[Event]  # of each game

    def masks(self) -> Sequence[Any]:
        return [{agent: event.observation[agent]["action_mask"] for agent in self.action_space} for event in self.last]

    def check(self, event: Event, *, exact_masks: bool) -> None:
        proposer, *_ = self.observation_space
        for agent, space in self.observation_space.items():
            _require(event.observation[agent] in space, f"an observation of {agent} is not in its space")
            if event.action is None or event.info is None:
                continue
            action = event.action[agent]
            info = event.info[agent]
            is_edit = agent == proposer and event.mask[agent].sum() > 1  # otherwise it waits
            is_wrong = "illegal_choice" in info or (is_edit and info.get("outcome") == "invalid_action")
            _require(not (event.mask[agent][action] and is_wrong), f"the mask allows {agent} {action}, but: {info}")
            _require(event.ends == ("outcome" in info), f"infos have an outcome if and only if the game ends: {info}")


class _ParallelGames(_GamePlayer, _Singles):
    """Parallel environments of PettingZoo."""

    goals = states = _Player.goals

    def __init__(self, envs: list[Any]) -> None:
        self.envs, self.count, self.agents = envs, len(envs), envs[0].possible_agents
        self.action_space = {agent: envs[0].action_space(agent) for agent in self.agents}
        self.observation_space = {agent: envs[0].observation_space(agent) for agent in self.agents}

    def reset(self, seed: int | None) -> list[Event]:
        self.last = super().reset(seed)
        return self.last

    def step(self, actions: list[Any], waiting: list[bool]) -> list[list[Event]]:
        events = super().step(actions, waiting)
        self.last = [each[-1] for each in events]
        return events

    def _step(self, env: Any, action: Any) -> Event:
        observations, rewards, terminated, truncated, infos = env.step(action)
        event = Event(observations, infos, rewards, any(terminated.values()), any(truncated.values()))
        _require(event.ends != bool(env.agents), f"agents must be empty just after the end, not {env.agents}")
        return event


class _Games(_GamePlayer):
    """A batch of games; of each it reports infos of the end alone."""

    def __init__(self, games: BatchedGames) -> None:
        self.env = games
        self.count = games.num_games
        self.action_space = games.single_action_spaces
        self.observation_space = games.single_observation_spaces

    def reset(self, seed: int | None) -> list[Event]:
        observations, _ = self.env.reset(seed=seed)
        self.last = [Event(row_of(observations, index), None) for index in range(self.count)]
        return self.last

    def step(self, actions: list[Any], waiting: list[bool]) -> list[list[Event]]:
        batch = {agent: np.array([action[agent] for action in actions]) for agent in self.action_space}
        observations, rewards, terminated, truncated, infos = self.env.step(batch)
        events: list[list[Event]] = []
        for index in range(self.count):
            now = Event(row_of(observations, index), None)
            outcome = row_of(rewards, index), terminated[index], truncated[index]
            if terminated[index] or truncated[index]:
                last = Event(infos["final_observation"][index], infos["final_info"][index], *outcome)
                events.append([last, now])
            else:
                events.append([Event(now.observation, None, *outcome)])
        self.last = [each[-1] for each in events]
        return events


def _info(infos: Mapping[str, Any], env_id: int) -> dict[str, Any]:
    """One environment's infos: the entries whose mask, `_key`, is true for it."""
    keys = [key for key in infos if not key.startswith("_") and not key.startswith("final_")]
    return {key: infos[key][env_id] for key in keys if infos[f"_{key}"][env_id]}


def _check_same_histories(ours: list[list[Event]], theirs: list[list[Event]], where: str) -> None:
    for env_id, (one, other) in enumerate(zip(ours, theirs, strict=True)):
        for number, (event, expected) in enumerate(zip(one, other, strict=False)):  # NEXT_STEP spends steps on resets
            for name, value in event._asdict().items():
                if name != "info" or not (value is None or expected.info is None):
                    what = f"{name} of event {number} of environment {env_id}"
                    assert_same(value, getattr(expected, name), f"{what}, compared with the one {where}")


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
