"""What every trained agent is, whatever learner made it: a description, and a policy for each configuration it plays.

A learner writes its agent as one model file (`model_file`), AGENT_FILE in its run directory. `open_agent` finds out
from the file which learner it is of.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.resources import as_file, files
from pathlib import Path
from typing import Protocol

from lilgym_mp.choices import choose
from lilgym_mp.evaluation import Policy, Settings
from lilgym_mp.learning.agent_files import AGENT_FILE, shipped_agents
from lilgym_mp.learning.model_file import ModelDescription, ModelFileError, read_description

__all__ = [
    "AGENT_FILE",
    "LOADERS",
    "Agent",
    "AgentError",
    "agent_file",
    "check_configuration",
    "load_agent",
    "open_agent",
    "shipped_agents",
]

# By kind, where its loader is: a function of a path and a device's name that gives an Agent.
LOADERS: Mapping[str, str] = {
    "parse-and-plan": "lilgym_mp.learning.parsing.agent:load_agent",
    "imitation": "lilgym_mp.learning.imitation.agent:load_agent",
    "ppo": "lilgym_mp.learning.ppo.agent:load_agent",
}


class Agent(Protocol):
    """A trained agent."""

    @property
    def description(self) -> ModelDescription: ...

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """A policy for the configuration; `sampled`: actions are drawn, else the likeliest are taken.

        Raises ValueError for a configuration, grid or rule set that the agent cannot play.
        """
        ...


class AgentError(ValueError):
    """A place that holds no trained agent, or an agent that cannot do what is asked of it."""


def agent_file(place: Path) -> Path:
    """The model file that `place` means: itself, or the one in a run directory. Raises AgentError."""
    if not place.exists():
        raise AgentError(f"no trained agent at {place}: there is no such file or directory")
    if not place.is_dir():
        return place
    if not (place / AGENT_FILE).exists():
        raise AgentError(f"no trained agent in {place}: it has no {AGENT_FILE}")
    return place / AGENT_FILE


def open_agent(place: Path, device: str = "auto") -> Agent:
    """The agent of a run directory or model file. Raises ValueError naming the file and what is wrong."""
    path = agent_file(place)
    description = read_description(path)
    if description.kind not in LOADERS:
        raise ModelFileError(f"{path}: of the unknown kind {description.kind!r}; known: {', '.join(sorted(LOADERS))}")
    module, name = choose("kind", description.kind, LOADERS).split(":")
    load: Callable[[Path, str], Agent] = getattr(import_module(module), name)
    return load(path, device)


def load_agent(name: str, device: str = "auto") -> Agent:
    """An agent that comes with the package. Raises ValueError naming the choices."""
    choose("agent", name, {agent: agent for agent in shipped_agents()})
    with as_file(files("lilgym_mp.data") / f"agent-{name}.safetensors") as path:
        return open_agent(path, device)


def check_configuration(description: ModelDescription, settings: Settings) -> None:
    """Raises AgentError when the agent does not play the configuration."""
    if settings.configuration not in description.configurations:
        raise AgentError(
            f"this agent does not play {settings.configuration}; it plays {', '.join(description.configurations)}"
        )
