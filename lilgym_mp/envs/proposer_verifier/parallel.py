"""The form in which both agents act in every step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsIndex

from gymnasium.error import ResetNeeded
from pettingzoo import ParallelEnv

from lilgym_mp.envs.proposer_verifier.boxes import NESTED, shown_as
from lilgym_mp.envs.proposer_verifier.game import TurnError
from lilgym_mp.envs.proposer_verifier.session import AgentObservation, Info, Session
from lilgym_mp.envs.proposer_verifier.settings import Settings
from lilgym_mp.envs.proposer_verifier.shared import GameAccess
from lilgym_mp.envs.proposer_verifier.states import AGENTS

PROPOSER_NAME, VERIFIER_NAME = AGENTS

ParallelStep = tuple[dict[str, AgentObservation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Info]]


class ProposerVerifierParallel(GameAccess, ParallelEnv[str, AgentObservation, SupportsIndex]):
    """A proposer and a verifier act on one MDP, both in every step.

    Where they take turns, one step is one turn: for the agent whose turn it is not only "wait" is legal, and
    whatever else it does is ignored. Both agents' observations of one step share the arrays of what both see.
    """

    def __init__(self, settings: Settings, render_mode: str | None = None) -> None:
        GameAccess.__init__(self, Session(settings.setup(), render_mode))
        self.agents: list[str] = []

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, AgentObservation], dict[str, Info]]:
        """`options`: "task", an id of the split, and "intent", "helpful" or "sneaky"; others are ignored."""
        infos = self.session.reset(seed, options)
        self.agents = list(AGENTS)
        proposer, verifier = self.session.observe_both()
        return (
            {PROPOSER_NAME: proposer, VERIFIER_NAME: verifier},
            {PROPOSER_NAME: infos[0], VERIFIER_NAME: infos[1]},
        )

    def step(self, actions: Mapping[str, SupportsIndex]) -> ParallelStep:
        """Raises ActionError for a number out of range, TurnError where not just both agents act, ResetNeeded
        before reset and after the end."""
        if not self.agents:
            raise ResetNeeded("no agent is in play; call reset before step")
        if len(actions) != len(AGENTS) or PROPOSER_NAME not in actions or VERIFIER_NAME not in actions:
            raise TurnError(f"actions must be of {' and '.join(AGENTS)}, not of {', '.join(actions) or 'nobody'}")
        step, infos = self.session.play_together(actions[PROPOSER_NAME], actions[VERIFIER_NAME])
        _, rewards, terminated, truncated, _, _, _, _ = step
        if terminated or truncated:
            self.agents = []
        proposer, verifier = self.session.observe_both()
        return (
            {PROPOSER_NAME: proposer, VERIFIER_NAME: verifier},
            {PROPOSER_NAME: rewards[0], VERIFIER_NAME: rewards[1]},
            {PROPOSER_NAME: terminated, VERIFIER_NAME: terminated},
            {PROPOSER_NAME: truncated, VERIFIER_NAME: truncated},
            {PROPOSER_NAME: infos[0], VERIFIER_NAME: infos[1]},
        )


def parallel_env(
    *, render_mode: str | None = None, observations: str = NESTED, **settings: Any
) -> ProposerVerifierParallel:
    """The form in which both agents act in every step; keywords are the fields of Settings.

    `observations`: "nested", {"observation": parts, "action_mask"}; or, with masks in infos, "vector", all parts as
    float32 (N,), or "image", the image alone: what SuperSuit's wrappers take.
    """
    return shown_as(ProposerVerifierParallel(Settings.of(**settings), render_mode), observations)
