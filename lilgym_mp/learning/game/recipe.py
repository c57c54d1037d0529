"""Hyperparameters of both agents' learning. Imports no torch."""

from __future__ import annotations

from dataclasses import dataclass

from lilgym_mp.learning.common.recipes import UpdateRecipe, setting


@dataclass(frozen=True, slots=True)
class GameRecipe(UpdateRecipe):
    """Hyperparameters, except the game and the budget."""

    envs: int = setting(512, "games played side by side; they start again with each rollout", 1)
    same_statement: int = setting(32, "games per group; a group plays one statement at a time", 1)
    rollout: int = setting(8192, "turns per rollout, over all games", 1)
    batch_size: int = setting(2048, "mini-batch size", 1)
    held_out: float = setting(0.0, "fraction of training statements held out, for tuning", 0, 0.5)
    algorithm: str = setting(
        "shared",
        "one network for both agents, told whose turn it is, or one for each",
        choices=("independent", "shared"),
    )
    critic: str = setting(
        "own",
        "values from what each agent sees, or by a network of their own from everything (central, as in MAPPO)",
        choices=("own", "central"),
    )
    verifier: str = setting(
        "both",
        "learns from its rewards, from the truth of the claims it judged in a game's last turn, or from both",
        choices=("ppo", "cross-entropy", "both"),
        flag="verifier_loss",
    )
    mask: bool = setting(True, "mask the proposer's illegal actions in training and in play")
    width: int = setting(64, "width of the networks; a multiple of 8", 8, 1024)
    claim_steps: int = setting(8, "optimiser steps on remembered claims per rollout", 0)
    claim_memory: int = setting(100_000, "claims remembered", 1)
    claim_statements: int = setting(64, "statements in a step on claims, with up to as many claims of each", 1)

    @property
    def learns_claims(self) -> bool:
        """Whether the verifier learns to judge claims, alone or besides PPO."""
        return self.verifier != "ppo"

    @property
    def judges_only(self) -> bool:
        """Whether the verifier's answers follow from the truth it believes in alone, and it accepts edits."""
        return self.verifier == "cross-entropy"
