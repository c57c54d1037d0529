"""Shows what a program says of scenes, for `lilgym-mp explain --program`."""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterator

from lilgym_mp.envs.registration import read_configuration
from lilgym_mp.evaluation.options import CommandError, check_at_least, task_with_id
from lilgym_mp.evaluation.terminal import shows_colours
from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program, explain_program
from lilgym_mp.programs.tracing import trace
from lilgym_mp.scene import Scene
from lilgym_mp.scene.render.characters import text


def explain(args: argparse.Namespace) -> int:
    """Prints the program's words or its error, and the value of each part in the task's start scene, or in others."""
    task = None if args.task is None else task_with_id(args.corpus or "builtin", args.task)
    source = args.program or (task and task.program)
    if source is None:
        raise CommandError("name a program, or a task with --task")
    try:
        compile_program(source)
    except ProgramError:
        raise CommandError(explain_program(source)) from None
    print(explain_program(source))
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
    appearance, _ = read_configuration(args.configuration or "TowerScratch")
    found = start_scenes(source, appearance, random.Random(args.seed), args.scenes)
    if empty[1] not in {label for _, label in found}:
        found = (*found[1:], empty)
    for scene, label in found:
        yield scene, f"{str(label).lower()} in this scene"
    for missing in {True, False} - {label for _, label in found}:
        print(f"note: no {appearance} scene was found in which it is {str(missing).lower()}")
