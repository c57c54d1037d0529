"""Check a program, or evaluate it in a scene."""

from __future__ import annotations

import argparse

from lilgym_mp.options import CommandError, add_corpus, task_with_id
from lilgym_mp.programs import ProgramError, compile_program, explain_program


def add_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser(
        "check",
        help="compile a program, and show where and why it is wrong if it fails",
        description="Compiles a program and lists the words it uses, or shows where and why it is wrong.",
    )
    check.add_argument(
        "source", metavar="PROGRAM", help="one expression, such as 'exist(filter_obj(all_items, is_blue))'"
    )
    check.set_defaults(run=run)
    evaluate = actions.add_parser(
        "run",
        help="evaluate a program in the start scene of a task",
        description="Evaluates a program, by default the task's own, in the start scene of a task, and shows the value "
        "of each part and which items satisfied its conditions.",
    )
    evaluate.add_argument(
        "source", nargs="?", metavar="PROGRAM", help="one expression (default: the task's own program)"
    )
    evaluate.add_argument("--task", required=True, metavar="ID", help="task that provides the start scene")
    add_corpus(evaluate)
    evaluate.set_defaults(run=run_in_scene)


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
