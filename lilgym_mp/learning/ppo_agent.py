"""The agent that masked PPO trains, as a model file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lilgym_mp.appearances import make_appearance
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Policy, Settings
from lilgym_mp.learning.agents import AGENT_FILE, AgentError, check_configuration
from lilgym_mp.learning.devices import chosen_device
from lilgym_mp.learning.model_file import ModelDescription, ModelFileError, load_model, restore, save_model
from lilgym_mp.learning.network import ActorCritic
from lilgym_mp.learning.policy import Agent as NetworkPolicy
from lilgym_mp.learning.training import Run

KIND = "ppo"
VERSION = 1
SUPERVISION = "rewards alone; illegal actions masked in training and in play"


@dataclass(frozen=True)
class PPOAgent:
    """A network for one configuration and grid."""

    description: ModelDescription
    settings: Settings  # that it was trained in
    network: ActorCritic
    vocabulary: Vocabulary
    length: int  # words of a statement that it reads

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """Raises AgentError for another configuration or grid than it was trained in."""
        check_configuration(self.description, settings)
        if settings.grid != self.settings.grid:
            raise AgentError(f"this agent was trained on the grid {self.settings.grid}, not {settings.grid}")
        return NetworkPolicy(self.network, self.vocabulary, self.length, greedy=not sampled)


def save_agent(run: Run) -> Path:
    """Writes the run's network, as it is now, into its directory; gives the file."""
    identity, agent = run.identity, run.agent()
    description = ModelDescription(
        KIND,
        VERSION,
        (identity.settings.configuration,),
        SUPERVISION,
        {**identity.recipe.to_json(), "steps": run.steps},
        {"settings": identity.settings.to_json(), "words": list(run.vocabulary.words), "length": identity.length},
    )
    path = run.directory.path / AGENT_FILE
    save_model(path, description, agent.network.state_dict())
    return path


def load_agent(path: Path, device: str = "auto") -> PPOAgent:
    """The agent in a model file. Raises ModelFileError naming the file and what is wrong with it."""
    target = chosen_device(device)
    description, tensors = load_model(path, target)
    if (description.kind, description.version) != (KIND, VERSION):
        found = f"{description.kind!r}, version {description.version}"
        raise ModelFileError(f"{path}: a model of kind {found}; must be {KIND!r}, version {VERSION}")
    try:
        settings = Settings.from_json(description.details["settings"])
        vocabulary = Vocabulary(tuple(description.details["words"]))
        length = int(description.details["length"])
        appearance = make_appearance(settings.appearance, settings.grid)
    except (KeyError, TypeError, ValueError) as fault:
        raise ModelFileError(f"{path}: its description cannot be used: {fault!r}") from None
    network = ActorCritic(appearance, len(vocabulary)).to(target)
    restore(network, tensors, path)
    return PPOAgent(description, settings, network.eval(), vocabulary, length)
