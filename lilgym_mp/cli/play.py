"""Play in the terminal, alone or as an agent of the two-agent game.

Edit the scene until the statement has the target truth value, then stop; type help for the commands. With --protocol or
--as, play one agent or both of the game of a proposer and a verifier.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module

from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, PROTOCOLS
from lilgym_mp.evaluation.options import (
    add_configuration,
    add_settings,
    argument_type,
    given_settings,
    split_of,
)
from lilgym_mp.evaluation.terminal import shows_colours

SIDES = {"proposer": AGENTS[:1], "verifier": AGENTS[1:], "both": AGENTS}


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser, nargs="?", default="TowerScratch")
    parser.add_argument("--split", choices=list(SPLITS), help="split of the corpus (default: the task's, else dev)")
    parser.add_argument("--task", metavar="ID", help="begin with this task (default: a random one)")
    parser.add_argument("--seed", type=argument_type(int), metavar="N", help="random seed (default: not seeded)")
    game = parser.add_argument_group("two-agent game")
    game.add_argument("--protocol", choices=list(PROTOCOLS), help="of the game (default with --as: veto)")
    game.add_argument("--as", dest="side", choices=list(SIDES), help="agent to play (default: proposer)")
    game.add_argument(
        "--partner",
        metavar="NAME",
        help="scripted policy of the other agent, such as oracle, helpful, deceptive, random (default: oracle as "
        "verifier, helpful as proposer)",
    )
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    if args.protocol or args.side or args.partner:
        from lilgym_mp.cli.play_game import play_game

        return play_game(args)
    from lilgym_mp.cli.session import Session

    settings = EnvConfig(**given_settings(args))
    env = settings.make(split_of(settings, args.split, args.task))
    session = Session(env, print, coloured=shows_colours())
    try:
        session.begin(seed=args.seed, task_id=args.task)
        for line in input_lines():
            session.answer(line)
            if session.is_over:
                break
    except KeyboardInterrupt:
        print()
    print(session.score())
    return 0


def input_lines() -> Iterator[str]:
    """Lines of standard input until it ends, echoed unless it is a terminal, which gets line editing and a history."""
    with suppress(ImportError):  # importing it adds editing and a history to `input`
        import_module("readline")
    while True:
        try:
            line = input("> ")
        except EOFError:
            print()
            return
        if not sys.stdin.isatty():
            print(line)
        yield line
