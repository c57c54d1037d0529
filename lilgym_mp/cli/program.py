"""Check a program, or evaluate it in a scene."""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterator

from lilgym_mp.evaluation.options import CommandError, add_corpus, add_number, add_seed, check_at_least, task_with_id
from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program, explain_program
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import APPEARANCES


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
        help="evaluate a program in scenes where it holds and where it fails, or in the start scene of a task",
        description="Draws scenes in which a program is true and false, or evaluates it, by default the task's own, in "
        "the start scene of a task. Shows the value of each part and which items satisfied its conditions.",
    )
    evaluate.add_argument(
        "source", nargs="?", metavar="PROGRAM", help="one expression (default: the task's own program)"
    )
    evaluate.add_argument("--task", metavar="ID", help="task that provides the scene (default: random ones)")
    evaluate.add_argument(
        "--appearance", choices=list(APPEARANCES), default="tower", help="of random scenes (default: tower)"
    )
    add_number(evaluate, "--scenes", 2, "number of random scenes, half of them true if such are found")
    add_seed(evaluate, "of the random scenes")
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
    from lilgym_mp.evaluation.terminal import shows_colours
    from lilgym_mp.programs.tracing import trace
    from lilgym_mp.scene.render.characters import text

    task = None if args.task is None else task_with_id(args.corpus, args.task)
    source = args.source or (task and task.program)
    if source is None:
        raise CommandError("name a program, or a task with --task")
    try:
        compile_program(source)
    except ProgramError:
        raise CommandError(explain_program(source)) from None
    titled = [(task.start, f'"{task.statement}"')] if task is not None else _labelled_scenes(source, args)
    for scene, title in titled:
        print(text(scene, [title], coloured=shows_colours()))
        for part in trace(source, scene):
            indent = "  " * part.depth
            print(f"{indent}{part.source}\n{indent}  = {part.value}")
    return 0


def _labelled_scenes(source: str, args: argparse.Namespace) -> Iterator[tuple[Scene, str]]:
    """Scenes with their titles. Says so if the program is true, or false, in all scenes that were tried."""
    from lilgym_mp.corpus.synthesis import start_scenes

    check_at_least(args, 2, "scenes")
    check_at_least(args, 0, "seed")
    try:
        empty = (Scene.empty(), compile_program(source).evaluate(Scene.empty()))
    except ProgramRuntimeError as fault:
        raise CommandError(f"the program has no value on the empty scene: {fault}") from None
    found = start_scenes(source, args.appearance, random.Random(args.seed), args.scenes)
    if empty[1] not in {label for _, label in found}:
        found = (*found[1:], empty)
    for scene, label in found:
        yield scene, f"{str(label).lower()} in this scene"
    for missing in {True, False} - {label for _, label in found}:
        print(f"note: no {args.appearance} scene was found in which it is {str(missing).lower()}")
