"""`lilgym-mp demo`: train a small agent, evaluate it before and after, and show what it does."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.display import TrainingDisplay
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.evaluation.comparison import BASELINES, Contestant, Trial
from lilgym_mp.evaluation.files import OutputError, writable_directory, write_json, write_text
from lilgym_mp.evaluation.film import film_grid
from lilgym_mp.evaluation.report import LEGEND, results_json, table
from lilgym_mp.evaluation.runs import Episode
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.learning.recipe import Recipe

if TYPE_CHECKING:
    from lilgym_mp.learning.training import Run

CONFIGURATION = "TowerScratch"
SPLIT = "dev"
DEFAULT_STEPS = 100_000
BACKEND = "batched"
SAVE_EVERY = 20_000  # steps
PASSES = 10  # visits to each task, as all draw their actions
FILMED = 9  # episodes
PLACE = Path("runs") / "demo"


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "demo",
        help="train a small agent in about two minutes, and see what it does",
        description=f"Trains an agent on {CONFIGURATION} of the builtin corpus, evaluates it on {SPLIT} before and "
        "after beside random play, and films it.",
    )
    parser.add_argument(
        "--steps", type=int, default=DEFAULT_STEPS, metavar="N", help="actions to train for (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of everything (default: 0)")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"empty or new directory (default: {PLACE}, {PLACE}-2, ...)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from lilgym_mp.learning.training import begin_run, train

    if args.steps < 1:
        raise CommandError("--steps must be at least 1")
    place = writable_directory(_empty(args.out) if args.out else next_free(PLACE))
    settings = Settings(CONFIGURATION)
    begun = begin_run(place / "agent", settings, Recipe(seed=args.seed, stop_forcing=True))
    before = _contestant("untrained agent", begun)
    print(f"training on {CONFIGURATION}, builtin corpus: {len(begun.tasks)} tasks, {args.steps:,} steps")
    with TrainingDisplay(0, args.steps) as display:
        trained = train(begun, args.steps, backend=BACKEND, save_every=SAVE_EVERY, on_update=display)
    if trained.steps < args.steps:
        raise KeyboardInterrupt
    after = _contestant("trained agent", trained)
    _report(place, settings, args.seed, (before, after), {task.statement for task in trained.tasks})
    return 0


def _contestant(name: str, run: Run) -> Contestant:
    details = {"actions": "sampled", "steps": run.steps, "trained_with": run.identity.to_json()}
    return Contestant(name, run.agent(greedy=False), details)


def _report(place: Path, settings: Settings, seed: int, agents: Sequence[Contestant], seen: set[str]) -> None:
    """Evaluates the agents, the last being the trained one, beside random play; writes and shows what came of it."""
    trial = Trial(settings, SPLIT, seed, passes=PASSES)
    results = list(trial.results((*agents, *BASELINES), seen))
    summary = "\n\n".join([str(trial), table(results), LEGEND])
    write_json(place / "results.json", results_json({"demo": (trial, results)}))
    write_text(place / "results.md", f"{summary}\n")
    film_grid(place / "rollouts.gif", settings, SPLIT, _to_film(results[len(agents) - 1].episodes))
    print(
        f"\n{summary}\n\nresults:  {place / 'results.md'}, {place / 'results.json'}\n"
        f"rollouts: {place / 'rollouts.gif'}\n"
        f"agent:    {place / 'agent'}, to be evaluated with: lilgym-mp evaluate {place / 'agent'} --split test"
    )


def _to_film(episodes: Sequence[Episode]) -> list[Episode]:
    """Episodes of the first pass, from all over the split, whether they succeed or not."""
    tasks = len(episodes) // PASSES
    return list(episodes[: tasks : max(1, tasks // FILMED)][:FILMED])


def _empty(path: Path) -> Path:
    if path.is_dir() and any(path.iterdir()):
        raise OutputError(f"{path} is not empty; name an empty or new directory")
    return path


def next_free(path: Path) -> Path:
    """`path`, or the first of path-2, path-3, ... that is not there."""
    numbered = (path if number == 1 else path.with_name(f"{path.name}-{number}") for number in count(1))
    return next(candidate for candidate in numbered if not candidate.exists())
