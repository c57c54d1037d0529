"""The game as a PettingZoo parallel environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsIndex

from gymnasium.error import ResetNeeded
from pettingzoo import ParallelEnv

from lilgym_mp.envs.proposer_verifier.array_observations import NESTED, convert_observations
from lilgym_mp.envs.proposer_verifier.base import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.engine import AgentObservation, GameEngine, Info
from lilgym_mp.envs.proposer_verifier.game import TurnError
from lilgym_mp.envs.proposer_verifier.settings import Settings
from lilgym_mp.envs.proposer_verifier.types import AGENTS

PROPOSER_NAME, VERIFIER_NAME = AGENTS

ParallelStep = tuple[dict[str, AgentObservation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Info]]


class ProposerVerifierParallel(BaseGameEnv, ParallelEnv[str, AgentObservation, SupportsIndex]):
    """A proposer and a verifier act on one MDP; each step takes an action from both.

    In turn-based protocols a step is one turn: the agent out of turn has one legal action, "wait", and any other is
    ignored. Both agents' observations share the arrays of parts that both see.
    """

    def __init__(self, settings: Settings, render_mode: str | None = None) -> None:
        BaseGameEnv.__init__(self, GameEngine(settings.setup(), render_mode))
        self.agents: list[str] = []

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, AgentObservation], dict[str, Info]]:
        """`options`: "task", an id of the split; "intent", "helpful" or "sneaky". Others are ignored."""
        infos = self.engine.reset(seed, options)
        self.agents = list(AGENTS)
        proposer, verifier = self.engine.observe_both()
        return (
            {PROPOSER_NAME: proposer, VERIFIER_NAME: verifier},
            {PROPOSER_NAME: infos[0], VERIFIER_NAME: infos[1]},
        )

    def step(self, actions: Mapping[str, SupportsIndex]) -> ParallelStep:
        """Raises ActionError for an action outside the action space, TurnError unless exactly both agents act,
        ResetNeeded before reset and after the end."""
        if not self.agents:
            raise ResetNeeded("no agent is active; call reset before step")
        if len(actions) != len(AGENTS) or PROPOSER_NAME not in actions or VERIFIER_NAME not in actions:
            raise TurnError(f"actions must be for {' and '.join(AGENTS)}, not for {', '.join(actions) or 'no agent'}")
        step, infos = self.engine.step_both(actions[PROPOSER_NAME], actions[VERIFIER_NAME])
        _, rewards, terminated, truncated, _, _, _, _ = step
        if terminated or truncated:
            self.agents = []
        proposer, verifier = self.engine.observe_both()
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
    """The game as a PettingZoo parallel environment; keywords are the fields of Settings.

    `observations`: "nested", {"observation": parts, "action_mask"}; or a single array for SuperSuit's wrappers, with
    masks in infos: "vector", all parts flattened to float32 (N,), or "image", only the image.
    """
    return convert_observations(ProposerVerifierParallel(Settings.of(**settings), render_mode), observations)
