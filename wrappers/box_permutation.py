"""Start scenes with permuted boxes."""

from __future__ import annotations

from lilgym_mp.corpus.tasks import with_permuted_boxes
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import TaskChange


class PermutedTasks(TaskChange):
    """Adds every task with its boxes in every order."""

    change = staticmethod(with_permuted_boxes)


class BoxPermutation(EnvWrapper[PermutedTasks]):
    """Starts each episode with the boxes in a random order, drawn from the environment's generator.

    Each task of the corpus becomes up to six: "7" unchanged, and "7@021" .. "7@210", whose digits are the original
    boxes, left to right. Orders that change the statement's truth value, because it names a box, are omitted. Scratch
    tasks start empty, so they stay the same. For training only: `evaluation_tasks()` includes the permuted tasks.

    Must be applied before all other wrappers but NLVRReward.
    """

    transformation_class = PermutedTasks
