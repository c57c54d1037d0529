"""`lilgym-mp train ppo`: proximal policy optimisation from rewards alone."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.choices import choose
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import (
    INTERRUPTED,
    RUNS,
    add_configuration,
    add_device,
    add_recipe,
    add_settings,
    option,
    said,
    said_settings,
)
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.ppo.recipe import CHOICES, DEFAULT_RECIPE, DESCRIPTIONS, RECIPES, PPORecipe, make_recipe
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.ppo.training import Progress as TrainingProgress
    from lilgym_mp.learning.ppo.training import Run

DEFAULT_STEPS = 1_000_000


def add_parser(learners: Any) -> None:
    parser = learners.add_parser(
        "ppo",
        help="proximal policy optimisation, from rewards alone",
        description="Train an agent with proximal policy optimisation, from rewards alone. Ctrl-C saves and ends.",
    )
    add_configuration(parser, nargs="?", help=f"one of {', '.join(CONFIGURATIONS)}")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"the run's directory (default: {RUNS}/CONFIGURATION)")
    parser.add_argument("--resume", action="store_true", help="go on with the run in that directory")
    parser.add_argument(
        "--steps", type=int, default=DEFAULT_STEPS, metavar="N", help="actions in all (default: %(default)s)"
    )
    parser.add_argument(
        "--recipe",
        metavar="NAME",
        help=f"{', '.join(sorted(RECIPES))}, or a TOML file of settings (default: {DEFAULT_RECIPE})",
    )
    parser.add_argument(
        "--weights",
        type=Path,
        metavar="DIR",
        help="pretrained weights: config.json, model.safetensors, tokenizer; or the run that `imitation` begins from",
    )
    parser.add_argument(
        "--save-every", type=int, default=100_000, metavar="N", help="steps between checkpoints (default: %(default)s)"
    )
    parser.add_argument(
        "--evaluate-every",
        type=int,
        metavar="N",
        help="steps between evaluations on dev, for learning curves (default: none)",
    )
    add_device(parser)
    add_settings(parser)
    add_recipe(parser, PPORecipe, choices=CHOICES, defaults_of=DEFAULT_RECIPE)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.learning.agents import AGENT_FILE
    from lilgym_mp.learning.ppo.training import train_ppo

    for name in ("steps", "save_every", "evaluate_every", "threads"):
        if (value := getattr(args, name)) is not None and value < 1:
            raise CommandError(f"--{option(name)} must be at least 1, not {value}")
    place, arguments = _resumed(args) if args.resume else _begun(args)
    with _Display(args.steps, place) as display:
        agent = train_ppo(
            out=place,
            steps=args.steps,
            device=args.device,
            resume=args.resume,
            save_every=args.save_every,
            evaluate_every=args.evaluate_every,
            threads=args.threads,
            on_begin=display.begin,
            on_progress=display,
            **arguments,
        )
    details = agent.description.details
    print(f"saved {place / AGENT_FILE} after {details['steps']:,} steps, {details['cpu_minutes']:g} CPU minutes")
    if details["interrupted"]:
        print(f"interrupted; go on with: lilgym-mp train ppo --resume --out {place} --steps {args.steps}")
        return INTERRUPTED
    if details["validation_accuracy"] is not None:
        share, steps = 100 * details["validation_accuracy"], details["validation_steps"]
        print(f"the agent is the one after {steps:,} steps, with {share:.1f} % of the tasks held out from train")
    print(f"evaluate it with: lilgym-mp evaluate {place} --corpus {arguments['settings'].corpus}")
    return 0


def _begun(args: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    if args.configuration is None:
        raise CommandError(f"name a configuration to train on; choose from {', '.join(CONFIGURATIONS)}")
    choose("configuration", args.configuration, CONFIGURATIONS)
    name = args.recipe or DEFAULT_RECIPE
    return args.out or RUNS / args.configuration, {
        "settings": Settings(**said_settings(args)),
        "recipe": make_recipe(name, args.configuration, **said(args, list(DESCRIPTIONS))),
        "recipe_name": name,
        "weights": args.weights,
    }


def _resumed(args: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    from lilgym_mp.learning.ppo.training import saved_arguments

    if args.out is None and args.configuration is None:
        raise CommandError("name what to resume: --out DIR, or a configuration")
    place = args.out or RUNS / args.configuration
    asked = {
        **({"recipe_name": args.recipe} if args.recipe else {}),
        **({"weights": str(args.weights)} if args.weights else {}),
        "environment": said_settings(args),
        "recipe": said(args, list(DESCRIPTIONS)),
    }
    return place, saved_arguments(place, asked)


class _Display:
    """Says what is trained, once it is known, then shows each update. A context manager."""

    def __init__(self, steps: int, place: Path) -> None:
        self._steps, self._place = steps, place
        self._progress: Progress | None = None

    def __enter__(self) -> _Display:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._progress is not None:
            self._progress.__exit__(*exception)

    def begin(self, run: Run) -> None:
        recipe, model = run.recipe, run.model
        origin = f", after {run.steps:,} before" if run.steps else ""
        frozen = f" and {model.frozen_parameters:,} that stay as they are" if model.frozen_parameters else ""
        print(
            f"{run.configurations[0]}, corpus {run.tasks.tasks.provenance.corpus}, {len(run.tasks.tasks):,} training"
            f" tasks, {len(run.tasks.validation):,} for validation; {self._steps:,} steps{origin}\n"
            f"model {recipe.model}: {model.trained_parameters:,} trained parameters{frozen}{run.reported_parameters()};"
            f" {'PPO+SF' if recipe.stop_forcing else 'PPO'}, {'a' if recipe.mask else 'no'} mask of legal actions,"
            f" seed {recipe.seed}\n"
            f"run directory: {self._place}",
            flush=True,
        )
        self._progress = Progress(self._steps, "steps", run.steps)

    def __call__(self, update: TrainingProgress) -> None:
        if self._progress is not None:
            accuracy = "-" if update.accuracy is None else f"{100 * update.accuracy:.0f} %"
            note = f"{update.steps_per_second:,.0f} a second, training accuracy {accuracy}"
            self._progress.reach(update.steps, note)
