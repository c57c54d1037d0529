"""Explain a statement, a task or a program.

Shows the programs that the parse-and-plan agent finds for a statement, with their probabilities and truth values, and
its plan. With --program, checks a program, and shows the value of each of its parts in the start scene of a task, or in
scenes in which it is true and false.
"""

from __future__ import annotations

import csv
import io
import json
import random
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING

from lilgym_mp.cli.options import (
    JSON,
    CommandError,
    add_device,
    add_flag,
    add_settings,
    check_at_least,
    given_environment,
    task_sets_with_id,
)
from lilgym_mp.corpus.records import SPLITS, STARTS, read_text
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import configuration_name, read_configuration
from lilgym_mp.evaluation.episodes import scenes
from lilgym_mp.evaluation.terminal import Progress, hanging, shows_colours
from lilgym_mp.programs import ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.programs.tracing import explain_program, trace
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.render.characters import ruled, text

if TYPE_CHECKING:
    from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent
    from lilgym_mp.learning.parsing.parser import Parse

DEFAULT_AGENT = "parse-and-plan"  # shipped with the package
DEFAULT_CONFIGURATION = "TowerScratch"
SENTENCE_COLUMNS = ("sentence", "statement")  # of a CSV file, the first that it has


def add_options(parser: ArgumentParser) -> None:
    """Adds the options of `lilgym-mp explain`."""
    parser.add_argument("statement", nargs="?", metavar="STATEMENT", help="such as 'There is a blue block.'")
    parser.add_argument(
        "--task", metavar="ID", help="task that provides the start scene, the target and, by default, the statement"
    )
    parser.add_argument("--split", choices=list(SPLITS), help="split of the task (default: any)")
    parser.add_argument(
        "--configuration", metavar="NAME", help=f"configuration (default: {DEFAULT_CONFIGURATION}, or the task's)"
    )
    parser.add_argument(
        "--false", dest="target", action="store_false", help="without --task: make the statement false instead of true"
    )
    parser.add_argument(
        "--agent",
        type=Path,
        default=Path(DEFAULT_AGENT),
        metavar="RUN",
        help=f"run directory, or name of a shipped agent (default: {DEFAULT_AGENT})",
    )
    parser.add_argument(
        "--file",
        type=Path,
        metavar="FILE",
        help="parse every statement of a text file, one a line, or of the column sentence or statement of a CSV file;"
        " needs --json",
    )
    add_flag(parser, "--json", "with --file: print words, corrections and candidate programs as JSON")
    program = parser.add_argument_group("programs")
    program.add_argument(
        "--program",
        nargs="?",
        const="",
        metavar="PROGRAM",
        help="explain this expression, such as 'exist(filter_obj(all_items, is_blue))' (default: the task's program)",
    )
    add_device(parser)
    add_settings(parser)


def run(args: Namespace) -> int:
    """Prints how an agent reads a statement and plans for it, or how a program evaluates on a scene."""
    if args.program is not None:
        return _explain_program(args)
    import torch

    from lilgym_mp.learning.common.agents import open_agent
    from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent
    from lilgym_mp.learning.parsing.planning import explanation_lines

    if args.json != (args.file is not None) or (args.json and (args.statement is not None or args.task is not None)):
        raise CommandError("--file needs --json, and --json --file; neither goes with a statement or --task")
    if args.statement is None and args.task is None and args.file is None:
        raise CommandError("name a statement, a task with --task, a program with --program, or --file FILE --json")
    check_at_least(args, 1, "threads")
    torch.set_num_threads(args.threads)
    agent = open_agent(args.agent, args.device)
    if not isinstance(agent, ParseAndPlanAgent):
        raise CommandError(f"{args.agent} is of kind {agent.description.kind}; explain needs a {DEFAULT_AGENT} agent")
    if args.json:
        return _print_parses(agent, args)
    settings, task = _settings_and_task(args)
    planner = agent.planner(settings)
    statement = args.statement if args.statement is not None else task.statement
    find = planner.short_plan if args.task is None else planner.plan
    plan = find(task.start, statement, task.target)
    width = get_terminal_size((100, 24)).columns
    print("\n".join(hanging(line, width) for line in explanation_lines(plan, planner, statement, task.target)))
    *edits, _ = plan.actions
    captions = ["start", *(f"{index}. {describe(action)}" for index, action in enumerate(edits, start=1))]
    for scene, caption in zip(scenes(planner.dynamics, plan.scene, edits), captions, strict=True):
        print(f"\n{caption}\n{ruled(text(scene, [], coloured=shows_colours()), planner.dynamics.appearance.grid)}")
    if args.task is not None and args.statement is None:
        outcome = str(planner.outcome(plan, task)).replace("_", " ")
        print(f"outcome: {outcome} (the task's program: {task.program})")
    return 0


def _print_parses(agent: ParseAndPlanAgent, args: Namespace) -> int:
    """Prints a JSON array with an object for each statement, as soon as it is parsed."""
    settings = EnvConfig(args.configuration or DEFAULT_CONFIGURATION, **given_environment(args))
    sentences = list(_sentences(args.file))
    appearance = agent.planner(settings).dynamics.appearance.name
    with Progress(len(sentences), "statements") as progress:
        for index, (place, statement) in enumerate(sentences):
            found = {"words": [], "corrections": {}, "unknown": [], "uncertain": [], "programs": []}
            if statement.strip():
                found = _parse_json(agent.parser.parse(statement, appearance))
            line = json.dumps({**place, "statement": statement, **found}, ensure_ascii=False)
            print(f"{',' if index else '['}{line}", flush=True)
            progress.advance()
    print("]" if sentences else "[]")
    return 0


def _parse_json(parse: Parse) -> JSON:
    return {
        "words": parse.words[1:],
        "corrections": parse.corrections,
        "unknown": parse.unknown,
        "uncertain": parse.uncertain,
        "programs": [
            {"program": found.program, "probability": round(found.probability, 4)} for found in parse.candidates
        ],
    }


def _sentences(path: Path) -> Iterator[tuple[JSON, str]]:
    """The statements with their lines, blank ones too; of a CSV file with their ids. Raises CommandError."""
    content, _ = read_text(path)
    if path.suffix.lower() != ".csv":
        for number, line in enumerate(content.removesuffix("\n").split("\n"), start=1):
            yield {"line": number}, line.removesuffix("\r")
        return
    reader = csv.reader(io.StringIO(content, newline=""), strict=True)
    try:
        header = [name.strip().lower() for name in next(filter(None, reader))]
        column = next((header.index(name) for name in SENTENCE_COLUMNS if name in header), None)
        if column is None:
            raise CommandError(f"{path}: no column {' or '.join(SENTENCE_COLUMNS)} in its header {', '.join(header)}")
        before = reader.line_num
        for row in reader:
            cells = dict(zip(header, row, strict=False))
            name = {"id": cells["id"]} if "id" in cells else {}
            yield {"line": before + 1, **name}, row[column] if len(row) > column else ""
            before = reader.line_num
    except csv.Error as error:
        raise CommandError(f"{path}, line {reader.line_num}: {error}") from None


def _settings_and_task(args: Namespace) -> tuple[EnvConfig, Task]:
    """The environment and task to plan for. Without --task, the start scene is empty."""
    options = given_environment(args)
    if args.task is None:
        settings = EnvConfig(args.configuration or DEFAULT_CONFIGURATION, **options)
        start = settings.dynamics().appearance.check_scene(Scene.empty())
        return settings, Task("asked", args.statement, "True", args.target, start)
    chosen = read_configuration(args.configuration) if args.configuration else (None, None)
    choices = zip((*chosen, args.split), (APPEARANCES, STARTS, SPLITS), strict=True)
    found = [[value] if value else list(values) for value, values in choices]
    tasks, *_ = task_sets_with_id(options.get("corpus", "builtin"), args.task, *found)
    name = configuration_name(tasks.provenance.appearance, tasks.provenance.start)
    return EnvConfig(name, **options), tasks.by_id(args.task)


def _explain_program(args: Namespace) -> int:
    """Prints the program's words or its error, and the value of each part in the task's start scene, or in others."""
    task = None if args.task is None else _settings_and_task(args)[1]
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


def _labelled_scenes(source: str, args: Namespace) -> Iterator[tuple[Scene, str]]:
    """Scenes with their titles. Says so if the program is true, or false, in all scenes that were tried."""
    from lilgym_mp.corpus.synthesis import start_scenes

    empty = None
    with suppress(ProgramRuntimeError):
        empty = (Scene.empty(), compile_program(source).evaluate(Scene.empty()))
    appearance, _ = read_configuration(args.configuration or DEFAULT_CONFIGURATION)
    found = start_scenes(source, appearance, random.Random(0), 2)
    if empty is not None and empty[1] not in {label for _, label in found}:
        found = (*found[1:], empty)
    for scene, label in found:
        yield scene, f"{str(label).lower()} in this scene"
    for missing in {True, False} - {label for _, label in found}:
        print(f"note: no {appearance} scene was found in which it is {str(missing).lower()}")
