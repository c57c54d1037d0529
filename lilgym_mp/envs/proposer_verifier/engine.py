"""The current game and its observations: GameEngine, and the base of both PettingZoo environments around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, SupportsIndex, cast

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.spaces.utils import flatten, flatten_space
from gymnasium.utils import seeding

from lilgym_mp.actions import ActionError
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.proposer_verifier.game import GameState, GameStep
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, PROPOSER, VERIFIER, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent, Judgement
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.envs.proposer_verifier.views import GameSetup, Part, Value, make_parts, with_tasks
from lilgym_mp.envs.rendering import RENDER_FPS, RENDER_MODES, Renderer
from lilgym_mp.envs.single import end_info
from lilgym_mp.observation import image_space
from lilgym_mp.render import draw
from lilgym_mp.rules import Dynamics, State
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

ROLES: Mapping[str, Role] = {AGENTS[role]: role for role in Role}
INTENTS: Mapping[str, Intent] = {intent.name.lower(): intent for intent in Intent}

NESTED = "nested"
PARTS, MASK, IMAGE = "observation", "action_mask", "image"  # keys of nested observations
AgentObservation = dict[str, Any]  # {"observation": {key: array}, "action_mask": int8 (actions,)}
Info = dict[str, Any]


def role_of(agent: object) -> Role:
    """The agent's role. Raises ValueError naming the agents."""
    return choose("agent", agent, ROLES)


def agent_spaces(parts: Mapping[str, Part], action_count: int) -> tuple[spaces.Dict, spaces.Discrete]:
    """An agent's observation and action spaces, newly made."""
    observation = spaces.Dict({key: part.space for key, part in parts.items()})
    mask = spaces.Box(0, 1, (action_count,), np.int8)
    return spaces.Dict({PARTS: observation, MASK: mask}), spaces.Discrete(action_count)


def intent_option(options: Mapping[str, Any]) -> Intent | None:
    """The "intent" of reset options. Raises ValueError naming the choices."""
    return choose("intent", options["intent"], INTENTS) if "intent" in options else None


def truth_info(setup: GameSetup, mdp: State, intent: Intent, judgement: Judgement | None = None) -> Info:
    """Info entries of the setting `reveal_truth`."""
    info: Info = {
        "truth": mdp.task.truth(mdp.scene),
        "goal_reached": setup.game.config.dynamics.goal_reached(mdp),
        "intent": intent.name.lower(),
    }
    if judgement is not None:
        info["judgement"] = {"probability": judgement.probability, "holds": judgement.holds}
    return info


def agent_infos(shared: Info, illegal: tuple[bool, bool]) -> tuple[Info, Info]:
    """Both agents' infos, by Role: the shared entries and "illegal_choice"."""
    proposer, verifier = ({**shared, "illegal_choice": True} if wrong else shared.copy() for wrong in illegal)
    return proposer, verifier


class GameEngine:
    """The state of the current game, a random generator, observation encoders and rendering."""

    def __init__(self, setup: GameSetup, render_mode: str | None = None) -> None:
        self.setup = setup
        self.game = setup.game
        self._renderer = Renderer(render_mode)
        self.render_mode = self._renderer.mode
        self.rng, _ = seeding.np_random()
        self.parts = make_parts(setup)
        proposer, verifier = self.parts
        shared = {key: part.encode for key, part in proposer.items() if verifier.get(key) is part}
        self._shared_encoders = list(shared.items())
        self._own_encoders = tuple(
            [(key, part.encode) for key, part in parts.items() if key not in shared] for parts in self.parts
        )
        self._shared_values: dict[str, Value] = {}  # cache of the shared parts, encoded from `_encoded_state`
        self._encoded_state: GameState | None = None
        self.last_step: GameStep | None = None
        self._state: GameState | None = None
        self._last_actions = ""  # as text, for the caption

    @property
    def state(self) -> GameState:
        """The state of the game. Raises ResetNeeded before the first reset."""
        if self._state is None:
            raise ResetNeeded("call reset first")
        return self._state

    def reset(self, seed: int | None, options: Mapping[str, Any] | None) -> tuple[Info, Info]:
        """Starts a game; returns both agents' infos, empty unless the settings reveal the truth, as TorchRL requires.

        Options: "task", an id; "intent", "helpful" or "sneaky". Others are ignored, as PettingZoo's API test demands.
        """
        if seed is not None:
            self.rng, _ = seeding.np_random(seed)
        setup, options = self.setup, options or {}
        tasks = setup.tasks
        index = tasks.index_of(options["task"]) if "task" in options else setup.sample_task_index(self.rng)
        intent = intent_option(options)
        state = self._state = self.game.start(tasks[index], setup.sample_intent(self.rng) if intent is None else intent)
        self.last_step = None
        self._last_actions = ""
        if self.render_mode == "human":
            self.render()
        if not setup.reveals_truth:
            return {}, {}
        info = {"task": tasks[index].id, **truth_info(setup, state.mdp, state.intent)}
        return info, info.copy()

    def step(self, proposer: SupportsIndex | None, verifier: SupportsIndex | None) -> GameStep:
        """Plays one turn. Raises ResetNeeded before reset and after the end; otherwise as `Game.step`."""
        state = self._state
        if state is None or not state.movers:
            raise ResetNeeded("call reset first" if state is None else "the game is over; call reset before acting")
        step = self.last_step = self.game.step(state, proposer, verifier)
        self._state = step.state
        if self.render_mode is not None:
            answered = None if state.proposal is None else self.game.encode_action(PROPOSER, state.proposal)
            described = [
                f"{AGENTS[role]}: {self.game.describe(role, action)}"
                for role, action in ((PROPOSER, proposer if answered is None else answered), (VERIFIER, verifier))
                if action is not None
            ]
            self._last_actions = ";  ".join(described)
        if self.render_mode == "human":
            self.render()
        return step

    def step_both(self, proposer: SupportsIndex, verifier: SupportsIndex) -> tuple[GameStep, tuple[Info, Info]]:
        """Plays one turn with an action from each agent; returns the step and both infos.

        In turn-based protocols the action of the agent out of turn is ignored, and illegal unless it is "wait".
        """
        game = self.game
        if not game.turn_based:
            step = self.step(proposer, verifier)
            return step, self.infos(step)
        if VERIFIER in self.state.movers:
            idle, waited = PROPOSER, game.is_wait(PROPOSER, proposer)
            step = self.step(None, verifier)
        else:
            idle, waited = VERIFIER, game.is_wait(VERIFIER, verifier)
            step = self.step(proposer, None)
        infos = self.infos(step)
        if not waited:
            infos[idle]["illegal_choice"] = True
        return step, infos

    def infos(self, step: GameStep) -> tuple[Info, Info]:
        """Both agents' infos after a turn: outcome at the end, illegal choices, the truth if settings reveal it."""
        state, _, terminated, truncated, transition, illegal, _, _ = step
        is_over, reveals_truth = terminated or truncated, self.setup.reveals_truth
        if not (is_over or reveals_truth or illegal[0] or illegal[1]):
            return {}, {}
        shared: Info = {}
        if reveals_truth:
            shared = truth_info(self.setup, state.mdp, state.intent, step.judgement)
        if transition is not None and is_over:
            shared |= end_info(transition.outcome, transition.invalid)
        return agent_infos(shared, illegal)

    def observe_both(self) -> tuple[AgentObservation, AgentObservation]:
        """Both agents' observations, by Role; they share the arrays of parts that both see."""
        state, game = self.state, self.game
        proposer: dict[str, Value] = {}
        for key, encode in self._shared_encoders:
            proposer[key] = encode(state)
        verifier = proposer.copy()
        proposer_encoders, verifier_encoders = self._own_encoders
        for key, encode in proposer_encoders:
            proposer[key] = encode(state)
        for key, encode in verifier_encoders:
            verifier[key] = encode(state)
        return (
            {PARTS: proposer, MASK: game.legal_mask(state, PROPOSER)},
            {PARTS: verifier, MASK: game.legal_mask(state, VERIFIER)},
        )

    def observe(self, role: Role) -> AgentObservation:
        """One agent's observation. Until the state changes, both agents' share the arrays of parts that both see."""
        state = self.state
        if state is not self._encoded_state:
            self._shared_values = {key: encode(state) for key, encode in self._shared_encoders}
            self._encoded_state = state
        parts = self._shared_values.copy()
        for key, encode in self._own_encoders[role]:
            parts[key] = encode(state)
        return {PARTS: parts, MASK: self.game.legal_mask(state, role)}

    def render(self) -> UInt8Array | str | None:
        """By render mode: an image (304, 784, 3) with a caption, text, or None after updating the window."""
        return self._renderer.render(self.state.mdp.scene, self._caption())

    def _caption(self) -> list[str]:
        mdp, last = self.state.mdp, self.last_step
        horizon = self.game.config.dynamics.horizon
        lines = [
            mdp.task.statement,
            f"Make it {mdp.task.target}.  Round {mdp.steps} of {horizon}.  {self._last_actions}",
        ]
        if last is not None and last.transition is not None:
            outcome, rewards = last.transition.outcome, " and ".join(f"{reward:+.1f}" for reward in last.rewards)
            lines.append(f"{outcome}, rewards {rewards}")
        return lines

    def close(self) -> None:
        self._renderer.close()


Convert = Callable[[Mapping[str, Any]], Any]
Form = Callable[[spaces.Dict], tuple[spaces.Space[Any], Convert]]  # from the space of an agent's parts


def _vector(space: spaces.Dict) -> tuple[spaces.Box, Convert]:
    """All parts flattened to one float32 vector, in alphabetical order."""
    flat = flatten_space(space)
    assert isinstance(flat, spaces.Box)
    box = spaces.Box(flat.low.astype(np.float32), flat.high.astype(np.float32), dtype=np.float32)
    return box, lambda parts: np.asarray(flatten(space, dict(parts)), np.float32)


def _image(space: spaces.Dict) -> tuple[spaces.Box, Convert]:
    """Only the image."""
    image = space.spaces.get(IMAGE)
    if not isinstance(image, spaces.Box):
        raise ValueError(f'observations="image" needs views with scene="image"; the parts are {", ".join(space)}')
    return image, lambda parts: parts[IMAGE]


def _parts(space: spaces.Dict) -> tuple[spaces.Dict, Convert]:
    """The parts without the mask: a flat dictionary, as Stable-Baselines3 accepts."""
    return space, dict


# Forms of observations; all but "nested" have the masks in infos.
FORMS: Mapping[str, Form | None] = {NESTED: None, "parts": _parts, "vector": _vector, "image": _image}


class BaseGameEnv:
    """Spaces, the current task, names of actions, and the image as PettingZoo's global state."""

    metadata: dict[str, Any] = {
        "name": "proposer_verifier_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": RENDER_FPS,
        "is_parallelizable": False,  # turns need not alternate; `parallel_env` is the parallel environment
    }

    def __init__(self, settings: GameSettings, render_mode: str | None = None, observations: str = NESTED) -> None:
        """`observations`: a name in FORMS. Raises ValueError naming the choices."""
        form = choose("observations", observations, FORMS)
        self.engine = engine = GameEngine(settings.setup(), render_mode)
        self.possible_agents = list(AGENTS)
        self.agents: list[str] = []
        self.render_mode = engine.render_mode
        self.observation_spaces: dict[str, spaces.Space[Any]] = {}
        self.action_spaces: dict[str, spaces.Discrete] = {}
        self._converters: dict[str, Convert] = {}  # by agent; none for nested observations
        for role, agent in zip(Role, AGENTS, strict=True):
            nested, self.action_spaces[agent] = agent_spaces(engine.parts[role], engine.game.action_counts[role])
            self.observation_spaces[agent] = nested
            if form is not None:
                self.observation_spaces[agent], self._converters[agent] = form(cast("spaces.Dict", nested[PARTS]))
        self._indices_by_name: dict[Role, dict[str, int]] = {}  # filled in by `read_action`
        self.state_space = image_space(engine.setup.image_size)

    def _with_masks(self, infos: dict[str, Info]) -> dict[str, Info]:
        """Both agents' infos, with the masks if these are not in the observations."""
        if not self._converters:
            return infos
        masks = {agent: self.engine.game.legal_mask(self.engine.state, role) for agent, role in ROLES.items()}
        return {agent: {**info, MASK: masks[agent]} for agent, info in infos.items()}

    def observation_space(self, agent: str) -> Any:
        """{"observation": the agent's parts, "action_mask": int8 (actions,)}, or another form's."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete:
        return self.action_spaces[agent]

    def state(self) -> UInt8Array:
        """The image, a new array: (50, 190, 3), or (100, 380, 3) at native size."""
        return draw(self.scene, self.engine.setup.image_size)

    def render(self) -> UInt8Array | str | None:
        """By render mode: an image (304, 784, 3) with a caption, text, or None after updating the window."""
        return self.engine.render()

    def close(self) -> None:
        self.engine.close()

    @property
    def tasks(self) -> TaskSet:
        return self.engine.setup.tasks

    def change_tasks(self, change: Callable[[TaskSet], TaskSet]) -> None:
        """Replaces the tasks by `change(tasks)` from the next reset on; it must keep their statements."""
        self.engine.setup = with_tasks(self.engine.setup, change(self.tasks))

    @property
    def dynamics(self) -> Dynamics:
        """The dynamics of the MDP."""
        return self.engine.game.config.dynamics

    @property
    def task(self) -> Task:
        return self.engine.state.mdp.task

    @property
    def scene(self) -> Scene:
        return self.engine.state.mdp.scene

    def describe_action(self, agent: str, action: SupportsIndex) -> str:
        """The action's name, such as "ADD(LEFT, BLUE)", "accept" or "reject, message 2"."""
        return self.engine.game.describe(role_of(agent), action)

    def read_action(self, agent: str, name: str) -> int:
        """The inverse of `describe_action`, ignoring case and white space. Raises ActionError."""
        game, role = self.engine.game, role_of(agent)
        count = game.action_counts[role]
        if role not in self._indices_by_name:
            self._indices_by_name[role] = {_normalised(game.describe(role, index)): index for index in range(count)}
        index = self._indices_by_name[role].get(_normalised(name))
        if index is None:
            examples = ", ".join(repr(game.describe(role, action)) for action in (0, count - 1))
            raise ActionError(f"{name!r} is not an action of {agent}; actions look like {examples}")
        return index


def _normalised(name: str) -> str:
    return "".join(name.split()).upper()
