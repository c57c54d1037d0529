"""Print the figures of docs/game_experiments.md on the official dev split.

    python scripts/compare_partners.py results/game REWARD_MODEL

The first argument is the results directory of `experiments/game.toml`, of which the tables are printed whose runs are
there; the second is a run of a reward model on TowerFlipIt. Success and rates are in percent, on FlipIt unless named.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import mean
from types import SimpleNamespace
from typing import Any

from lilgym_mp.contrib.report.aggregation import accuracy_where, paired_difference
from lilgym_mp.envs.proposer_verifier import BatchTurn, GameSettings, Partner, Role, play_games, summarise
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.metrics import GameRecord
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.evaluation import Settings, training_statements
from lilgym_mp.evaluation.game_partners import NOISY_ORACLE, SCRIPTED_VERIFIERS, scripted_proposers
from lilgym_mp.evaluation.terminal import table
from lilgym_mp.learning.common.agents import Agent, open_agent
from lilgym_mp.scene.arrays import Int64Array

CONFIGURATION, SCRATCH = "TowerFlipIt", "TowerScratch"
Games = list[GameRecord]


class Messages(BatchPartner):
    """A verifier whose messages, 1 to `count`, are replaced by the next, or by silence."""

    def __init__(self, verifier: BatchPartner, count: int, *, silent: bool) -> None:
        self.verifier, self.count, self.silent = verifier, count, silent

    def batch(self, turn: BatchTurn) -> Int64Array:
        choices, messages = divmod(self.verifier.batch(turn), self.count + 1)
        messages = 0 * messages if self.silent else (messages > 0) * (messages % self.count + 1)
        return choices * (self.count + 1) + messages


def play(agent: Agent, proposer: Partner, verifier: Partner, configuration: str = CONFIGURATION) -> Games:
    """The game that the agent was trained for, on dev."""
    assert agent.game is not None
    settings: GameSettings = replace(agent.game, configuration=configuration, split="dev")
    return play_games(BaseGameEnv(**vars(settings)), proposer, verifier)


def seat(agent: Agent, role: Role, game: GameSettings | None = None) -> Any:
    game = agent.game if game is None else game
    assert game is not None
    partner = agent.partner(role, game)
    assert partner is not None
    return partner


def recordings(runs: Sequence[Games]) -> list[Any]:
    """The games in the form that is aggregated."""

    def episode(game: GameRecord) -> Any:
        return SimpleNamespace(statement=game.statement, is_success=game.outcome is Outcome.SUCCESS)

    return [SimpleNamespace(episodes=tuple(map(episode, games))) for games in runs]


def success(runs: Sequence[Games]) -> str:
    found = accuracy_where(recordings(runs))
    return "-" if found is None else found._replace(deviation=None).text(1)


def by_novelty(runs: Sequence[Games], configuration: str) -> str:
    """Success on statements that are in train verbatim, and on others."""
    seen = training_statements(Settings(configuration, corpus="lilgym", split="dev"))
    found = recordings(runs)
    parts = [accuracy_where(found, lambda each, new=new: (each.statement not in seen) == new) for new in (False, True)]
    return " / ".join("-" if part is None else f"{part.mean:.1f}" for part in parts)


def rates(runs: Sequence[Games]) -> list[str]:
    """By target true / false, means of runs: true claims accepted, false claims rejected; and J of each run."""
    measures = [summarise(games) for games in runs]

    def both(name: str, *, rejected: bool = False) -> str:
        parts: list[str] = []
        for target in ("true", "false"):
            shares = [share for each in measures if (share := each.by_target[target][name]) is not None]
            parts.append(f"{100 * abs(rejected - mean(shares)):.0f}" if shares else "-")
        return " / ".join(parts)

    js = ", ".join("-" if each.j is None else f"{100 * each.j:.0f}" for each in measures)
    return [both("true_accept_rate"), both("false_accept_rate", rejected=True), js]


def joint(runs: Sequence[Agent]) -> Iterator[list[str]]:
    yield ["verifier at test", "Scratch", "seen / unseen", "FlipIt", "seen / unseen"]
    for name in ("the learned one", "oracle", NOISY_ORACLE):
        row = [name]
        for configuration in (SCRATCH, CONFIGURATION):
            verifiers = [SCRIPTED_VERIFIERS.get(name) or seat(run, Role.VERIFIER) for run in runs]
            found = [
                play(run, seat(run, Role.PROPOSER), verifier, configuration)
                for run, verifier in zip(runs, verifiers, strict=True)
            ]
            row += [success(found), by_novelty(found, configuration)]
        yield row


def veto(reward_model: Agent, alone: Sequence[Agent], both: Sequence[Agent]) -> Iterator[list[str]]:
    yield ["proposer trained", "verifier at test", "success", "minus the proposer alone", "seen / unseen", "J"]
    known = {name: [SCRIPTED_VERIFIERS[name]] * len(alone) for name in ("always-accept", "oracle")}
    known["reward model"] = [seat(reward_model, Role.VERIFIER, alone[0].game)] * len(alone)
    known["learned"] = [seat(run, Role.VERIFIER) for run in both]
    baseline: list[Games] | None = None
    for trained, runs in (("alone", alone), ("with a verifier", both)):
        for name in ("always-accept", "learned", "reward model", "oracle"):
            pairs = zip(runs, known[name], strict=True)
            found = [play(run, seat(run, Role.PROPOSER), verifier) for run, verifier in pairs]
            baseline = baseline or found
            row = [trained, name, success(found), "", by_novelty(found, CONFIGURATION), rates(found)[-1]]
            if found is not baseline:
                difference = paired_difference(recordings(found), recordings(baseline))
                assert difference is not None
                row[3] = f"{difference.points:+.1f} [{difference.low:+.1f}, {difference.high:+.1f}]"
            yield row


def audit(reward_model: Agent, runs: Sequence[Agent], independent: Sequence[Agent]) -> Iterator[list[str]]:
    yield ["claims of", "verifier", "true accepted", "false rejected", "J", "success"]
    verifiers = [seat(run, Role.VERIFIER) for run in runs]
    judge = seat(reward_model, Role.VERIFIER, runs[0].game)
    proposers = [seat(run, Role.PROPOSER) for run in runs]
    games = {(p, v): play(runs[0], proposers[p], verifiers[v]) for p in range(len(runs)) for v in range(len(runs))}
    own = [found for (p, v), found in games.items() if p == v]
    yield ["the proposer it learned beside", "learned", *rates(own), success(own)]
    own = [play(run, seat(run, Role.PROPOSER), seat(run, Role.VERIFIER)) for run in independent]
    yield ["the same, networks of their own", "learned", *rates(own), success(own)]
    others = [found for (p, v), found in games.items() if p != v]
    yield ["other seeds' proposers", "learned", *rates(others), success(others)]
    judged = [play(runs[0], proposer, judge) for proposer in proposers]
    yield ["all", "reward model", *rates(judged), success(judged)]
    assert runs[0].game is not None
    experts = [scripted_proposers(runs[0].game.dynamics())[name] for name in ("expert", "expert-deceptive")]
    for name, several in (("learned", verifiers), ("reward model", [judge])):
        found = [[game for expert in experts for game in play(runs[0], expert, verifier)] for verifier in several]
        yield ["two experts, honest and lying", name, *rates(found), success(found)]


def critique(runs: Sequence[Agent], silent: Sequence[Agent]) -> Iterator[list[str]]:
    yield ["messages", "success", "J", "turns"]
    for run in (*runs, *silent):
        assert run.game is not None
        verifier, count = seat(run, Role.VERIFIER), run.game.message_sizes()[Role.VERIFIER]
        played = {"as sent" if count else "none": verifier}
        if count:
            played |= {
                "silenced": Messages(verifier, count, silent=True),
                "permuted": Messages(verifier, count, silent=False),
            }
        for name, partner in played.items():
            found = play(run, seat(run, Role.PROPOSER), partner)
            yield [name, success([found]), rates([found])[-1], f"{summarise(found).mean_rounds:.1f}"]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", metavar="DIR", type=Path)
    parser.add_argument("reward_model", metavar="REWARD_MODEL", type=Path)
    args = parser.parse_args()

    def opened(name: str) -> list[Agent]:
        return [open_agent(path) for path in sorted((args.results / "runs").glob(f"{name}-{CONFIGURATION}-*"))]

    judge, printed = open_agent(args.reward_model), False
    for rows_of, *names in (
        (joint, "joint"),
        (partial(veto, judge), "veto-alone", "veto-both"),
        (partial(audit, judge), "audit", "audit-independent"),
        (critique, "critique", "critique-silent"),
    ):
        if all(runs := [opened(name) for name in names]):
            printed = True
            head, *rows = rows_of(*runs)
            print(table(head, rows), "\n")
    if not printed:
        parser.error(f"{args.results / 'runs'}: no section of the page has all its runs here")
