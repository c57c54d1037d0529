"""Both agents of the proposer-verifier game.

Trains one or both agents of the proposer-verifier game. Ctrl-C saves a checkpoint and exits.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, ENDINGS, PROTOCOLS, Role
from lilgym_mp.envs.proposer_verifier.rewards import PRESETS
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.evaluation.game_partners import SCRIPTED_VERIFIERS
from lilgym_mp.evaluation.options import (
    INTERRUPTED,
    RUNS,
    CommandError,
    add_budget,
    add_configuration,
    add_device,
    add_run_directory,
    add_settings,
    check_at_least,
    check_budget,
    fill_options,
    flag_name,
    given_options,
)
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.learning.common.commands import add_recipe, interrupted
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.game.recipe import GameRecipe, make_recipe
from lilgym_mp.scene.choices import choose

if TYPE_CHECKING:
    from lilgym_mp.learning.game.training import Progress as TrainingProgress
    from lilgym_mp.learning.game.training import Run

NAME = "game"
DEFAULT_STEPS = 2_500_000
PARTNERS = {"proposers": Role.PROPOSER, "verifiers": Role.VERIFIER}  # options that name frozen partners
_NUMBERS = {  # options of the game, with their types and help
    "false_accept_cost": (float, "cost of a false accept in the reward `correctness` (default: 1)"),
    "false_reject_cost": (float, "cost of a false reject in the reward `correctness` (default: 1)"),
    "sneaky_share": (float, "share of sneaky games, if the proposer's intent is hidden (default: 0.5)"),
    "message_size": (int, "messages besides silence, for both agents (default: the protocol's)"),
    "message_cost": (float, "cost of a message to its sender (default: 0)"),
    "verdict_bins": (int, "audit: probabilities to choose from (default: true or false)"),
    "exchanges": (int, "critique: rejections in a round before a proposal needs no answer (default: 3)"),
}
_GAME = ("protocol", "ending", "rewards")
_SETTINGS = (*_GAME, *_NUMBERS, "corpus", "rules", "horizon", "grid")


def add_options(parser: argparse.ArgumentParser) -> None:
    add_configuration(parser, nargs="?")
    add_run_directory(parser, f"{NAME}-CONFIGURATION")
    add_budget(parser, "steps", DEFAULT_STEPS, "turns of all games together")
    for name, role in PARTNERS.items():
        others = f", or: {', '.join(SCRIPTED_VERIFIERS)}" if role is Role.VERIFIER else ""
        parser.add_argument(
            f"--{name}",
            type=Path,
            nargs="+",
            metavar="RUN",
            help=f"train only {AGENTS[role.other]}, against these runs' trained {name}{others}",
        )
    parser.add_argument(
        "--start-from", type=Path, metavar="RUN", help="start with the weights of a run of `ppo` or `game`"
    )
    parser.add_argument(
        "--rounds",
        type=int,
        metavar="N",
        help="population rounds: a verifier learns against --proposers and all earlier sneaks, then a sneaky best "
        "response to it joins them; each has the budget to itself",
    )
    add_device(parser)
    options = parser.add_argument_group("game")
    options.add_argument("--protocol", choices=list(PROTOCOLS), help="(default: veto)")
    options.add_argument("--ending", choices=list(ENDINGS), help="who may end the game (default: the protocol's)")
    options.add_argument(
        "--rewards",
        metavar="NAME",
        help=f"{', '.join(PRESETS)}, or JSON of weighted terms for each agent (default: common)",
    )
    for name, (value_type, description) in _NUMBERS.items():
        options.add_argument(f"--{flag_name(name)}", type=value_type, metavar="N", help=description)
    add_settings(parser)
    add_recipe(parser, GameRecipe)


def train(args: argparse.Namespace) -> int:
    check_budget(args, "steps")
    check_at_least(args, 1, "threads", "rounds")
    if args.configuration is None and not (args.resume and args.out):
        raise CommandError(f"name a configuration to train on; choose from {', '.join(CONFIGURATIONS)}")
    if args.rounds is not None:
        return _train_rounds(args)
    from lilgym_mp.learning.common.run_directory import AGENT_FILE
    from lilgym_mp.learning.game.training import train_game

    directory, arguments = _resume_arguments(args) if args.resume else _new_arguments(args)
    fill_options(args, arguments.pop("options", {}), {"steps": DEFAULT_STEPS, "minutes": None})
    with Progress(100, "% of the budget", None, doing="game: preparing data") as bar:

        def show(update: TrainingProgress, done: float) -> None:
            success, j = (
                "-" if share is None else f"{100 * share:.0f}{unit}"
                for share, unit in ((update.success, " %"), (update.j, ""))
            )
            note = f"{update.steps:,} turns, {update.turns_per_second:,.0f}/s, success {success}, J {j}"
            bar.reach(round(100 * min(1.0, done)), note)

        agent = train_game(
            out=directory, resume=args.resume, on_begin=_introduce, on_progress=show, **_budget(args), **arguments
        )
    details = agent.description.details
    print(f"saved {directory / AGENT_FILE} after {details['steps']:,} turns, {details['cpu_minutes']:g} CPU minutes")
    if details["interrupted"]:
        return interrupted(NAME, directory)
    print(f"evaluate it with: lilgym-mp evaluate {directory} --corpus {agent.settings.corpus}")
    return 0


def _train_rounds(args: argparse.Namespace) -> int:
    from lilgym_mp.learning.common.run_directory import AGENT_FILE
    from lilgym_mp.learning.game.population import train_rounds

    if not args.proposers or args.verifiers:
        raise CommandError("--rounds begins with trained proposers: name their runs with --proposers")
    fill_options(args, {}, {"steps": DEFAULT_STEPS})
    directory, arguments = _new_arguments(args)
    first = arguments.pop("partners")[Role.PROPOSER]

    def report(index: int, verifier: Path) -> None:
        print(f"round {index}: {verifier} and its sneaky best response are trained", flush=True)
        shutil.copyfile(verifier / AGENT_FILE, directory / AGENT_FILE)

    proposers = train_rounds(
        arguments["settings"],
        arguments["recipe"],
        directory,
        first,
        rounds=args.rounds,
        on_round=report,
        **_budget(args),
    )
    if len(proposers) < len(first) + args.rounds:
        print("interrupted; repeat the command to continue")
        return INTERRUPTED
    print(f"saved the last verifier as {directory / AGENT_FILE}")
    return 0


def _budget(args: argparse.Namespace) -> dict[str, Any]:
    return given_options(args, ["steps", "minutes", "device", "threads"])


def _given_game(args: argparse.Namespace) -> dict[str, Any]:
    """The fields of `GameSettings` that were given."""
    names = {} if args.configuration is None else _names(args.configuration)
    return _with_rewards({**given_options(args, _SETTINGS), **names})


def _names(configuration: str) -> dict[str, str]:
    """Appearance and start."""
    return dict(zip(("appearance", "start"), choose("configuration", configuration, CONFIGURATIONS), strict=True))


def _with_rewards(given: dict[str, Any]) -> dict[str, Any]:
    """The game's settings with rewards read from JSON."""
    if str(given.get("rewards", "")).startswith("{"):
        try:
            given["rewards"] = json.loads(given["rewards"])
        except ValueError as error:
            raise CommandError(f"--rewards: not valid JSON: {error}") from None
    return given


def _new_arguments(args: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    settings = GameSettings.of(_given_game(args))
    return args.out or RUNS / f"{NAME}-{args.configuration}", {
        "settings": settings,
        "recipe": make_recipe(args.configuration, **given_options(args, GameRecipe.names())),
        "partners": {role: getattr(args, name) for name, role in PARTNERS.items() if getattr(args, name)},
        "start_from": args.start_from,
    }


def _resume_arguments(args: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    from lilgym_mp.learning.game.training import saved_arguments

    directory = args.out or RUNS / f"{NAME}-{args.configuration}"
    requested = {"game": _given_game(args), "recipe": given_options(args, GameRecipe.names())}
    return directory, saved_arguments(directory, requested)


def _introduce(run: Run) -> None:
    """Prints the run's settings."""
    settings, recipe = run.settings, run.recipe
    learning = " and ".join(AGENTS[role] for role in run.roles)
    print(
        f"{settings.protocol}, rewards {settings.rewards}, corpus {settings.corpus}, {len(run.tasks.tasks):,}"
        f" training tasks; {learning} learn{'s' * (len(run.roles) == 1)}, {recipe.algorithm}, verifier by"
        f" {recipe.verifier}\n"
        f"{run.trained_parameters:,} trained parameters, seed {recipe.seed}; run directory: {run.files.path}",
        flush=True,
    )


def _planned_recipe(configuration: str, options: dict[str, Any]) -> GameRecipe:
    """The recipe of an experiment's run, whose game is checked too. Raises ValueError."""
    game = {name: options[name] for name in _GAME if name in options}
    GameSettings.of({**_names(configuration), **_with_rewards(game)}).setup()
    return make_recipe(configuration, **{name: options[name] for name in GameRecipe.names() if name in options})


LEARNER = Learner(
    add_options=add_options,
    train=train,
    recipe=GameRecipe,
    make_recipe=_planned_recipe,
    progress=("success", "success rate of training games"),
    budget=lambda options: ("steps", options["steps"]),
    numbers={"steps": DEFAULT_STEPS, "minutes": None, "rounds": None},
    texts=(*_GAME, *PARTNERS, "start_from"),
    records=False,
)
