"""The actions of `lilgym-mp data` that write data sets of episodes."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from lilgym_mp import __version__
from lilgym_mp.cli.options import (
    CommandError,
    add_configuration,
    add_flag,
    add_number,
    add_out,
    add_seed,
    add_settings,
    add_split,
    check_at_least,
    check_out,
    given_settings,
)
from lilgym_mp.cli.solve import add_solving, solve_shown
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.observation import TokenSpace
from lilgym_mp.evaluation import Episode, datasets, evaluate, random_legal
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.scene.arrays import AnyDict, AnyMapping
from lilgym_mp.scene.choices import listed

Add = Callable[..., ArgumentParser]
EXPERT, MEDIUM, MIXED, RANDOM = QUALITIES = "expert", "medium", "mixed", "random-legal"
PARTS = {MIXED: (EXPERT, MEDIUM, RANDOM)}  # of mixed qualities, each with as many episodes


def add_actions(add: Add) -> None:
    """Adds the actions that write and describe data sets of episodes."""
    collect = add("collect", _collect, "let the expert or agents play, and write a data set of their episodes")
    add_configuration(collect)
    add_split(collect, "train")
    collect.add_argument(
        "--quality",
        choices=QUALITIES,
        default=EXPERT,
        help=f"who plays: the expert; an agent that samples its actions ({MEDIUM}); random legal actions; or each of"
        " these a third (default: %(default)s)",
    )
    collect.add_argument(
        "--agent",
        type=Path,
        metavar="RUN",
        help=f"agent of {MEDIUM} and {MIXED}: a run directory, a model file or a shipped agent (default:"
        " imitation-tower or imitation-scatter)",
    )
    add_number(collect, "--episodes", None, "draw N tasks at random (default: each task once)")
    add_seed(collect, "of the tasks and actions")
    _add_output(collect)
    add_solving(collect)
    add_settings(collect)

    convert = add("from-recordings", _convert, "write a data set of recorded episodes")
    convert.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="PATH",
        help="recordings, directories of them, or the database of `lilgym-mp serve`, whose finished episodes are taken",
    )
    convert.add_argument("--configuration", metavar="NAME", help="only episodes of this configuration")
    _add_output(convert)


def _add_output(parser: ArgumentParser) -> None:
    options = parser.add_argument_group("data set")
    add_out(options, f"file to write: {listed(datasets.WRITERS)}")
    options.add_argument("--minari", metavar="NAME", help='Minari data set to write, such as "lilgym/tower-expert-v0"')
    options.add_argument(
        "--observation",
        choices=datasets.FORMS,
        default=datasets.FORMS[0],
        help="image; structured: the items; text, for language models; or tokens: image, and statement as token ids"
        " (default: %(default)s)",
    )
    add_flag(options, "--returns-to-go", "add the sum of rewards from each action on")
    add_flag(options, "--optimal-actions", "add the expert's best actions (slow in Scatter)")


def _collect(args: Namespace) -> int:
    check_at_least(args, 1, "episodes")
    check_at_least(args, 0, "seed")
    if args.agent is not None and MEDIUM not in PARTS.get(args.quality, [args.quality]):
        raise CommandError(f"--agent needs --quality {MEDIUM} or {MIXED}")
    _check_output(args)
    settings = EnvConfig(**given_settings(args))
    ids = settings.tasks(args.split).ids
    if args.episodes is not None:
        ids = [ids[index] for index in np.random.default_rng(args.seed).integers(len(ids), size=args.episodes).tolist()]
    parts = PARTS.get(args.quality, (args.quality,))
    sources: list[datasets.Source] = []
    for index, part in enumerate(parts):
        sources += _played(part, ids[index :: len(parts)], settings, args)
    about = {name: getattr(args, name) for name in ("quality", "episodes", "seed", "budget")}
    return _write(sources, args, about)


def _played(part: str, ids: Sequence[str], settings: EnvConfig, args: Namespace) -> list[datasets.Source]:
    """Episodes of the tasks, of one quality; none for the tasks that the expert cannot solve."""
    if not ids:
        return []
    if part == EXPERT:
        tasks = settings.tasks(args.split)
        dynamics = settings.dynamics()
        distinct = [tasks.by_id(task_id) for task_id in dict.fromkeys(ids)]
        solved = {
            task.id: Episode.of(task, solution.actions, "success", dynamics)
            for task, solution, _ in solve_shown(distinct, settings, args.split, args)
            if solution.solved
        }
        episodes = [solved[task_id] for task_id in ids if task_id in solved]
        if missing := len(ids) - len(episodes):
            print(f"{missing:,} of {len(ids):,} tasks have no solution and are left out")
        return [datasets.Source(settings, args.split, EXPERT, episodes)]
    name = part
    policy = random_legal
    if part == MEDIUM:
        from lilgym_mp.learning.common.agents import open_agent

        path = args.agent or Path(f"imitation-{settings.appearance}")
        name = str(path)
        policy = open_agent(path).policy(settings, sampled=True)
    with Progress(len(ids), f"episodes of {name}") as progress:
        episodes = evaluate(
            policy, settings, args.split, seed=args.seed, task_ids=ids, on_episode=lambda episode: progress.advance()
        )
    return [datasets.Source(settings, args.split, name, episodes)]


def _convert(args: Namespace) -> int:
    _check_output(args)
    sources = [
        source
        for source in datasets.recorded(args.sources)
        if args.configuration in (None, source.settings.configuration) and source.episodes
    ]
    if not sources:
        raise CommandError(
            f"{listed(args.sources)}: no finished episodes of {args.configuration or 'any configuration'}"
        )
    return _write(sources, args, {"recordings": [str(path) for path in args.sources]})


def _check_output(args: Namespace) -> None:
    """Raises an error for what would otherwise fail only after the episodes are played."""
    if args.out is None and args.minari is None:
        raise CommandError("name an output: --out FILE, --minari NAME, or both")
    if args.out is not None:
        datasets.check_file(args.out)
    check_out(args)
    if args.minari is not None:
        datasets.check_minari(args.minari)


def _tokens(env: gym.Env[Any, Any]) -> AnyDict:
    """The words that token ids stand for, from 2 on, and the length of a statement, if statements are token ids."""
    statement = getattr(env.observation_space, "spaces", {}).get("statement")
    if not isinstance(statement, TokenSpace):
        return {}
    return {"vocabulary": list(statement.vocabulary.words), "length": statement.shape[0]}


def _write(sources: Sequence[datasets.Source], args: Namespace, about: AnyMapping) -> int:
    settings = datasets.common_settings(sources)
    splits = list(dict.fromkeys(source.split for source in sources))
    envs = datasets.environments(settings, splits, args.observation)
    env = envs[splits[0]]
    about = {
        "lilgym_mp": __version__,
        "settings": settings.to_json(),
        "tasks_sha256": {split: envs[split].get_wrapper_attr("tasks").provenance.sha256 for split in splits},
        "observation": args.observation,
        "wrappers": [] if env.spec is None else [wrapper.name for wrapper in env.spec.additional_wrappers],
        **_tokens(env),
        **about,
    }
    options = {"returns_to_go": args.returns_to_go, "optimal": args.optimal_actions}
    total = sum(len(source.episodes) for source in sources)
    if total == 0:
        raise CommandError("there are no episodes to write")
    agents = ", ".join(dict.fromkeys(source.agent for source in sources))
    for place in filter(None, (args.out, args.minari)):
        with Progress(total, "episodes written") as progress:
            played = datasets.rollouts(sources, envs, progress.advance, **options)
            if isinstance(place, Path):
                datasets.write_file(place, played, about)
            else:
                datasets.write_minari(place, played, env, envs.get(datasets.EVALUATION_SPLIT, env), agents, about)
        print(f"{place}: {total:,} episodes of {agents}")
    return 0
