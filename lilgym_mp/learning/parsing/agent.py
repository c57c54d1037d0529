"""The parse-and-plan agent: reads scenes from pixels and plans for the likely programs of the statement."""

from __future__ import annotations

from dataclasses import dataclass

from lilgym_mp.corpus.records import FLIPIT
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import Policy
from lilgym_mp.learning.common.agents import Agent, check_configuration
from lilgym_mp.learning.common.model_file import ModelDescription
from lilgym_mp.learning.common.planning import PlanPolicy
from lilgym_mp.learning.common.program_network import ParserNetwork
from lilgym_mp.learning.parsing.parser import Parser
from lilgym_mp.learning.parsing.planning import Calibration, ProgramPlanner


@dataclass(frozen=True)
class ParseAndPlanAgent(Agent):
    """One parser for all configurations of the appearances it was trained on."""

    kind = "parse-and-plan"
    version = 1
    description: ModelDescription
    parser: Parser

    @classmethod
    def of(cls, description: ModelDescription) -> ParseAndPlanAgent:
        return cls(description, Parser.of(description.details))

    @property
    def network(self) -> ParserNetwork:
        """The network of the parser."""
        return self.parser.network

    def planner(self, settings: EnvConfig) -> ProgramPlanner:
        """Raises AgentError for a configuration it does not play."""
        check_configuration(self.description, settings)
        calibration = Calibration(**self.description.details["calibration"])
        return ProgramPlanner(self.parser, settings.dynamics(), settings.start == FLIPIT, calibration)

    def policy(self, settings: EnvConfig, *, sampled: bool = False) -> Policy:
        """Planning is deterministic, so `sampled` has no effect."""
        return PlanPolicy(self.planner(settings))
