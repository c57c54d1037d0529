"""The learners: what training, evaluation, experiments and reports need to know of each. Imports no torch.

Adding a learner takes a line in PACKAGES and a package with two modules: `learner`, which imports no torch either and
defines LEARNER, and whose docstring is the help of its command; and `agent`, whose function `load_agent` of a model
file and a device returns the Agent.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.resources import files
from typing import Any

from lilgym_mp.evaluation.policies import GREEDY
from lilgym_mp.scene.choices import choose

PACKAGES: dict[str, str] = {  # by name, which is also the kind of its model files
    "parse-and-plan": "lilgym_mp.learning.parsing",
    "imitation": "lilgym_mp.learning.imitation",
    "ppo": "lilgym_mp.learning.ppo",
    "reward-model": "lilgym_mp.learning.reward_model",
    "game": "lilgym_mp.learning.game",
}


@dataclass(frozen=True)
class Learner:
    """One way to train agents."""

    add_options: Callable[[argparse.ArgumentParser], None]  # of `lilgym-mp train NAME`
    train: Callable[[argparse.Namespace], int]  # trains as these options say; returns the exit code
    recipe: type[Any]  # dataclass of hyperparameters, with fields made by `recipes.setting`
    make_recipe: Callable[[str, dict[str, Any]], Any]  # from a configuration and options; raises ValueError
    progress: tuple[str, str]  # for training curves: key of progress.jsonl, axis label
    budget: Callable[[Mapping[str, Any]], tuple[str, float]] = lambda options: ("updates", options["updates"])
    # ^ from options: key of progress.jsonl, last value
    numbers: Mapping[str, Any] = field(default_factory=dict[str, Any])  # options besides the recipe, with defaults
    texts: Sequence[str] = ()  # further options, with text values
    plays_everything: bool = False  # one agent plays all configurations, so the command takes none
    records: bool = True  # whether evaluations of its runs are recorded, unlike those of the two-agent game
    action_modes: Sequence[str] = (GREEDY,)  # evaluated unless others are requested


SHIPPED = re.compile(r"agent-(.+)\.safetensors")  # files of lilgym_mp.data


def shipped_agents() -> tuple[str, ...]:
    """The names of the agents shipped with the package, all trained on the builtin corpus alone."""
    names = (SHIPPED.fullmatch(file.name) for file in files("lilgym_mp.data").iterdir())
    return tuple(sorted(found[1] for found in names if found is not None))


def find_learner(name: str) -> Learner:
    """Raises ValueError naming the choices."""
    return import_module(f"{choose('learner', name, PACKAGES)}.learner").LEARNER
