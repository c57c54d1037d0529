"""Measures proposers and verifiers of the two-agent game for `lilgym-mp evaluate`."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.envs.proposer_verifier import AGENTS, PROTOCOLS, GameSettings, Metrics, Partner, Role, measure
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.evaluation.files import write_json
from lilgym_mp.evaluation.game_partners import SCRIPTED_VERIFIERS, TARGET_ONLY, scripted_proposers
from lilgym_mp.evaluation.options import CommandError, given_environment
from lilgym_mp.evaluation.terminal import Progress, table

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent

# What runs that play together must share.
SHARED = (
    "configuration",
    "rules",
    "horizon",
    "grid",
    "protocol",
    "ending",
    "verdict_bins",
    "exchanges",
    "message_size",
)
CONFIGURATION = "TowerFlipIt"  # unless another is named, or the runs'
LEGEND = """\
success: the MDP's, in %. complete, sound: % of true claims accepted and of false ones refused, by target true / false.
J: mean over targets of completeness + soundness - 100; 0 for a verifier that knows the target alone.
lies accepted: % of games that end in an accepted false claim."""


@dataclass(frozen=True)
class Player:
    """One side of the game."""

    name: str
    partner: Partner
    view: Any = "image"
    run: Path | None = None  # None for scripted partners


def evaluate_games(args: argparse.Namespace, agents: Mapping[Path, Agent]) -> int:
    if args.policy or args.record is not None:
        raise CommandError("--policy and --record are for the single-agent environment; --out FILE writes games")
    if args.best_response is not None and not agents:
        raise CommandError("--best-response trains against the verifiers of runs: name some")
    games = _games(args, agents)
    results: list[dict[str, Any]] = []
    pairs = [(game, proposer, verifier) for game in games for proposer, verifier in game.pairs(args.cross_play)]
    with Progress(len(pairs), "pairs") as progress:
        for game, proposer, verifier in pairs:
            results.append(game.result(proposer, verifier, args))
            progress.advance()
    for game in games:
        rows = [_row(result) for result in results if result["protocol"] == game.settings.protocol]
        print(
            f"\n{game.settings.configuration}, {game.settings.protocol}, {args.split}, corpus {game.settings.corpus}\n"
        )
        print(table(list(rows[0]), [list(row.values()) for row in rows]))
    print(f"\n{LEGEND}")
    if args.out is not None:
        write_json(args.out, {"results": results})
        print(f"results: {args.out}")
    return 0


@dataclass(frozen=True)
class GameToPlay:
    """One game's settings and all the players of it."""

    settings: GameSettings
    proposers: Mapping[str, Player]
    verifiers: Mapping[str, Player]

    def pairs(self, cross_play: bool) -> Iterator[tuple[Player, Player]]:
        """Every pair, or those that the runs need: no pair of two scripted partners if there are runs."""
        trained = any(player.run for player in (*self.proposers.values(), *self.verifiers.values()))
        for proposer, verifier in product(self.proposers.values(), self.verifiers.values()):
            if cross_play or not trained or _is_default_pair(proposer, verifier):
                yield proposer, verifier

    def result(self, proposer: Player, verifier: Player, args: argparse.Namespace) -> dict[str, Any]:
        measured = self._measure(proposer, verifier, args).to_json()
        # Once for each verifier: in the row of its own run's proposer, or else of the expert.
        own = [player for player in self.proposers.values() if player.run == verifier.run]
        is_first = proposer is (own[0] if own else self.proposers["expert"])
        exploitability = None
        if args.best_response is not None and verifier.run is not None and is_first:
            exploitability = self._exploitability(verifier, args)
        return {
            "proposer": proposer.name,
            "verifier": verifier.name,
            "configuration": self.settings.configuration,
            "protocol": self.settings.protocol,
            "corpus": str(self.settings.corpus),
            "split": args.split,
            "seed": args.seed,
            "success": measured.pop("success_rate"),
            "exploitability": exploitability,
            **measured,
        }

    def _exploitability(self, verifier: Player, args: argparse.Namespace) -> float:
        """The share of games in which a proposer trained against the verifier gets a false claim accepted."""
        from lilgym_mp.learning.game.population import best_response

        agent = best_response(verifier.partner, Role.PROPOSER, self.settings, steps=args.best_response, seed=args.seed)
        return self._measure(Player("best response", agent, verifier.view), verifier, args).accepted_false_claims

    def _measure(self, proposer: Player, verifier: Player, args: argparse.Namespace) -> Metrics:
        views = dict(zip(AGENTS, (proposer.view, verifier.view), strict=True))
        env = BaseGameEnv(replace(self.settings, views=views, split=args.split))
        return measure(env, proposer.partner, verifier.partner, seed=args.seed)


def _is_default_pair(proposer: Player, verifier: Player) -> bool:
    if proposer.run is None:
        return verifier.run is not None and proposer.name in ("expert", "expert-sneaky")
    return verifier.run == proposer.run or verifier.name in ("oracle", TARGET_ONLY)


def _games(args: argparse.Namespace, agents: Mapping[Path, Agent]) -> list[GameToPlay]:
    """The games to play: that of the runs, or one for each protocol and configuration."""
    given = given_environment(args)
    own = {path: agent.game for path, agent in agents.items() if agent.game is not None}
    if own:
        first, *others = own
        if args.protocol:
            raise CommandError(f"{first} was trained for {own[first].protocol}; leave --protocol out")
        for other, name in product(others, SHARED):
            expected, value = getattr(own[first], name), getattr(own[other], name)
            if expected != value:
                raise CommandError(f"{first} and {other} play different games: {name} {expected!r} and {value!r}")
        settings = [replace(own[first], **given)]
    else:
        played = product(args.configuration or [CONFIGURATION], args.protocol or PROTOCOLS)
        settings = [GameSettings(name, protocol=protocol, **given) for name, protocol in played]
    return [_game(each, agents) for each in settings]


def _game(settings: GameSettings, agents: Mapping[Path, Agent]) -> GameToPlay:
    """The game with the agents' sides and all scripted partners. Raises ValueError for an agent that cannot play it."""
    scripted = scripted_proposers(settings.setup().game.config.dynamics), SCRIPTED_VERIFIERS
    sides: list[dict[str, Player]] = []
    for role, partners in zip(Role, scripted, strict=True):
        players = [_player(path, agent, role, settings) for path, agent in agents.items()]
        players += [Player(name, partner) for name, partner in partners.items()]
        sides.append({player.name: player for player in players if player is not None})
    return GameToPlay(settings, *sides)


def _player(path: Path, agent: Agent, role: Role, settings: GameSettings) -> Player | None:
    """The agent's side; None if it has none."""
    partner = agent.partner(role, settings)
    views: Any = "image" if agent.game is None else agent.game.views
    view = views[AGENTS[role]] if isinstance(views, Mapping) and AGENTS[role] in views else views
    return None if partner is None else Player(str(path), partner, view, path)


def _row(result: Mapping[str, Any]) -> dict[str, str]:
    """A row of the table, by heading."""
    by_target = [result["by_target"].get(target, {}) for target in ("true", "false")]
    complete, sound = (
        " / ".join(_percent(each.get(name), digits=0) for each in by_target) for name in ("completeness", "soundness")
    )
    return {
        "proposer": result["proposer"],
        "verifier": result["verifier"],
        "games": f"{result['games']:,}",
        "success": _percent(result["success"]),
        "J": _percent(result["j"], digits=0),
        "complete T/F": complete,
        "sound T/F": sound,
        "lies accepted": _percent(result["accepted_false_claims"]),
        "exploitability": _percent(result["exploitability"]),
    }


def _percent(share: float | None, digits: int = 1) -> str:
    return "-" if share is None else f"{round(100 * share, digits) + 0.0:.{digits}f}"  # no "-0"
