"""Start scenes with their boxes in any order."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from lilgym_mp.corpus.permutation import with_permuted_boxes
from lilgym_mp.wrappers.factory import factory
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import TaskChange


class PermutedTasks(TaskChange):
    """Every task in every order of its boxes."""

    change = staticmethod(with_permuted_boxes)


class BoxPermutation(EnvWrapper[PermutedTasks]):
    """Starts each episode with the boxes in a random order, drawn by the environment's own generator.

    The environment then has up to six tasks for each of the corpus's: "7" as it is, and "7@021" .. "7@210", whose
    digits tell which old box stands where. Orders in which the statement has another truth value, because it names
    a box, are left out. Scratch tasks start empty, so nothing changes there. It is meant for training:
    `evaluation_tasks()` has the permuted tasks too.

    It must stand beneath all wrappers but NLVRReward.
    """

    transformation_class = PermutedTasks

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)


box_permutation_v0 = factory(BoxPermutation)
