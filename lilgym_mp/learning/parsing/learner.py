"""An agent that parses statements into programs and plans with them.

Trains one agent for all configurations of a corpus: it learns to parse statements into programs, reads scenes from
pixels, and plans for the most likely programs. Takes some minutes on one CPU core.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lilgym_mp.corpus.locations import fixed_name
from lilgym_mp.envs.config import CORPUS_HELP
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import PairRecipe, RunOptions, setting


@dataclass(frozen=True)
class ParserRecipe(PairRecipe):
    """Everything the parser's training depends on, except its corpus."""

    seed: int = setting(0, "seed of the network, the pairs and their order")
    updates: int = setting(6_000, "optimiser steps", 1)
    warm_up: int = setting(100, "updates of linear warm-up", 1, flag="warm_up_updates")
    dropout: float = setting(0.2, "dropout rate", 0, 1)
    generated_pairs: int = setting(40_000, "maximum number of distinct generated pairs", 1)
    held_out: int = setting(300, "training statements held out to calibrate probabilities", flag="held_out_statements")
    width: int = setting(96, "network width; a multiple of 4", 4)


@dataclass(frozen=True, slots=True)
class ParserOptions(RunOptions):
    """The options of a parser's run besides its recipe, which has its budget."""

    corpus: str = setting("builtin", CORPUS_HELP, kind=fixed_name, metavar="CORPUS")


def _train(*arguments: Any, **options: Any) -> Any:
    from lilgym_mp.learning.parsing.training import train_parser

    return train_parser(*arguments, **options)


def _load_agent(path: Path, device: str) -> Any:
    from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent

    return ParseAndPlanAgent.load(path, device)


LEARNER = Learner(ParserRecipe, ParserOptions, _train, _load_agent, __doc__, config=None, directory="{learner}")
