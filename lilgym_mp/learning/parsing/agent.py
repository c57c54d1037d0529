"""The parse-and-plan agent: reads scenes from pixels and plans for the likely programs of the statement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.evaluation import Policy, Settings
from lilgym_mp.learning.common.agents import Agent, check_configuration
from lilgym_mp.learning.common.model_file import ModelDescription, load_network
from lilgym_mp.learning.common.planning import PlanPolicy
from lilgym_mp.learning.parsing.parser import Parser
from lilgym_mp.learning.parsing.planning import Calibration, ProgramPlanner

KIND = "parse-and-plan"
VERSION = 1


@dataclass(frozen=True)
class ParseAndPlanAgent(Agent):
    """One parser for all configurations of the appearances it was trained on."""

    description: ModelDescription
    parser: Parser

    def planner(self, settings: Settings) -> ProgramPlanner:
        """Raises AgentError for a configuration it does not play."""
        check_configuration(self.description, settings)
        calibration = Calibration(**self.description.details["calibration"])
        return ProgramPlanner(self.parser, settings.dynamics(), settings.start == FLIPIT, calibration)

    def policy(self, settings: Settings, *, sampled: bool = False) -> Policy:
        """Planning is deterministic, so `sampled` has no effect."""
        return PlanPolicy(self.planner(settings))


def load_agent(path: Path, device: str = "auto") -> ParseAndPlanAgent:
    """The agent in a model file. Raises ModelFileError naming the file and what is wrong with it."""
    description, network = load_network(KIND, VERSION, path, device, lambda made: Parser.of(made.details).network)
    return ParseAndPlanAgent(description, replace(Parser.of(description.details), network=network))
