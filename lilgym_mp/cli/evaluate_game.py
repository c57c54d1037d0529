"""Measures proposers and verifiers of the two-agent game for `lilgym-mp evaluate`."""

from __future__ import annotations

import csv
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.options import JSON, CommandError, given_environment
from lilgym_mp.envs.proposer_verifier import AGENTS, PROTOCOLS, GameSettings, Partner, Role, measure
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.evaluation.files import fresh_file, write_json
from lilgym_mp.evaluation.game_partners import (
    BUILDER,
    GUIDE,
    TARGET_ONLY,
    ChangedMessages,
    scripted_partners,
)
from lilgym_mp.evaluation.policies import GREEDY, SAMPLED
from lilgym_mp.evaluation.terminal import Progress, table
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.grouping import grouped

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent

    Agents = Mapping[Path, Agent]  # by run

# Settings that may differ between runs that play together; the first run's are played:
MAY_DIFFER = ("corpus", "rewards", "deceptive_share", "message_cost", "views")
CONFIGURATION = "TowerFlipIt"  # unless another is named, or the runs'
LEGEND = """\
success: the MDP's, in %. true and false accepts: % of true and of false claims accepted, by target true / false.
J: mean over targets of true accepts - false accepts; 0 for a verifier that knows the target alone.
lies accepted: % of games that end in an accepted false claim."""


Player = tuple[str, Partner]  # one side of the game, and its name: a run's path or a scripted partner's


def evaluate_games(args: Namespace, agents: Agents) -> int:
    """Plays the two-agent game with every pair of agents; returns the exit status."""
    unused = [name for name in ("policy", "record", "name") if getattr(args, name)]
    if args.passes > 1:
        unused.append("passes")
    if unused:
        raise CommandError(f"--{unused[0]} is for the single-agent environment; --out FILE writes games")
    table_file = None if args.out is None else args.out.with_suffix(".csv")
    if table_file is not None:
        if table_file == args.out:
            raise CommandError(f"--out {args.out} is for JSON; a table is written beside it, so give another suffix")
        fresh_file(table_file, force=args.force)
    games = [
        (settings, actions, _pairs(settings, agents, all_pairs=args.cross_play, sampled=actions == SAMPLED))
        for settings, actions in product(_games(args, agents), args.actions or [GREEDY])
    ]
    results: list[JSON] = []
    tables: list[str] = []
    with Progress(sum(len(pairs) for *_, pairs in games), "pairs") as progress:
        for settings, actions, pairs in games:
            played = _played(settings, pairs, agents, progress, args.seed, actions=actions, messages=args.messages)
            results += played
            changed = f", messages {args.messages}" if args.messages else ""
            tables.append(
                f"{settings.configuration}, {settings.protocol}, {args.split}, corpus {settings.corpus}, {actions}"
                f" actions{changed}\n"
            )
            tables.append(games_table(played))
    print("", *tables, LEGEND, sep="\n")
    if args.out is not None and table_file is not None:
        write_json(args.out, {"results": results})
        _write_csv(table_file, results)
        print(f"results: {args.out}, {table_file}")
    return 0


def _played(
    settings: GameSettings,
    pairs: Sequence[tuple[Player, Player]],
    agents: Agents,
    progress: Progress,
    seed: int = 0,
    *,
    actions: str = GREEDY,
    messages: str | None = None,
) -> list[AnyDict]:
    """The measures of a game with each pair, and what was played."""
    env = BaseGameEnv(**vars(settings))
    results: list[AnyDict] = []
    for (proposer, proposing), (verifier, judging) in pairs:
        if messages:
            proposing, judging = (ChangedMessages(each, messages) for each in (proposing, judging))
        measures = asdict(measure(env, proposing, judging, seed=seed))
        progress.advance()
        result = {
            "proposer": proposer,
            "verifier": verifier,
            "configuration": settings.configuration,
            "protocol": settings.protocol,
            "corpus": str(settings.corpus),
            "split": settings.split,
            "seed": seed,
            "actions": actions,
            "messages": messages,
            "success": measures.pop("success_rate"),
            "remark": _remark(proposer, verifier, agents),
            **measures,
        }
        results.append(result)
    return results


def play_on_dev(agents: Agents) -> list[AnyDict]:
    """The results of each run with every other of its game, and with scripted partners, by most probable actions."""
    names = [name for name in ("configuration", *GameSettings.settings()) if name not in MAY_DIFFER]
    own = {path: agent.game for path, agent in agents.items() if agent.game is not None}
    results: list[AnyDict] = []
    groups = grouped((repr([_compared(game, name) for name in names]), path) for path, game in own.items())
    for paths in groups.values():
        settings = replace(own[paths[0]], split="dev")
        found = _pairs(settings, {path: agents[path] for path in paths}, all_pairs=True, sampled=False)
        pairs = [pair for pair in found if {Path(pair[0][0]), Path(pair[1][0])} & set(paths)]
        with Progress(len(pairs), "pairs") as progress:
            results += _played(settings, pairs, agents, progress)
    return results


def _remark(proposer: str, verifier: str, agents: Agents) -> str:
    """How the games differ in which two runs have learned; "" if one of them is scripted."""
    games = [agents[Path(name)].game for name in (proposer, verifier) if Path(name) in agents]
    if len(games) < len(Role) or None in games:
        return ""
    differing = [name for name in ("rewards", "views") if len({repr(getattr(game, name)) for game in games}) > 1]
    return f"trained with other {' and '.join(differing)}" if differing else ""


def _write_csv(path: Path, results: Sequence[JSON]) -> None:
    """One row for each pair; intervals have a column for each end."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = [_flat(result) for result in results]
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _flat(result: JSON) -> JSON:
    row: JSON = {}
    for name, value in result.items():
        if name.endswith("_interval"):
            row[f"{name}_low"], row[f"{name}_high"] = value or (None, None)
        elif name != "by_target":
            row[name] = value
    return row


def _games(args: Namespace, agents: Agents) -> list[GameSettings]:
    """The games to play, one for each configuration: that of the runs, or each protocol."""
    given = {**given_environment(args), "split": args.split}
    own = {path: agent.game for path, agent in agents.items() if agent.game is not None}
    if not own:
        played = product(args.configuration or [CONFIGURATION], args.protocol or PROTOCOLS)
        seen = {"views": args.views} if args.views else {}
        return [GameSettings(name, protocol=protocol, **seen, **given) for name, protocol in played]
    first, *others = own
    if args.views:
        raise CommandError(f"{first} sees what it learned with; leave --views out")
    if args.protocol:
        raise CommandError(f"{first} was trained for {own[first].protocol}; leave --protocol out")
    for other, name in product(others, ("configuration", *GameSettings.settings())):
        expected, value = (_compared(own[path], name) for path in (first, other))
        if expected != value and name not in MAY_DIFFER:
            raise CommandError(f"{first} and {other} play different games: {name} {expected!r} and {value!r}")
    names = args.configuration or [own[first].configuration]
    return [replace(own[first], configuration=name, **given) for name in names]


def _compared(settings: GameSettings, name: str) -> Any:
    """The value of a setting that runs which play together must share."""
    if name == "message_size":
        return dict(zip(AGENTS, settings.message_sizes(), strict=True))
    return getattr(settings, name)


def _pairs(settings: GameSettings, agents: Agents, *, all_pairs: bool, sampled: bool) -> list[tuple[Player, Player]]:
    """Every pair, or those that the runs need: no pair of two scripted partners if there are runs.

    Raises ValueError for an agent that cannot play the game.
    """
    sides: list[list[Player]] = []
    for role, scripted in scripted_partners(settings).items():
        trained = [(str(path), agent.partner(role, settings, sampled=sampled)) for path, agent in agents.items()]
        sides.append([*((name, partner) for name, partner in trained if partner is not None), *scripted.items()])
    runs = {str(path) for path in agents}
    pairs = product(sides[0], sides[1])
    return [pair for pair in pairs if all_pairs or not agents or _is_needed(pair[0][0], pair[1][0], runs)]


def _is_needed(proposer: str, verifier: str, runs: set[str]) -> bool:
    if proposer not in runs:
        return verifier in runs and proposer in ("expert", "expert-deceptive", BUILDER)
    return verifier in (proposer, "oracle", TARGET_ONLY, GUIDE)


def games_table(results: Sequence[JSON]) -> str:
    """The results of pairs of players as a table."""
    rows = list(map(_row, results))
    return table(list(rows[0]), [list(row.values()) for row in rows], keys=2)


def _row(result: JSON) -> dict[str, str]:
    """A row of the table, by heading."""
    by_target = [result["by_target"].get(target, {}) for target in ("true", "false")]
    true, false = (
        " / ".join(_percent(each.get(f"{name}_accept_rate"), digits=0) for each in by_target)
        for name in ("true", "false")
    )
    return {
        "proposer": result["proposer"],
        "verifier": result["verifier"],
        "games": f"{result['games']:,}",
        "success": _percent(result["success"]),
        "J": _percent(result["j"], digits=0),
        "true accepts T/F": true,
        "false accepts T/F": false,
        "lies accepted": _percent(result["accepted_false_claims"]),
        "remark": result["remark"],
    }


def _percent(share: float | None, digits: int = 1) -> str:
    return "-" if share is None else f"{round(100 * share, digits) + 0.0:.{digits}f}"  # no "-0"
