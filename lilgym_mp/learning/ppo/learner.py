"""Proximal policy optimisation, from rewards.

Trains an agent with proximal policy optimisation, from rewards (by default also from programs, to exchange colours;
--no-recolour for rewards alone). Ctrl-C saves a checkpoint and exits.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.evaluation import options
from lilgym_mp.evaluation.options import given_options
from lilgym_mp.evaluation.policies import GREEDY, SAMPLED
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.learning.common.commands import add_recipe, interrupted, new_run, resumed_run
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.ppo.recipe import DEFAULT_RECIPE, RECIPES, REPORTED_PARAMETERS, PPORecipe, make_recipe

if TYPE_CHECKING:
    from lilgym_mp.learning.ppo.training import Progress as TrainingProgress
    from lilgym_mp.learning.ppo.training import Run

DEFAULT_STEPS = 1_000_000


def add_options(parser: argparse.ArgumentParser) -> None:
    options.add_configuration(parser, nargs="?")
    options.add_run_directory(parser, "CONFIGURATION")
    parser.add_argument(
        "--steps", type=int, metavar="N", help=f"environment steps (default: the resumed run's, or {DEFAULT_STEPS})"
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
        help="directory of pretrained weights: config.json, model.safetensors and tokenizer",
    )
    options.add_number(parser, "--save-every", 100_000, "steps between checkpoints")
    parser.add_argument(
        "--evaluate-every",
        type=int,
        metavar="N",
        help="steps between evaluations on dev, for learning curves (default: no evaluations)",
    )
    options.add_device(parser)
    options.add_settings(parser)
    add_recipe(parser, PPORecipe, defaults_of=DEFAULT_RECIPE)


def train(args: argparse.Namespace) -> int:
    from lilgym_mp.learning.common.run_directory import AGENT_FILE
    from lilgym_mp.learning.ppo.training import train_ppo

    options.check_at_least(args, 1, "steps", "save_every", "evaluate_every", "threads")
    directory, arguments = _resume_arguments(args) if args.resume else _new_arguments(args)
    options.fill_options(args, arguments.pop("options", {}), {"steps": DEFAULT_STEPS, "evaluate_every": None})
    with Progress(args.steps, "steps", None, doing="ppo: preparing data") as bar:

        def show(update: TrainingProgress) -> None:
            accuracy = "-" if update.accuracy is None else f"{100 * update.accuracy:.0f} %"
            bar.reach(update.steps, f"{update.steps_per_second:,.0f} steps/s, training accuracy {accuracy}")

        shared = given_options(args, ["steps", "device", "resume", "save_every", "evaluate_every", "threads"])
        agent = train_ppo(out=directory, on_begin=_introduce, on_progress=show, **shared, **arguments)
    details = agent.description.details
    print(f"saved {directory / AGENT_FILE} after {details['steps']:,} steps, {details['cpu_minutes']:g} CPU minutes")
    if details["interrupted"]:
        return interrupted("ppo", directory)
    if details["validation_accuracy"] is not None:
        accuracy, steps = 100 * details["validation_accuracy"], details["validation_steps"]
        print(f"best checkpoint: after {steps:,} steps, with a validation accuracy of {accuracy:.1f} %")
    print(f"evaluate it with: lilgym-mp evaluate {directory} --corpus {arguments['settings'].corpus}")
    return 0


def _new_arguments(args: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    directory, settings = new_run(args)
    name = args.recipe or DEFAULT_RECIPE
    recipe = make_recipe(name, args.configuration, **given_options(args, PPORecipe.names()))
    return directory, {"settings": settings, "recipe": recipe, "recipe_name": name, "weights": args.weights}


def _resume_arguments(args: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    given = {"recipe_name": args.recipe, "weights": args.weights and str(args.weights)}
    required = {name: value for name, value in given.items() if value}
    run, settings, recipe = resumed_run(args, "ppo", PPORecipe, **required)
    name, weights = run.identity["recipe_name"], run.identity["weights"]
    arguments = {"settings": settings, "recipe": recipe, "recipe_name": name, "weights": weights and Path(weights)}
    return run.path, {**arguments, "options": run.options}


def _introduce(run: Run) -> None:
    """Prints the run's settings."""
    recipe, model, steps = run.recipe, run.model, run.counters.steps
    resumed = f", resumed after {steps:,}" if steps else ""
    frozen = f" and {model.frozen_parameters:,} frozen" if model.frozen_parameters else ""
    reported = REPORTED_PARAMETERS.get(recipe.model)
    print(
        f"{run.configurations[0]}, corpus {run.tasks.tasks.provenance.corpus}, {len(run.tasks.tasks):,} training"
        f" tasks, {len(run.tasks.validation):,} for validation; {run.budget.amount:,} steps{resumed}\n"
        f"model {recipe.model}: {model.trained_parameters:,} trained parameters{frozen}"
        f"{'' if reported is None else f' ({reported})'}; {'PPO+SF' if recipe.stop_forcing else 'PPO'},"
        f" {'a' if recipe.mask else 'no'} mask of legal actions, seed {recipe.seed}\n"
        f"run directory: {run.files.path}",
        flush=True,
    )


def _recipe(configuration: str, options: dict[str, Any]) -> PPORecipe:
    name = options.pop("recipe", DEFAULT_RECIPE)
    return make_recipe(name, configuration, **{key: value for key, value in options.items() if key != "weights"})


LEARNER = Learner(
    add_options=add_options,
    train=train,
    recipe=PPORecipe,
    make_recipe=_recipe,
    budget=lambda options: ("steps", options["steps"]),
    progress=("accuracy", "success rate of training episodes"),
    numbers={"steps": DEFAULT_STEPS, "evaluate_every": None},
    texts=("recipe", "weights"),
    action_modes=(GREEDY, SAMPLED),  # the most probable first action may be STOP
)
