"""One game in play, and the base of both PettingZoo environments around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any, NamedTuple, SupportsIndex, cast

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.spaces.utils import flatten
from gymnasium.utils import seeding

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.checks import check_open, checked_options, checked_seed
from lilgym_mp.envs.interface import RENDER_FPS, RENDER_MODES, make_renderer
from lilgym_mp.envs.observation import flat_space, image_space
from lilgym_mp.envs.proposer_verifier.game import Game, TurnError
from lilgym_mp.envs.proposer_verifier.game_arrays import GameState, Info
from lilgym_mp.envs.proposer_verifier.observations import MASK, PARTS, AgentObservation, ObservedGames, Part
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, PROPOSER, VERIFIER, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, Int8Array, Rng, UInt8Array
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import draw

ROLES = {AGENTS[role]: role for role in Role}
INTENTS = {intent.name.lower(): intent for intent in Intent}
# Forms of observations; with vectors, the masks are in infos
NESTED = "nested"
VECTOR = "vector"
RESET_OPTIONS = ("task", "intent")
Layer = Callable[[Role, AgentObservation], AgentObservation]  # a wrapper of every environment around an engine


def role_of(agent: object) -> Role:
    """The agent's role. Raises ValueError naming the agents."""
    return choose("agent", agent, ROLES)


def agent_spaces(parts: Mapping[str, Part], action_count: int) -> tuple[spaces.Dict, spaces.Discrete]:
    """An agent's observation and action spaces, newly made."""
    observation = spaces.Dict({key: part.space for key, part in parts.items()})
    mask = spaces.Box(0, 1, (action_count,), np.int8)
    return spaces.Dict({PARTS: observation, MASK: mask}), spaces.Discrete(action_count)


def reset_options(options: object) -> tuple[object, Intent | None]:
    """The task and the intent of reset options, None for those that are drawn.

    Options of other names are for other layers of an environment, and have no effect. Raises ValueError naming the
    choices, also for a name that is close to one of them.
    """
    if isinstance(options, Mapping):
        options = {name: value for name, value in options.items() if get_close_matches(str(name), RESET_OPTIONS)}
    checked = checked_options(options, RESET_OPTIONS)
    intent = checked.get("intent")
    return checked.get("task"), None if intent is None else choose("intent", intent, INTENTS)


class TurnResult(NamedTuple):
    """The result of one turn. Pairs are indexed by role."""

    rewards: tuple[float, float]
    terminated: bool
    truncated: bool
    infos: tuple[Info, Info]


class GameEngine:
    """One game: a batch of one, with a random generator, rendering and wrappers."""

    def __init__(self, game: Game, render_mode: str | None = None) -> None:
        self.game = game
        self.games = ObservedGames(game, 1)
        self._rng: Rng | None = None  # made when it is first needed
        self._is_seeded = False
        self._renderer = make_renderer(render_mode)
        self.render_mode = render_mode
        self._actions = np.zeros((len(Role), 1), np.int64)  # indexed by role, of the last turn
        self.layers: list[Layer] = []  # the observations' wrappers, innermost first
        self._is_started = self._is_closed = False
        self._last_actions = ""  # as text, for the caption

    def __getstate__(self) -> AnyDict:
        """Copies of a game that was never seeded draw tasks on their own."""
        return vars(self) | ({} if self._is_seeded else {"_rng": None})

    @property
    def rng(self) -> Rng:
        """The generator of the game's random numbers; made from entropy unless `reset` got a seed."""
        if self._rng is None:
            self._rng, _ = seeding.np_random()
        return self._rng

    @property
    def state(self) -> GameState:
        """The state of the game. Raises ResetNeeded before the first reset, ClosedEnvironmentError after `close`."""
        self._check_started()
        return self.games.state(0)

    def check_open(self) -> None:
        """Raises ClosedEnvironmentError after `close`."""
        check_open(closed=self._is_closed)

    def _check_started(self) -> None:
        check_open(closed=self._is_closed)
        if not self._is_started:
            raise ResetNeeded("call reset first")

    @property
    def movers(self) -> tuple[Role, ...]:
        """The agents to act; empty before the first reset and after the end."""
        return self.games.movers_of(0)

    def reset(self, seed: int | None, options: AnyMapping | None) -> tuple[Info, Info]:
        """Starts a game; returns both agents' infos, empty unless the settings reveal the truth, as TorchRL requires.

        Options: "task", an id or a `Task`; "intent", "helpful" or "deceptive".
        Raises ValueError for bad options, ClosedEnvironmentError after `close`.
        """
        self.check_open()
        seed = checked_seed(seed)
        game = self.game
        choice, intent = reset_options(options)
        if self.games.game is not game:  # with other tasks
            self.games = ObservedGames(game, 1)
        chosen = None if choice is None else self.games.index_of(choice)
        if seed is not None:
            self._rng, _ = seeding.np_random(seed)
            self._is_seeded = True
        task = game.sample_task_index(self.rng) if chosen is None else chosen
        intent = game.sample_intent(self.rng) if intent is None else intent
        self.games.start(np.zeros(1, np.int64), np.array([task]), np.array([int(intent)]))
        self._is_started = True
        self._last_actions = ""
        if self.render_mode == "human":
            self.render()
        info = self.games.truth_info(0)
        if info:
            info = {"task": self.state.mdp.task.id, **info}
        return info, info.copy()

    def step(self, proposer: SupportsIndex | None, verifier: SupportsIndex | None) -> TurnResult:
        """Plays one turn; the action of an agent out of turn is ignored, and illegal unless it is "wait" or None.

        Raises ResetNeeded before reset and after the end, TurnError for None from an agent that is to move, ActionError
        for an action outside the action space.
        """
        games = self.games
        movers = self.movers
        if not movers or self._is_closed:
            self._check_started()
            raise ResetNeeded("the game is over; call reset before acting")
        actions = self._actions
        for role, action in ((PROPOSER, proposer), (VERIFIER, verifier)):
            actions[role, 0] = self._wait(role) if action is None else self.game.checked_action(role, action)
        if self.render_mode is not None:
            self._last_actions = self._describe_actions(movers)
        games.step(actions[PROPOSER], actions[VERIFIER])
        proposer_reward, verifier_reward = games.rewards[:, 0].tolist()
        if self.render_mode == "human":
            self.render()
        return TurnResult(
            (proposer_reward, verifier_reward), bool(games.terminated[0]), bool(games.truncated[0]), games.infos(0)
        )

    def _wait(self, role: Role) -> int:
        """The action "wait". Raises TurnError for an agent that is to move."""
        wait = self.game.wait_actions[role]
        if wait is None or role in self.movers:
            raise TurnError(f"it is the turn of {AGENTS[role]}: it must act")
        return wait

    def _describe_actions(self, movers: tuple[Role, ...]) -> str:
        """The actions to be played, or the pending proposal and the answer."""
        chosen = {role: int(self._actions[role, 0]) for role in movers}
        proposal = self.games.state(0).proposal
        if proposal is not None:
            chosen = {PROPOSER: self.game.encode_action(PROPOSER, proposal), **chosen}
        return ";  ".join(f"{role.name.lower()}: {self.game.describe(role, action)}" for role, action in chosen.items())

    def observe(self, role: Role) -> AgentObservation:
        """One agent's observation, new arrays. Raises as `state`."""
        self._check_started()
        observation = self.games.observe(role, 0)
        for layer in self.layers:
            observation = layer(role, observation)
        return observation

    def mask(self, role: Role) -> Int8Array:
        """(actions,) one agent's legal actions, a new array."""
        return self.observe(role)[MASK] if self.layers else self.games.masks(role, 0)

    def observe_both(self) -> dict[str, AgentObservation]:
        """Both agents' observations, which share the arrays of parts that both see."""
        if self.layers:
            return {agent: self.observe(role) for agent, role in ROLES.items()}
        return self.games.observe_both(0)

    def render(self) -> UInt8Array | str | None:
        """By render mode: an image (304, 784, 3) with a caption, text, or None after updating the window."""
        mdp = self.state.mdp
        outcome = self.games.last_outcome(0)
        horizon = self.game.dynamics.horizon
        lines = [
            mdp.task.statement,
            f"Make it {str(mdp.task.target).lower()}.  Round {mdp.steps} of {horizon}.  {self._last_actions}",
        ]
        if outcome is not None:
            proposer_reward, verifier_reward = self.games.rewards[:, 0].tolist()
            said = outcome.replace("_", " ").replace("stop", "STOP")
            lines.append(f"{said}, rewards {proposer_reward:+.1f} and {verifier_reward:+.1f}")
        return None if self._renderer is None else self._renderer.render(mdp.scene, lines)

    def close(self) -> None:
        """Afterwards all methods raise ClosedEnvironmentError."""
        self._is_closed = True
        if self._renderer is not None:
            self._renderer.close()


class BaseGameEnv:
    """Spaces, the current task, names of actions, and the image as PettingZoo's global state."""

    metadata: AnyDict = {
        "name": "proposer_verifier_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": RENDER_FPS,
        "is_parallelizable": False,  # turns need not alternate; `parallel_env` is the parallel environment
    }

    def __init__(
        self,
        configuration: str | None = None,
        *,
        render_mode: str | None = None,
        observations: str = NESTED,
        **settings: Any,
    ) -> None:
        """Makes the game; `reset` starts it. Arguments as for `env`.

        Raises:
            ValueError: For invalid settings; the message names the choices.
        """
        self._is_vector = choose("observations", observations, {NESTED: False, VECTOR: True})
        self.masks_in_infos = self._is_vector
        game = Game(GameSettings.of({"configuration": configuration, **settings}))
        self.engine = engine = GameEngine(game, render_mode)
        self.possible_agents = list(AGENTS)
        self.agents: list[str] = []
        self.render_mode = engine.render_mode
        self.observation_spaces: dict[str, spaces.Space[Any]] = {}
        self.action_spaces: dict[str, spaces.Discrete] = {}
        self._parts_spaces: dict[str, spaces.Dict] = {}
        for role, agent in zip(Role, AGENTS, strict=True):
            space, self.action_spaces[agent] = agent_spaces(engine.games.parts[role], engine.game.action_counts[role])
            self._parts_spaces[agent] = parts = cast("spaces.Dict", space[PARTS])
            if self._is_vector:
                space = flat_space(parts)
            self.observation_spaces[agent] = space
        self.state_space = image_space(engine.game.settings.image_size)

    def _with_masks(self, infos: tuple[Info, Info]) -> dict[str, Info]:
        """Both agents' infos, with the masks if these are not in the observations, or requested by a wrapper."""
        by_agent = {AGENTS[PROPOSER]: infos[PROPOSER], AGENTS[VERIFIER]: infos[VERIFIER]}
        if not self.masks_in_infos:
            return by_agent
        return {agent: {**info, MASK: self.engine.mask(ROLES[agent])} for agent, info in by_agent.items()}

    def _shown(self, agent: str, nested: AgentObservation) -> Any:
        """An agent's observation in the environment's form."""
        if not self._is_vector:
            return nested
        return np.asarray(flatten(self._parts_spaces[agent], nested[PARTS]), np.float32)

    def observation_space(self, agent: str) -> Any:
        """{"observation": the agent's parts, "action_mask": int8 (actions,)}, or of the parts as a vector."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete:
        """The indices of an agent's actions."""
        return self.action_spaces[agent]

    def state(self) -> UInt8Array:
        """The image, a new array: (50, 190, 3), or (100, 380, 3) at native size."""
        return draw(self.scene, self.engine.game.settings.image_size)

    def render(self) -> UInt8Array | str | None:
        """By render mode: an image (304, 784, 3) with a caption, text, or None after updating the window."""
        return self.engine.render()

    def close(self) -> None:
        """Afterwards all methods raise ClosedEnvironmentError."""
        self.engine.close()

    @property
    def tasks(self) -> TaskSet:
        """The tasks that games are drawn from."""
        return self.engine.game.tasks

    def change_tasks(self, change: Callable[[TaskSet], TaskSet]) -> None:
        """Replaces the tasks by `change(tasks)` from the next reset on; it must keep their statements."""
        self.engine.check_open()
        self.engine.game = self.engine.game.with_tasks(change(self.tasks), keep_spaces=True)

    @property
    def dynamics(self) -> Dynamics:
        """The dynamics of the MDP."""
        return self.engine.game.dynamics

    @property
    def task(self) -> Task:
        """The task of the game in progress."""
        return self.engine.state.mdp.task

    @property
    def scene(self) -> Scene:
        """The current scene."""
        return self.engine.state.mdp.scene

    def describe_action(self, agent: str, action: SupportsIndex) -> str:
        """The action's name, such as "ADD(LEFT, BLUE)", "accept" or "reject, message 2"."""
        return self.engine.game.describe(role_of(agent), action)

    def read_action(self, agent: str, name: str) -> int:
        """The inverse of `describe_action`, ignoring case and white space. Raises ActionError."""
        game = self.engine.game
        role = role_of(agent)
        names = [game.describe(role, action) for action in range(game.action_counts[role])]
        known = list(map(_normalised, names))
        if _normalised(name) not in known:
            raise ActionError(f"{name!r} is not an action of {agent}; actions look like {names[0]!r}, {names[-1]!r}")
        return known.index(_normalised(name))


def _normalised(name: str) -> str:
    return "".join(name.split()).upper()
