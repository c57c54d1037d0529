"""The learners: what training, evaluation, experiments and reports need to know of each. Imports no torch.

Adding a learner takes a line in PACKAGES and a package with two modules: `learner`, which imports no torch either and
defines LEARNER, and whose docstring is the help of its command; and `agent`, whose function `load_agent` of a model
file and a device returns the Agent.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.resources import files
from typing import Any, cast

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.policies import GREEDY
from lilgym_mp.learning.common.recipes import Recipe, RunOptions
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
    """One way to train agents: hyperparameters, the other options of a run, and the function that trains."""

    recipe: type[Recipe]
    options: type[RunOptions]
    train: str  # "module:function" of the configuration, recipe, run directory and options; returns the agent
    config: type[EnvConfig] | None = EnvConfig  # None: one agent plays all configurations of the option `corpus`
    directory: str = "{learner}-{configuration}"  # default name of a run's
    action_modes: Sequence[str] = (GREEDY,)  # evaluated unless others are requested

    def option_kinds(self) -> dict[str, type[Any]]:
        """The types of the options besides the recipe and the environment's settings, by their name in experiments."""
        kinds = {name: each.metadata["parse"] for name, each in self._game_settings().items()}
        kinds |= {name: each.metadata["kind"] for name, each in self._own_options().items()}
        return {name: kind if kind in (int, float) else str for name, kind in kinds.items() if name != "seed"}

    def _own_options(self) -> dict[str, Any]:
        """The fields of the options by their name in experiments."""
        return {each.metadata["shown"].get("flag", each.name): each for each in self.options.settings()}

    def _game_settings(self) -> dict[str, Any]:
        """The fields of the configuration that a single environment has not."""
        settings = {} if self.config is None else self.config.settings()
        return {name: each for name, each in settings.items() if name not in EnvConfig.settings()}

    @property
    def plays_games(self) -> bool:
        """Whether it learns the two-agent game, whose evaluations are not recorded."""
        return bool(self._game_settings())

    def make_recipe(self, configuration: str, options: Mapping[str, Any]) -> Recipe:
        """The recipe that these options of an experiment make; checks the others too. Raises ValueError."""
        self.options(**{each.name: options[name] for name, each in self._own_options().items() if name in options})
        if self.plays_games:
            game, known = cast("Any", self.config), self._game_settings()
            given = {name: known[name].metadata["parse"](value) for name, value in options.items() if name in known}
            game(configuration, **given).setup()
        changes = {name: value for name, value in options.items() if name in self.recipe.names()}
        return self.recipe.of(configuration, options.get("recipe"), **changes)

    def budget(self, options: Mapping[str, Any]) -> tuple[str, float]:
        """The key of progress.jsonl that measures progress, and its value at the end of a run with these options."""
        defaults = {each.name: each.default for each in (*self.recipe.settings(), *self.options.settings())}
        unit = "steps" if "steps" in self.options.names() else "updates"
        return unit, options.get(unit, defaults[unit])


SHIPPED = re.compile(r"agent-(.+)\.safetensors")  # files of lilgym_mp.data


def shipped_agents() -> tuple[str, ...]:
    """The names of the agents shipped with the package, all trained on the builtin corpus alone."""
    names = (SHIPPED.fullmatch(file.name) for file in files("lilgym_mp.data").iterdir())
    return tuple(sorted(found[1] for found in names if found is not None))


def find_learner(name: str) -> Learner:
    """Raises ValueError naming the choices."""
    return import_module(f"{choose('learner', name, PACKAGES)}.learner").LEARNER
