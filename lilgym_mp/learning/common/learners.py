"""The learners: what training, evaluation, experiments and reports need to know of each. Imports no torch.

Adding a learner takes an entry in LEARNERS and a module, which imports no torch either, that describes it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from lilgym_mp.envs.config import EnvConfig, option_name
from lilgym_mp.evaluation.policies import GREEDY
from lilgym_mp.learning.common.recipes import Recipe, RunOptions
from lilgym_mp.scene.choices import choose


@dataclass(frozen=True)
class Learner:
    """One way to train agents: hyperparameters, the other options of a run, and functions, which may import torch."""

    recipe: type[Recipe]
    options: type[RunOptions]
    train: Callable[..., Any]  # of the configuration, recipe, run directory and options; returns the agent
    load_agent: Callable[[Path, str], Any]  # the Agent in a model file, on a device
    text: str | None  # help of its command: a line, an empty line, and the description
    config: type[EnvConfig] | None = EnvConfig  # None: one agent plays all configurations of the option `corpus`
    directory: str = "{learner}-{configuration}"  # default name of a run's
    action_modes: Sequence[str] = (GREEDY,)  # evaluated unless others are requested
    check: Callable[[Any, Any], object] | None = None  # of the configuration and recipe, before data are prepared

    @property
    def option_names(self) -> list[str]:
        """The options of an experiment: of the recipe, the run and the game, besides the seed and the environment's."""
        own = [option_name(each) for each in (*self.recipe.settings(), *self.options.settings())]
        game = [] if self.config is None else self.config.settings()
        return [name for name in (*own, *game) if name not in ("seed", *EnvConfig.settings())]

    @property
    def plays_games(self) -> bool:
        """Whether it learns the two-agent game, whose evaluations are not recorded."""
        return self.config not in (None, EnvConfig)

    def budget(self, recipe: Recipe, options: RunOptions) -> tuple[str, float]:
        """The key of progress.jsonl that measures progress, and its value at the end of the run."""
        unit = "steps" if "steps" in self.options.names() else "updates"
        return unit, getattr(options if unit in self.options.names() else recipe, unit)


# By name, which is also the kind of its model files; each is imported when it is used.
LEARNERS: dict[str, Callable[[], Learner]] = {}
SHIPPED = re.compile(r"agent-(.+)\.safetensors")  # files of lilgym_mp.data


def shipped_agents() -> tuple[str, ...]:
    """The names of the agents shipped with the package, all trained on the builtin corpus alone."""
    names = (SHIPPED.fullmatch(file.name) for file in files("lilgym_mp.data").iterdir())
    return tuple(sorted(found[1] for found in names if found is not None))


def find_learner(name: str) -> Learner:
    """Raises ValueError naming the choices."""
    return choose("learner", name, LEARNERS)()
