"""The command `train` of every learner. Imports no torch."""

from __future__ import annotations

import shlex
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

from lilgym_mp.cli import options
from lilgym_mp.cli.options import CommandError, add_flag, given_options
from lilgym_mp.envs.config import COARSE_GRID_HELP, EnvConfig
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.files import read_lines
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.run_directory import PROGRESS_FILE, RUN_FILE, TrainingRunError, begin_run, check_same
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.choices import choose


def add_options(parser: ArgumentParser, name: str, learner: Learner) -> None:
    """The options of the command that trains with this learner."""
    if learner.config is not None:
        options.add_configuration(parser, nargs="?")
    default = learner.directory.format(learner=name, configuration="CONFIGURATION")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"run directory (default: {options.RUNS}/{default})")
    add_flag(parser, "--resume", "continue the run in that directory")
    options.add_fields(parser, learner.options.settings())
    options.add_device(parser)
    add_flag(
        parser,
        "--tensorboard",
        "also write the numbers of progress.jsonl for TensorBoard, to the directory tensorboard of the run",
    )
    if learner.config is not None:
        options.add_settings(parser, learner.config, {"grid": COARSE_GRID_HELP})
    options.add_fields(parser.add_argument_group("recipe"), learner.recipe.settings(), _varying_defaults(learner))


def _varying_defaults(learner: Learner) -> dict[str, str]:
    """The help of the recipe's settings whose defaults depend on the appearance or the start."""
    known = learner.recipe.by_appearance
    parts = {name: split for name, split in CONFIGURATIONS.items() if not known or split[0] in known}
    recipes = {split: learner.recipe.of(name) for name, split in parts.items()}
    texts: dict[str, str] = {}
    for each in learner.recipe.settings():
        for index in range(2):  # by appearance, else by start
            values = {(split[index], getattr(recipe, each.name)) for split, recipe in recipes.items()}
            found = dict(values)
            if len(found) == len(values) and len(set(found.values())) > 1:
                shown = ", ".join(f"{found[name]:g} in {name}" for name in sorted(found))
                texts[each.name] = f"{each.metadata['description']} (default: {shown})"
    return texts


def train(args: Namespace, name: str, learner: Learner) -> int:
    """Trains as the options say, and returns the exit code. Raises CommandError, ValueError."""
    options.check_at_least(args, 1, "threads")
    settings, recipe, own, directory = requested(args, name, learner)
    arguments = {option: getattr(own, option) for option in own.names()}
    if learner.check is not None:
        learner.check(settings, recipe)
    unit, total = learner.budget(recipe, own)
    board: Callable[[], Any] | None = None
    if args.tensorboard:
        board = cache(partial(_board, _summary_writer(), directory, unit if args.resume else None))  # made when used

    def report(line: Any) -> None:
        bar.reach(getattr(line, unit), line.note)
        if board is None:
            return
        for name, value in line._asdict().items():
            if isinstance(value, int | float):
                board().add_scalar(name, value, getattr(line, unit))

    with Progress(int(total), unit, None if args.resume else 0, doing=f"{name}: preparing data") as bar:
        try:
            learner.train(
                *([] if settings is None else [settings]),
                recipe=recipe,
                out=directory,
                device=args.device,
                threads=args.threads,
                resume=args.resume,
                say=lambda text: print(text, flush=True),
                on_progress=report,
                **arguments,
            )
        except KeyboardInterrupt:
            if not (directory / RUN_FILE).exists():
                raise
            print(f"interrupted; resume with: lilgym-mp train {name} --resume --out {shlex.quote(str(directory))}")
            return options.INTERRUPTED
    given = settings.single().options() if isinstance(settings, EnvConfig) else ["--corpus", (settings or own).corpus]
    print(f"evaluate it with: lilgym-mp evaluate {shlex.join([str(directory), *given])}")
    return 0


def _summary_writer() -> Any:
    """The class that writes TensorBoard's files. Raises CommandError without TensorBoard."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ModuleNotFoundError as error:
        raise CommandError(f"--tensorboard needs {error.name}: pip install {error.name}") from None
    return SummaryWriter


def _board(writer: Any, directory: Path, resumed_unit: str | None) -> Any:
    """TensorBoard's writer; of a resumed run, it discards what was written after the checkpoint."""
    step = None
    if resumed_unit is not None:
        kept = read_lines(directory / PROGRESS_FILE)[:-1]  # without the line that is being reported
        step = kept[-1][resumed_unit] + 1 if kept else 0
    return writer(directory / "tensorboard", purge_step=step)


def requested(args: Namespace, name: str, learner: Learner) -> tuple[Any, Any, Any, Path]:
    """The environment, recipe, options and directory of the run that the options ask for. Raises as `train`."""
    given = given_options(args, learner.options.names())
    changes = given_options(args, learner.recipe.names())
    environment: AnyDict = {}
    if learner.config is not None:
        environment = given_options(args, ["configuration", *learner.config.settings()])
        if args.configuration is not None:
            choose("configuration", args.configuration, CONFIGURATIONS)
        elif not args.resume:
            raise CommandError(f"name a configuration to train on; choose from {', '.join(CONFIGURATIONS)}")
        elif args.out is None:
            raise CommandError("name what to resume: --out DIR, or a configuration")
    default = learner.directory.format(learner=name, configuration=environment.get("configuration"))
    directory = args.out or options.RUNS / default
    if args.resume:
        return *resumed(directory, name, learner, environment, changes, given), directory
    settings = None if learner.config is None else learner.config(**environment)
    recipe = learner.recipe.of(environment.get("configuration", ""), given.get("recipe_name"), **changes)
    return settings, recipe, learner.options(**given), directory


def resumed(path: Path, name: str, learner: Learner, *given: AnyDict) -> tuple[Any, Any, Any]:
    """The environment, recipe and options of the run in a directory.

    `given`: what was requested of each, which must be the run's, except options that are no part of its identity.
    Raises TrainingRunError naming both values otherwise.
    """
    run = begin_run(path, {"learner": name}, resume=True)
    try:
        saved = run.identity.get("environment", run.identity.get("game", {}))
        settings = None if learner.config is None else learner.config.from_json(saved)
        recipe = learner.recipe.from_json(run.identity["recipe"])
        fixed = learner.options.remembered(run.identity)
        own = learner.options(**{**learner.options.remembered(run.options), **fixed, **given[-1]})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise TrainingRunError(f"{path / RUN_FILE}: cannot be used: {error}") from None
    environment = {} if settings is None else {"configuration": settings.configuration, **settings.values()}
    for known, requested in zip((environment, recipe.to_json(), fixed), given, strict=True):
        check_same(path, known, {key: value for key, value in requested.items() if key in known})
    return settings, recipe, own
