"""An agent that parses statements into programs and plans with them.

Trains one agent for all configurations of a corpus: it learns to parse statements into programs, reads scenes from
pixels, and plans for the most likely programs. Takes some minutes on one CPU core.
"""

from __future__ import annotations

from dataclasses import dataclass

from lilgym_mp.envs.config import CORPUS_HELP
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import RunOptions, setting
from lilgym_mp.learning.parsing.recipe import ParserRecipe


@dataclass(frozen=True, slots=True)
class ParserOptions(RunOptions):
    """The options of a parser's run besides its recipe, which has its budget."""

    corpus: str = setting("builtin", CORPUS_HELP, metavar="CORPUS")


LEARNER = Learner(
    ParserRecipe,
    ParserOptions,
    "lilgym_mp.learning.parsing.training:train_parser",
    config=None,
    directory="{learner}",
)
