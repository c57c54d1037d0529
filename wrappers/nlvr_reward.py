"""The ablation in which STOP is rewarded for a scene that the corpus has. Source: SPEC section 6."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from lilgym_mp.corpus.matching import matching_corpus
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import TaskChange


class MatchingTasks(TaskChange):
    """Every task solved by the corpus's scenes only."""

    change = staticmethod(matching_corpus)


class NLVRReward(EnvWrapper[MatchingTasks]):
    """Counts a STOP as a success only in a scene that the corpus itself has for the statement, labelled with the target
    value: the same items at the same places in the same boxes, whatever their order. No program is run.

    Reward, outcome, `goal_reached()` and stop forcing all follow. For the Scratch configurations; the scenes are the
    start scenes of FlipIt's tasks of the same corpus and split. Raises CorpusError for FlipIt.

    It must stand beneath all wrappers but BoxPermutation.
    """

    transformation_class = MatchingTasks

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)


nlvr_reward_v0 = factory(NLVRReward)
