"""Train an agent, or resume its training.

Trains an agent. Ctrl-C saves a checkpoint and exits; --resume continues from it.
"""

from __future__ import annotations

import argparse
from functools import partial

from lilgym_mp.evaluation.options import help_of
from lilgym_mp.learning.common import commands
from lilgym_mp.learning.common.learners import PACKAGES, find_learner


def add_options(parser: argparse.ArgumentParser, only: str | None = None) -> None:
    """A command for each learner, or for `only` one."""
    learners = parser.add_subparsers(dest="learner", metavar="LEARNER", required=True)
    for name in [only] if only in PACKAGES else PACKAGES:
        learner = find_learner(name)
        command = learners.add_parser(name, **help_of(f"{PACKAGES[name]}.learner"))
        commands.add_options(command, name, learner)
        command.set_defaults(run=partial(commands.train, name=name, learner=learner))
