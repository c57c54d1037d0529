"""Policies, models and training loops; torch only from here on."""

from __future__ import annotations

from lilgym_mp.learning.common.learners import LEARNERS, Learner
from lilgym_mp.submodules import submodule_getter


def _parse_and_plan() -> Learner:
    from lilgym_mp.learning.parsing.learner import LEARNER

    return LEARNER


def _imitation() -> Learner:
    from lilgym_mp.learning.imitation.learner import LEARNER

    return LEARNER


def _ppo() -> Learner:
    from lilgym_mp.learning.ppo.learner import LEARNER

    return LEARNER


def _reward_model() -> Learner:
    from lilgym_mp.learning.reward_model.learner import LEARNER

    return LEARNER


def _game() -> Learner:
    from lilgym_mp.learning.game.learner import LEARNER

    return LEARNER


LEARNERS.update(
    {
        "parse-and-plan": _parse_and_plan,
        "imitation": _imitation,
        "ppo": _ppo,
        "reward-model": _reward_model,
        "game": _game,
    }
)

__getattr__ = submodule_getter(__name__)
