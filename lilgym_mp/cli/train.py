"""Train an agent, or resume its training.

Trains an agent. Ctrl-C saves a checkpoint and exits; --resume continues from it.
"""

from __future__ import annotations

from argparse import ArgumentParser
from functools import partial

from lilgym_mp.cli import training
from lilgym_mp.cli.options import help_of
from lilgym_mp.learning.common.learners import LEARNERS, find_learner


def add_options(parser: ArgumentParser, only: str | None = None) -> None:
    """A command for each learner, or for `only` one."""
    learners = parser.add_subparsers(dest="learner", metavar="LEARNER", required=True)
    for name in [only] if only in LEARNERS else LEARNERS:
        learner = find_learner(name)
        command = learners.add_parser(name, **help_of(learner.text))
        training.add_options(command, name, learner)
        command.set_defaults(run=partial(training.train, name=name, learner=learner))
