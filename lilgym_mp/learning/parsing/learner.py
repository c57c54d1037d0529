"""The parse-and-plan agent as a learner, and its command."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from lilgym_mp.learning.learners import Learner
from lilgym_mp.learning.parsing.recipe import OBJECTIVES, RECIPE_DESCRIPTIONS, ParserRecipe
from lilgym_mp.options import (
    CORPUS_HELP,
    INTERRUPTED,
    RUNS,
    add_device,
    add_recipe,
    add_run_directory,
    add_save_every,
    check_at_least,
    fill_options,
    given_options,
)
from lilgym_mp.terminal import Progress

if TYPE_CHECKING:
    from lilgym_mp.learning.parsing.training import Progress as TrainingProgress

NAME = "parse-and-plan"


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--corpus", help=CORPUS_HELP)
    add_run_directory(parser, NAME)
    add_save_every(parser, 500)
    add_device(parser)
    add_recipe(parser, ParserRecipe, choices={"objective": OBJECTIVES})


def train(args: argparse.Namespace) -> int:
    import torch

    from lilgym_mp.learning.parsing.training import train_parser
    from lilgym_mp.learning.training_run import resumable_run

    check_at_least(args, 1, "threads", "save_every")
    torch.set_num_threads(args.threads)
    directory = args.out or RUNS / NAME
    given = given_options(args, list(RECIPE_DESCRIPTIONS))
    saved: Mapping[str, Any] = {}
    if args.resume:
        required = {"learner": NAME, **given_options(args, ["corpus"]), "recipe": given}
        run, recipe = resumable_run(directory, required, ParserRecipe)
        saved = run.identity
    else:
        recipe = ParserRecipe(**given)
    fill_options(args, saved, {"corpus": "builtin"})
    with _Display(recipe.steps, resumed=args.resume) as display:
        done = train_parser(
            args.corpus,
            recipe,
            directory,
            device=args.device,
            resume=args.resume,
            save_every=args.save_every,
            on_progress=display,
        )
    if not done.agent_file.exists():
        print(f"interrupted; resume with: lilgym-mp train {NAME} --resume --out {directory}")
        return INTERRUPTED
    print(
        f"saved {done.agent_file} ({done.agent_file.stat().st_size / 1e6:.1f} MB)\n"
        f"evaluate it with: lilgym-mp evaluate {directory} --corpus {args.corpus}\n"
        f'inspect it with: lilgym-mp explain "There is a blue block." --agent {directory}'
    )
    return 0


class _Display:
    """Shows the progress of a parser's training. A context manager."""

    def __init__(self, steps: int, *, resumed: bool) -> None:
        self._progress = Progress(steps, "steps", done=None if resumed else 0)

    def __enter__(self) -> _Display:
        return self

    def __exit__(self, *exception: object) -> None:
        self._progress.__exit__(*exception)

    def __call__(self, progress: TrainingProgress) -> None:
        note = f"loss {progress.loss:.3f}, {progress.cpu_seconds / 60:.1f} CPU minutes"
        self._progress.reach(progress.step, note)


LEARNER = Learner(
    summary="an agent that parses statements into programs and plans with them",
    description="Trains one agent for all configurations of a corpus: it learns to parse statements into programs, "
    "reads scenes from pixels, and plans for the most likely programs. Takes some minutes on one CPU core.",
    add_options=add_options,
    train=train,
    load_agent="lilgym_mp.learning.parsing.agent:load_agent",
    recipe=ParserRecipe,
    make_recipe=lambda configuration, options: ParserRecipe(**options),
    budget=lambda options: ("step", options.get("steps", ParserRecipe().steps)),
    progress=("loss", "loss of the parser"),
    plays_everything=True,
)
