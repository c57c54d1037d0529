"""Trained agents as game partners: those shipped with the package and those of the runs directory."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from typing import TYPE_CHECKING

from lilgym_mp.contrib.web.errors import http_error
from lilgym_mp.contrib.web.run_directory import RunDirectory
from lilgym_mp.envs.proposer_verifier import Partner, Role
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.learners import shipped_agents

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent

SHIPPED_PREFIX, RUN_PREFIX = "agent:", "run:"  # followed by the agent's name, or by the run's id
PARSER = SHIPPED_PREFIX + "parse-and-plan"  # reads any sentence, plays every configuration
AGENT_CACHE_SIZE = 8


class TrainedPartners:
    """Loads agents on first use and caches them; empty if torch is not installed."""

    def __init__(self, run_directory: RunDirectory) -> None:
        self._run_directory = run_directory
        self._agent = lru_cache(AGENT_CACHE_SIZE)(self._load)

    def names(self) -> dict[str, str]:
        """Display names by form value."""
        if find_spec("torch") is None:
            return {}
        shipped = {SHIPPED_PREFIX + name: f"{name} (shipped with the package)" for name in shipped_agents()}
        return shipped | {RUN_PREFIX + run.id: f"run {run.name}" for run in self._run_directory.agents().values()}

    def partner(self, name: str, settings: Settings, role: Role, protocol: str) -> Partner:
        """Responds with 404 if there is no such agent, 422 if it cannot play this side of the game."""
        from lilgym_mp.evaluation.game_partners import AgentPartner

        agent = self.agent(name)
        own = agent.game
        if own is None:
            try:
                return AgentPartner(agent.policy(settings))
            except ValueError as fault:
                raise http_error(422, str(fault)) from None
        partner = agent.partner(role, own)
        if (own.appearance, own.protocol) != (settings.appearance, protocol) or partner is None:
            plays = f"{own.appearance} under the protocol {own.protocol}"
            raise http_error(422, f"this agent plays {plays}; choose that, and a side that it has learned")
        return partner

    def agent(self, name: str) -> Agent:
        """Responds with 404 if there is no such agent, 422 if its file cannot be read."""
        if name not in self.names():
            raise http_error(404, "there is no such agent; reload the page to see the current ones")
        try:
            return self._agent(name)
        except ValueError as fault:
            raise http_error(422, str(fault)) from None

    def _load(self, name: str) -> Agent:
        from lilgym_mp.learning.common.agents import load_agent, open_agent

        if name.startswith(SHIPPED_PREFIX):
            return load_agent(name.removeprefix(SHIPPED_PREFIX), "cpu")
        return open_agent(self._run_directory.agents()[name.removeprefix(RUN_PREFIX)].path.parent, "cpu")
