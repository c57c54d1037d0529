"""`lilgym-mp train LEARNER`: the commands of all learners."""

from __future__ import annotations

from typing import Any

from lilgym_mp.learning.learners import PACKAGES, find_learner


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "train",
        help="train an agent, or resume its training",
        description="Trains an agent. Ctrl-C saves a checkpoint and exits; --resume continues from it.",
    )
    commands = parser.add_subparsers(dest="learner", metavar="LEARNER", required=True)
    for name in PACKAGES:
        learner = find_learner(name)
        command = commands.add_parser(name, help=learner.summary, description=learner.description)
        learner.add_options(command)
        command.set_defaults(run=learner.train)
