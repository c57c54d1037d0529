"""`lilgym-mp program`: what is wrong with a program, and how it comes to its value in a scene."""

from __future__ import annotations

import argparse
from typing import Any

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import task_with_id
from lilgym_mp.programs import ProgramError, compile_program, explain_program


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("program", help="check a program of the program language, or run it in a scene")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="say whether a program compiles, or where and why not")
    check.add_argument("source", help="one expression, such as 'exist(filter_obj(all_items, is_blue))'")
    check.set_defaults(run=run)
    running = actions.add_parser(
        "run",
        help="its truth in the start scene of a task, and which items satisfied what",
        description="Evaluates a program, or the task's own, in the start scene of a task, and shows the values of its "
        "parts and which items satisfied its conditions.",
    )
    running.add_argument("source", nargs="?", help="one expression (default: the task's own program)")
    running.add_argument("--task", required=True, metavar="ID", help="the task whose start scene is meant")
    running.add_argument(
        "--corpus", default="builtin", help='"builtin" (default), "lilgym" (the official one), or a path'
    )
    running.set_defaults(run=run_in_scene)


def run(args: argparse.Namespace) -> int:
    try:
        compile_program(args.source)
    except ProgramError:
        raise CommandError(explain_program(args.source)) from None
    print(explain_program(args.source))
    return 0


def run_in_scene(args: argparse.Namespace) -> int:
    from lilgym_mp.programs.tracing import trace
    from lilgym_mp.render import text
    from lilgym_mp.terminal import shows_colours

    task = task_with_id(args.corpus, args.task)
    source = task.program if args.source is None else args.source
    try:
        parts = trace(source, task.start)
    except ProgramError:
        raise CommandError(explain_program(source)) from None
    print(text(task.start, [f'"{task.statement}"'], coloured=shows_colours()))
    for part in parts:
        indent = "  " * part.depth
        print(f"{indent}{part.source}\n{indent}  = {part.value}")
    return 0
