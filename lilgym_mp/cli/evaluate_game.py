"""Measures proposers and verifiers of the two-agent game for `lilgym-mp evaluate`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lilgym_mp.envs.proposer_verifier import PROTOCOLS, GameSettings, Metrics, Partner, Role, measure
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.evaluation.files import write_json
from lilgym_mp.evaluation.game_partners import SCRIPTED_VERIFIERS, TARGET_ONLY, scripted_proposers
from lilgym_mp.evaluation.options import CommandError, given_environment
from lilgym_mp.evaluation.terminal import Progress, table

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent

# Settings that may differ between runs that play together; the first run's are played:
MAY_DIFFER = ("corpus", "rewards", "false_accept_cost", "false_reject_cost", "deceptive_share", "message_cost")
CONFIGURATION = "TowerFlipIt"  # unless another is named, or the runs'
LEGEND = """\
success: the MDP's, in %. true and false accepts: % of true and of false claims accepted, by target true / false.
J: mean over targets of true accepts - false accepts; 0 for a verifier that knows the target alone.
lies accepted: % of games that end in an accepted false claim."""


class Player(NamedTuple):
    """One side of the game."""

    name: str
    partner: Partner
    run: Path | None = None  # None for scripted partners


def evaluate_games(args: argparse.Namespace, agents: Mapping[Path, Agent]) -> int:
    if args.policy or args.record is not None:
        raise CommandError("--policy and --record are for the single-agent environment; --out FILE writes games")
    games = [(settings, _pairs(settings, agents, all_pairs=args.cross_play)) for settings in _games(args, agents)]
    results: list[list[dict[str, Any]]] = []  # by game
    with Progress(sum(len(pairs) for _, pairs in games), "pairs") as progress:
        for settings, pairs in games:
            env = BaseGameEnv(settings)
            results.append([])
            for proposer, verifier in pairs:
                measured = measure(env, proposer.partner, verifier.partner, seed=args.seed)
                results[-1].append(_result(settings, proposer, verifier, measured, args.seed))
                progress.advance()
    for (settings, _), found in zip(games, results, strict=True):
        print(f"\n{settings.configuration}, {settings.protocol}, {args.split}, corpus {settings.corpus}\n")
        rows = [_row(result) for result in found]
        print(table(list(rows[0]), [list(row.values()) for row in rows]))
    print(f"\n{LEGEND}")
    if args.out is not None:
        write_json(args.out, {"results": [result for found in results for result in found]})
        print(f"results: {args.out}")
    return 0


def _games(args: argparse.Namespace, agents: Mapping[Path, Agent]) -> list[GameSettings]:
    """The games to play: that of the runs, or one for each protocol and configuration."""
    given = {**given_environment(args), "split": args.split}
    own = {path: agent.game for path, agent in agents.items() if agent.game is not None}
    if not own:
        played = product(args.configuration or [CONFIGURATION], args.protocol or PROTOCOLS)
        return [GameSettings(name, protocol=protocol, **given) for name, protocol in played]
    first, *others = own
    if args.protocol:
        raise CommandError(f"{first} was trained for {own[first].protocol}; leave --protocol out")
    for other, name in product(others, ("configuration", *GameSettings.settings())):
        expected, value = getattr(own[first], name), getattr(own[other], name)
        if expected != value and name not in MAY_DIFFER:
            raise CommandError(f"{first} and {other} play different games: {name} {expected!r} and {value!r}")
    return [replace(own[first], **given)]


def _pairs(settings: GameSettings, agents: Mapping[Path, Agent], *, all_pairs: bool) -> list[tuple[Player, Player]]:
    """Every pair, or those that the runs need: no pair of two scripted partners if there are runs.

    Raises ValueError for an agent that cannot play the game.
    """
    sides: list[list[Player]] = []
    for role, scripted in zip(Role, (scripted_proposers(settings.dynamics()), SCRIPTED_VERIFIERS), strict=True):
        trained = ((path, agent.partner(role, settings)) for path, agent in agents.items())
        players = [Player(str(path), partner, path) for path, partner in trained if partner is not None]
        sides.append([*players, *(Player(name, partner) for name, partner in scripted.items())])
    return [pair for pair in product(sides[0], sides[1]) if all_pairs or not agents or _is_needed(*pair)]


def _is_needed(proposer: Player, verifier: Player) -> bool:
    if proposer.run is None:
        return verifier.run is not None and proposer.name in ("expert", "expert-deceptive")
    return verifier.run == proposer.run or verifier.name in ("oracle", TARGET_ONLY)


def _result(settings: GameSettings, proposer: Player, verifier: Player, measured: Metrics, seed: int) -> dict[str, Any]:
    measures = asdict(measured)
    return {
        "proposer": proposer.name,
        "verifier": verifier.name,
        "configuration": settings.configuration,
        "protocol": settings.protocol,
        "corpus": str(settings.corpus),
        "split": settings.split,
        "seed": seed,
        "success": measures.pop("success_rate"),
        **measures,
    }


def _row(result: Mapping[str, Any]) -> dict[str, str]:
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
    }


def _percent(share: float | None, digits: int = 1) -> str:
    return "-" if share is None else f"{round(100 * share, digits) + 0.0:.{digits}f}"  # no "-0"
