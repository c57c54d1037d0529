"""The base class of both PettingZoo environments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, SupportsIndex

from gymnasium import spaces

from lilgym_mp.actions import ActionError
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.proposer_verifier.engine import RENDER_MODES, GameEngine
from lilgym_mp.envs.proposer_verifier.types import AGENTS, Role
from lilgym_mp.envs.window import RENDER_FPS
from lilgym_mp.observation import image_space
from lilgym_mp.render import draw
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

ROLES: Mapping[str, Role] = {AGENTS[role]: role for role in Role}


def role_of(agent: object) -> Role:
    """The agent's role. Raises ValueError naming the agents."""
    return choose("agent", agent, ROLES)


class BaseGameEnv:
    """Spaces, the current task, names of actions, and the image as PettingZoo's global state."""

    metadata: dict[str, Any] = {
        "name": "proposer_verifier_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": RENDER_FPS,
        "is_parallelizable": False,  # turns need not alternate; `parallel_env` is the parallel environment
    }

    def __init__(self, engine: GameEngine) -> None:
        self.engine = engine
        self.possible_agents = list(AGENTS)
        self.render_mode = engine.render_mode
        both = {AGENTS[role]: engine.spaces(role) for role in Role}
        self.observation_spaces = {agent: observation for agent, (observation, _) in both.items()}
        self.action_spaces = {agent: action for agent, (_, action) in both.items()}
        self._indices_by_name: dict[Role, dict[str, int]] = {}  # filled in by `read_action`
        self.state_space = image_space(engine.setup.image_size)

    def observation_space(self, agent: str) -> spaces.Dict:
        """{"observation": the agent's parts, "action_mask": int8 (actions,)}."""
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
        self.engine.setup = replace(self.engine.setup, tasks=change(self.tasks))

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
            raise ActionError(f"{name!r} names no action of {agent}; names look like {examples}")
        return index


def _normalised(name: str) -> str:
    return "".join(name.split()).upper()
