"""The environment `lilgym-game` of verifiers: a model in each seat of the proposer-verifier game."""

from lilgym_mp.contrib.adapters.verifiers_game import GameEnv, GameTaskset

__all__ = ["GameEnv", "GameTaskset"]
