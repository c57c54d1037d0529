"""`lilgym-mp train LEARNER`: one module per learner, each with `add_parser(learners)`."""

from __future__ import annotations

from typing import Any

from lilgym_mp.cli import train_imitation, train_parse_and_plan, train_ppo


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "train",
        help="train an agent, or resume its training",
        description="Trains an agent. Ctrl-C saves a checkpoint and exits; --resume continues from it.",
    )
    learners = parser.add_subparsers(dest="learner", metavar="LEARNER", required=True)
    for module in (train_parse_and_plan, train_imitation, train_ppo):
        module.add_parser(learners)
