"""The ablation that rewards STOP only in scenes of the corpus. Source: docs/spec.md, "NLVR reward"."""

from __future__ import annotations

from lilgym_mp.corpus.matching import matching_corpus
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import TaskChange


class MatchingTasks(TaskChange):
    """Restricts every task's goals to scenes of the corpus."""

    change = staticmethod(matching_corpus)


class NLVRReward(EnvWrapper[MatchingTasks]):
    """Counts STOP as a success only in a scene that the corpus pairs with the statement and labels with the target
    value: the same items at the same positions in the same boxes, in any order. No program is run.

    Reward, outcome, `goal_reached()` and stop forcing are all affected. For the Scratch configurations; the scenes are
    the start scenes of the FlipIt tasks of the same corpus and split. Raises CorpusError for FlipIt.

    Must be applied before all other wrappers but BoxPermutation.
    """

    transformation_class = MatchingTasks
