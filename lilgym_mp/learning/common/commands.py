"""What the commands of learners share. Imports no torch."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.evaluation import options
from lilgym_mp.evaluation.options import CommandError, flag_name, given_options, given_settings
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.learning.common.recipes import Recipe
from lilgym_mp.learning.common.run_directory import AGENT_FILE
from lilgym_mp.scene.choices import choose

if TYPE_CHECKING:
    from lilgym_mp.learning.common.run_directory import RunDirectory


def add_recipe(parser: argparse.ArgumentParser, recipe: type[Recipe], *, defaults_of: str | None = None) -> None:
    """An option for each setting of a recipe. `defaults_of`: name of the recipe that the defaults belong to."""
    origin = "" if defaults_of is None else f" in {defaults_of}"
    group = parser.add_argument_group("recipe")
    for setting in recipe.settings():
        default, kind = setting.default, {"type": type(setting.default), "metavar": "N"}
        shown = default if isinstance(default, str) else f"{default:g}"
        if isinstance(default, bool):
            shown, kind = "on" if default else "off", {"action": argparse.BooleanOptionalAction, "default": None}
        elif isinstance(default, str):
            kind = {"choices": setting.metadata["choices"]}
        description = f"{setting.metadata['description']} (default: {shown}{origin})"
        group.add_argument(f"--{flag_name(setting.name)}", help=description, **kind)


def new_run(args: argparse.Namespace, prefix: str = "") -> tuple[Path, Settings]:
    """The directory and the environment of a run to begin. Raises CommandError, ValueError."""
    if args.configuration is None:
        raise CommandError(f"name a configuration to train on; choose from {', '.join(CONFIGURATIONS)}")
    choose("configuration", args.configuration, CONFIGURATIONS)
    return args.out or options.RUNS / f"{prefix}{args.configuration}", Settings(**given_settings(args))


def resumed_run(
    args: argparse.Namespace, learner: str, recipe: type[Recipe], prefix: str = "", **required: Any
) -> tuple[RunDirectory, Settings, Any]:
    """The run to be resumed, its environment and its recipe.

    `required`: further values its identity must have. Raises CommandError, TrainingRunError.
    """
    from lilgym_mp.learning.common.run_directory import resumable_run

    if args.out is None and args.configuration is None:
        raise CommandError("name what to resume: --out DIR, or a configuration")
    given = {"environment": given_settings(args), "recipe": given_options(args, recipe.names())}
    directory = args.out or options.RUNS / f"{prefix}{args.configuration}"
    run, settled = resumable_run(directory, {"learner": learner, **given, **required}, recipe)
    return run, Settings.from_json(run.identity["environment"]), settled


def interrupted(learner: str, directory: Path) -> int:
    """Says how to go on; returns the exit code."""
    print(f"interrupted; resume with: lilgym-mp train {learner} --resume --out {directory}")
    return options.INTERRUPTED


@dataclass(frozen=True)
class TimedCommand:
    """The command of a learner whose budget is counted in updates of its optimiser."""

    learner: str
    recipe: type[Recipe]
    default_recipe: Callable[..., Any]  # of an appearance and changed settings
    trainer: str  # "module:function", called with settings, recipe and directory
    updates: int  # default budget
    note: Callable[[Any], str]  # shown beside the progress bar, made from a line of progress.jsonl
    paths: Mapping[str, str] = field(default_factory=dict[str, str])  # further options of the trainer, with their help

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        options.add_configuration(parser, nargs="?")
        options.add_run_directory(parser, f"{self.learner}-CONFIGURATION")
        options.add_budget(parser, "updates", self.updates, "updates of the optimiser")
        parser.add_argument("--seed", type=int, metavar="N", help="random seed of network and data (default: 0)")
        for name, description in self.paths.items():
            parser.add_argument(f"--{name}", type=Path, metavar="RUN", help=description)
        options.add_device(parser)
        options.add_settings(parser)
        add_recipe(parser, self.recipe)

    def train(self, args: argparse.Namespace) -> int:
        import torch

        options.check_budget(args, "updates")
        options.check_at_least(args, 0, "seed")
        options.check_at_least(args, 1, "threads")
        torch.set_num_threads(args.threads)
        prefix, remembered = f"{self.learner}-", {}
        if args.resume:
            seed = given_options(args, ["seed"])
            run, settings, recipe = resumed_run(args, self.learner, self.recipe, prefix, **seed)
            directory, remembered = run.path, {**run.options, **run.identity}
        else:
            directory, settings = new_run(args, prefix)
            recipe = self.default_recipe(settings.appearance, **given_options(args, self.recipe.names()))
        options.fill_options(
            args, remembered, {"updates": self.updates, "minutes": None, "seed": 0, **dict.fromkeys(self.paths)}
        )
        module, function = self.trainer.split(":")
        budget = given_options(args, ["updates", "minutes", "seed", "device", "resume"])
        paths = {name: Path(given) for name in self.paths if (given := getattr(args, name)) is not None}
        try:
            with Progress(
                args.updates, "updates", None if args.resume else 0, doing=f"{self.learner}: preparing data"
            ) as bar:
                getattr(import_module(module), function)(
                    settings,
                    recipe,
                    directory,
                    on_progress=lambda line: bar.reach(line.updates, self.note(line)),
                    **budget,
                    **paths,
                )
        except KeyboardInterrupt:
            return interrupted(self.learner, directory)
        print(f"saved {directory / AGENT_FILE}")
        print(f"evaluate it with: lilgym-mp evaluate {directory} --corpus {settings.corpus}")
        return 0
