"""What both PettingZoo forms offer beside PettingZoo's own methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, SupportsIndex

from gymnasium import spaces

from lilgym_mp.actions import ActionError
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.proposer_verifier.session import RENDER_MODES, Session
from lilgym_mp.envs.proposer_verifier.states import AGENTS, Role
from lilgym_mp.envs.window import RENDER_FPS
from lilgym_mp.observation import image_space
from lilgym_mp.render import draw
from lilgym_mp.rules import Dynamics
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task

ROLES: Mapping[str, Role] = {AGENTS[role]: role for role in Role}


def role_of(agent: object) -> Role:
    """Raises ValueError naming the agents."""
    return choose("agent", agent, ROLES)


class GameAccess:
    """Spaces, the task in play, actions in words, and the picture as PettingZoo's global state."""

    metadata: dict[str, Any] = {
        "name": "proposer_verifier_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": RENDER_FPS,
        "is_parallelizable": False,  # turns need not alternate: `parallel_env` is the parallel form
    }

    def __init__(self, session: Session) -> None:
        self.session = session
        self.possible_agents = list(AGENTS)
        self.render_mode = session.render_mode
        both = {AGENTS[role]: session.spaces(role) for role in Role}
        self.observation_spaces = {agent: observation for agent, (observation, _) in both.items()}
        self.action_spaces = {agent: action for agent, (_, action) in both.items()}
        self._numbers_by_name: dict[Role, dict[str, int]] = {}  # of those roles whose actions have been read
        self.state_space = image_space(session.setup.image_size)

    def observation_space(self, agent: str) -> spaces.Dict:
        """{"observation": the parts that the agent sees, "action_mask": int8 (actions,)}."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete:
        return self.action_spaces[agent]

    def state(self) -> UInt8Array:
        """The picture, new: (50, 190, 3), or (100, 380, 3) at native size."""
        return draw(self.scene, self.session.setup.image_size)

    def render(self) -> UInt8Array | str | None:
        """By render mode: an (304, 784, 3) picture with a caption, a text, or None after showing a window."""
        return self.session.render()

    def close(self) -> None:
        self.session.close()

    @property
    def tasks(self) -> TaskSet:
        return self.session.setup.tasks

    def change_tasks(self, change: Callable[[TaskSet], TaskSet]) -> None:
        """Plays `change(tasks)`, made of the present tasks, from the next reset on; their statements are the same."""
        self.session.setup = replace(self.session.setup, tasks=change(self.tasks))

    @property
    def dynamics(self) -> Dynamics:
        """The MDP underneath."""
        return self.session.game.conditions.dynamics

    @property
    def task(self) -> Task:
        return self.session.state.mdp.task

    @property
    def scene(self) -> Scene:
        return self.session.state.mdp.scene

    def describe_action(self, agent: str, action: SupportsIndex) -> str:
        """An action as people write it, such as "ADD(LEFT, BLUE)", "accept" or "reject, word 2"."""
        return self.session.game.describe(role_of(agent), action)

    def read_action(self, agent: str, name: str) -> int:
        """The number of the action that `describe_action` calls `name`, in any case. Raises ActionError."""
        game, role = self.session.game, role_of(agent)
        if role not in self._numbers_by_name:
            count = game.action_counts[role]
            self._numbers_by_name[role] = {_bare(game.describe(role, number)): number for number in range(count)}
        number = self._numbers_by_name[role].get(_bare(name))
        if number is None:
            examples = ", ".join(repr(game.describe(role, action)) for action in (0, game.action_counts[role] - 1))
            raise ActionError(f"{name!r} names no action of {agent}; names look like {examples}")
        return number


def _bare(name: str) -> str:
    """A name of an action without what may differ in writing it: case and blanks."""
    return "".join(name.split()).upper()
