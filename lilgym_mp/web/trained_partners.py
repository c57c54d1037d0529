"""Agents that can take a seat in the game: those that come with the package, and those of the directory of runs."""

from __future__ import annotations

import threading
from importlib.util import find_spec
from typing import TYPE_CHECKING

from lilgym_mp.envs.proposer_verifier import Partner
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.agent_files import shipped_agents
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.run_directory import Recordings

if TYPE_CHECKING:
    from lilgym_mp.learning.agents import Agent

SHIPPED, OF_RUN = "agent:", "run:"  # before an agent's name, before a run's id
MOST_KEPT = 8  # agents that stay loaded


class TrainedPartners:
    """Agents by name, loaded when first asked for; none where torch is not installed."""

    def __init__(self, recordings: Recordings) -> None:
        self._recordings = recordings
        self._agents: dict[str, Agent] = {}
        self._lock = threading.Lock()

    def names(self) -> dict[str, str]:
        """How each is chosen, and how it is called."""
        if find_spec("torch") is None:
            return {}
        found = {SHIPPED + name: f"{name}, comes with the package" for name in shipped_agents()}
        return found | {OF_RUN + run.id: f"run {run.name}" for run in self._recordings.list_runs()}

    def partner(self, name: str, settings: Settings) -> Partner:
        """A new partner. Answers 404 where there is no such agent, 422 where it cannot play the configuration."""
        from lilgym_mp.learning.partners import AgentPartner

        if name not in self.names():
            raise refusal(404, "there is no such partner; reload the page for those that there are")
        try:
            return AgentPartner(self._agent(name).policy(settings))
        except ValueError as fault:
            raise refusal(422, str(fault)) from None

    def _agent(self, name: str) -> Agent:
        from lilgym_mp.learning.agents import load_agent, open_agent

        with self._lock:
            if name not in self._agents:
                if len(self._agents) >= MOST_KEPT:
                    self._agents.pop(next(iter(self._agents)))
                if name.startswith(SHIPPED):
                    self._agents[name] = load_agent(name.removeprefix(SHIPPED), "cpu")
                else:
                    self._agents[name] = open_agent(self._recordings.runs()[name.removeprefix(OF_RUN)], "cpu")
            return self._agents[name]
