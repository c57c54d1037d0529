"""`lilgym-mp program check SOURCE`: what is wrong with a program, for a person."""

from __future__ import annotations

import argparse
from typing import Any

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.programs import ProgramError, compile_program, explain_program


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("program", help="check a program of the program language")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="say whether a program compiles, or where and why not")
    check.add_argument("source", help="one expression, such as 'exist(filter_obj(all_items, is_blue))'")
    check.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    try:
        compile_program(args.source)
    except ProgramError:
        raise CommandError(explain_program(args.source)) from None
    print(explain_program(args.source))
    return 0
