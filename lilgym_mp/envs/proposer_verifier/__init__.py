"""The proposer-verifier game: two agents on one MDP, as PettingZoo environments, with partners and measures.

Without pettingzoo installed, everything but its two environments is available. docs/proposer_verifier.md describes the
protocols, settings and results.
"""

from __future__ import annotations

from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING

from lilgym_mp.corpus.extras import install
from lilgym_mp.envs.proposer_verifier.batched import BatchedGames
from lilgym_mp.envs.proposer_verifier.game import Game, TurnError
from lilgym_mp.envs.proposer_verifier.metrics import GameRecord, Metrics, measure, play_games, summarise
from lilgym_mp.envs.proposer_verifier.observations import read_text
from lilgym_mp.envs.proposer_verifier.partners import (
    ALWAYS_ACCEPT,
    SCRIPTED,
    BatchTurn,
    ClaimingProposer,
    OracleVerifier,
    Partner,
    PartnerError,
    PartnerTurn,
    RandomPartner,
)
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, PROTOCOLS, Role
from lilgym_mp.envs.proposer_verifier.rewards import PRESETS, Intent
from lilgym_mp.envs.proposer_verifier.settings import GameSettings, View
from lilgym_mp.envs.proposer_verifier.single_agent import SingleAgentView
from lilgym_mp.submodules import submodule_getter

HAS_PETTINGZOO = find_spec("pettingzoo") is not None
if TYPE_CHECKING or HAS_PETTINGZOO:
    import pettingzoo

    from lilgym_mp.envs.proposer_verifier.environments import (
        ProposerVerifierAEC,
        ProposerVerifierParallel,
        env,
        parallel_env,
        raw_env,
    )

__all__ = [
    "AGENTS",
    "ALWAYS_ACCEPT",
    "ENVIRONMENT_ID",
    "PRESETS",
    "PROTOCOLS",
    "SCRIPTED",
    "BatchTurn",
    "BatchedGames",
    "ClaimingProposer",
    "Game",
    "GameRecord",
    "GameSettings",
    "Intent",
    "Metrics",
    "OracleVerifier",
    "Partner",
    "PartnerError",
    "PartnerTurn",
    "ProposerVerifierAEC",
    "ProposerVerifierParallel",
    "RandomPartner",
    "Role",
    "SingleAgentView",
    "TurnError",
    "View",
    "env",
    "measure",
    "parallel_env",
    "play_games",
    "raw_env",
    "read_text",
    "summarise",
]

ENVIRONMENT_ID = "lilgym_mp/ProposerVerifier-v0"


if HAS_PETTINGZOO and hasattr(pettingzoo, "register"):  # 1.27 has it
    if ENVIRONMENT_ID not in pettingzoo.aec_registry:
        pettingzoo.register("aec", ENVIRONMENT_ID, f"{__name__}:env")
    if ENVIRONMENT_ID not in pettingzoo.parallel_registry:
        pettingzoo.register("parallel", ENVIRONMENT_ID, f"{__name__}:parallel_env")


def __getattr__(name: str) -> ModuleType:
    """Imports modules on first use, and explains why the PettingZoo environments are missing."""
    if name not in __all__:
        return submodule_getter(__name__)(name)
    message = f"{name} needs pettingzoo, BatchedGames does not: {install('pettingzoo')}"
    raise ImportError(message, name="pettingzoo")
