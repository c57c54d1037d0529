"""Trained agents of any learner: a description, and a policy for each configuration they play.

A learner saves its agent as one model file (`model_file`), AGENT_FILE in its run directory; the file names the learner.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import nullcontext
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import Policy
from lilgym_mp.learning.common.learners import LEARNERS, shipped_agents
from lilgym_mp.learning.common.model_file import (
    ModelDescription,
    ModelFileError,
    load_model,
    load_weights,
    no_larger_than,
    read_description,
    select_device,
    using_description,
)
from lilgym_mp.learning.common.run_directory import AGENT_FILE
from lilgym_mp.scene.arrays import AnyMapping, Strings
from lilgym_mp.scene.choices import choose

if TYPE_CHECKING:
    from lilgym_mp.envs.proposer_verifier import GameSettings, Partner, Role
    from lilgym_mp.learning.common.box_transformer import BoxTransformer
    from lilgym_mp.learning.common.planning import Planner

SHARED = "shared"  # the name of a network that plays alone, or plays both agents of the game


class AgentError(ValueError):
    """No trained agent at a path, or an agent that does not support a request."""


class Agent(ABC):
    """A trained agent."""

    kind: ClassVar[str]  # of its model files: the learner, as named on the command line
    version: ClassVar[int]  # of the kind's own format
    description: ModelDescription
    network: Any  # the module whose weights its model file holds
    chooses_actions: ClassVar[bool] = False  # it decides itself whether `policy` samples, unless requested
    teaches: ClassVar[bool] = False  # its plans, made from rewards alone, can be imitated

    @classmethod
    def of(cls, description: ModelDescription) -> Self:
        """The agent described, with untrained weights, for `load`. Raises ValueError, TypeError, KeyError."""
        raise NotImplementedError

    @classmethod
    def describe(
        cls, configurations: Strings, supervision: str, recipe: AnyMapping, details: AnyMapping
    ) -> ModelDescription:
        """The description of an agent of this kind."""
        return ModelDescription(cls.kind, cls.version, configurations, supervision, recipe, details)

    @classmethod
    def load(cls, path: Path, device: str = "auto") -> Self:
        """The agent in a model file, for play.

        Raises ModelFileError naming the file and what is wrong with it, such as another kind or version.
        """
        torch_device = select_device(device)
        description, tensors = load_model(path, torch_device)
        if (description.kind, description.version) != (cls.kind, cls.version):
            found = f"{description.kind!r}, version {description.version}"
            raise ModelFileError(f"{path}: a model of kind {found}; must be {cls.kind!r}, version {cls.version}")
        is_pretrained = "weights" in description.details.get("model", {})  # its sizes are those of another file
        with using_description(path), nullcontext() if is_pretrained else no_larger_than(tensors):
            agent = cls.of(description)
        load_weights(agent.network, tensors, path)
        agent.network.to(torch_device).eval()
        return agent

    @property
    def game(self) -> GameSettings | None:
        """The two-agent game that it was trained on, if it was."""
        return None

    @abstractmethod
    def policy(self, settings: EnvConfig, *, sampled: bool = False) -> Policy:
        """A policy for the configuration that samples actions if `sampled`, else takes the most probable ones.

        Raises ValueError for a configuration, grid or rule set that the agent cannot play.
        """

    def planner(self, settings: EnvConfig) -> Planner:
        """Raises AgentError for an agent that makes no plans."""
        raise AgentError(f"an agent of kind {self.description.kind} makes no plans")

    def box_transformers(self) -> Mapping[str, BoxTransformer]:
        """Its networks by name, for another run to start from. Raises AgentError for an agent of another model."""
        raise AgentError(f"an agent of kind {self.description.kind} has no network of --model ours to start from")

    def partner(self, role: Role | str, game: GameSettings | None = None, *, sampled: bool = False) -> Partner | None:
        """The agent in one seat of the game; None if it did not learn that seat.

        An agent of the single-agent environment proposes its actions, and accepts claims where it would STOP. It needs
        `game`. Raises ValueError for an unknown role or without the game.
        """
        from lilgym_mp.envs.proposer_verifier import Role
        from lilgym_mp.evaluation.game_partners import AgentPartner  # imports the game

        Role.of(role)
        if game is None:
            raise AgentError(
                "this agent learned without a game: name one, as in partner(role, GameSettings(configuration))"
            )
        return AgentPartner(self.policy(game.single(), sampled=sampled))


def agent_file(path: Path) -> Path:
    """The model file at `path`, which may be a run directory, or that of a shipped agent. Raises AgentError."""
    if not path.exists():
        if str(path) in shipped_agents():
            return _shipped_file(str(path))
        raise AgentError(
            f"no trained agent at {path}: there is no such file or directory; the agents that come with the package"
            f" are {', '.join(shipped_agents())}"
        )
    if not path.is_dir():
        return path
    if not (path / AGENT_FILE).exists():
        raise AgentError(f"no trained agent in {path}: it has no {AGENT_FILE}")
    return path / AGENT_FILE


def open_agent(path: Path | str, device: str = "auto") -> Agent:
    """The agent of a run directory or model file, or else one shipped with the package, by its name.

    Raises ValueError naming the file and what is wrong.
    """
    path = agent_file(Path(path))
    kind = read_description(path).kind
    if kind not in LEARNERS:
        raise ModelFileError(f"{path}: unknown kind {kind!r}; known: {', '.join(sorted(LEARNERS))}")
    return LEARNERS[kind]().load_agent(path, device)


def load_agent(name: str, device: str = "auto") -> Agent:
    """An agent shipped with the package. Raises ValueError naming the choices."""
    choose("agent", name, dict.fromkeys(shipped_agents()))
    return open_agent(_shipped_file(name), device)


def _shipped_file(name: str) -> Path:
    return Path(str(files("lilgym_mp.data") / f"agent-{name}.safetensors"))


def check_configuration(description: ModelDescription, settings: EnvConfig) -> None:
    """Raises AgentError when the agent does not play the configuration."""
    if settings.configuration not in description.configurations:
        raise AgentError(
            f"this agent does not play {settings.configuration}; it plays {', '.join(description.configurations)}"
        )
