"""Play the pairs of docs/game_experiments.md on the official dev split, and print the figures of the page.

    python scripts/compare_partners.py results/game REWARD_MODEL
    python scripts/compare_partners.py

The first argument is the results directory of `experiments/game.toml`, of which the experiments are played whose runs
are there; the second is a run of a reward model on TowerFlipIt. docs/results/games.csv gets their games, in place of
earlier ones; without arguments the figures are those of this file.

A row of the file is a pair of proposer and verifier. It has a word for each start scene, in the order of the file:
whether the game succeeded (1 or 0), then a letter for each claim that the verifier judged: `a` accepted or `r`
rejected, a capital if the claim was true. The two experts play as one proposer, each every scene.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from statistics import mean
from types import SimpleNamespace
from typing import Any, NamedTuple

from write_result_tables import read, tasks, write

from lilgym_mp.contrib.report.aggregation import accuracy_where, paired_difference
from lilgym_mp.envs.proposer_verifier import GameRecord, GameSettings, Partner, Role, play_games, summarise
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.rewards import Judgement
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.evaluation.game_partners import (
    MESSAGE_CHANGES,
    NOISY_ORACLE,
    SCRIPTED_VERIFIERS,
    ChangedMessages,
    scripted_proposers,
)
from lilgym_mp.evaluation.recording_metadata import commit
from lilgym_mp.evaluation.results import rounded
from lilgym_mp.evaluation.terminal import table
from lilgym_mp.learning.common.agents import Agent, open_agent
from lilgym_mp.scene.grouping import grouped

CONFIGURATION, SCRATCH = "TowerFlipIt", "TowerScratch"
EXPERIMENTS = {  # the runs of each
    "joint": ("joint",),
    "veto": ("veto-alone", "veto-both"),
    "audit": ("audit", "audit-independent"),
    "critique": ("critique", "critique-silent"),
}
COLUMNS = {  # of the page's table of an experiment
    "joint": ("success", "seen / unseen"),
    "veto": ("success", "difference"),
    "audit": ("true claims accepted", "false claims rejected", "J"),
    "critique": ("success",),
}
ALONE = ("veto", "veto-alone", "always-accept")  # the pairs that the others of veto are compared with
JUDGE = "reward-model"
Runs = dict[str, Agent]


class Pair(NamedTuple):
    """The games of a proposer with a verifier."""

    experiment: str
    proposer: str  # name of a run, or of a scripted agent
    verifier: str
    configuration: str
    commit: str  # of the code that played
    games: str

    @property
    def group(self) -> tuple[str, str, str, str]:
        """What it shares with the pairs of other seeds: the kinds of agents, and the configuration."""
        proposer, verifier = (re.sub(rf"-{CONFIGURATION}-\d+", "", name) for name in self[1:3])
        itself = self.proposer == self.verifier
        return self.experiment, proposer, "itself" if itself else verifier, self.configuration

    def records(self) -> list[GameRecord]:
        """The games, as far as they are needed for success and rates."""
        return list(map(_record, cycle(tasks(self.configuration)), self.games.split()))


def _record(task: Any, game: str) -> GameRecord:
    success, *claims = game
    outcome = Outcome.SUCCESS if success == "1" else Outcome.WRONG_STOP
    judged = tuple(Judgement(claim in "aA", final=False, holds=claim.isupper()) for claim in claims)
    return GameRecord(task.id, task.statement, task.target, outcome, 1, (0.0, 0.0), judged)


def text(records: Iterable[GameRecord]) -> str:
    """Games as games.csv has them."""

    def letter(judged: Judgement) -> str:
        found = "a" if judged.accepted else "r"
        return found.upper() if judged.holds else found

    return " ".join(
        "".join((str(int(record.outcome is Outcome.SUCCESS)), *map(letter, record.judgements))) for record in records
    )


def play(agent: Agent, proposer: Partner, verifier: Partner, configuration: str) -> list[GameRecord]:
    """The game that the agent was trained for, on dev."""
    assert agent.game is not None
    settings = replace(agent.game, configuration=configuration, split="dev")
    return play_games(BaseGameEnv(**vars(settings)), proposer, verifier)


def seat(agent: Agent, role: Role, game: GameSettings | None = None) -> Any:
    game = agent.game if game is None else game
    assert game is not None
    partner = agent.partner(role, game)
    assert partner is not None
    return partner


def pair(experiment: str, proposer: str, verifier: str, configuration: str, games: Iterable[GameRecord]) -> Pair:
    return Pair(experiment, proposer, verifier, configuration, commit() or "", text(games))


def joint(runs: Runs) -> Iterator[Pair]:
    for configuration in (SCRATCH, CONFIGURATION):
        for name, run in runs.items():
            verifiers = {name: seat(run, Role.VERIFIER)}
            verifiers |= {scripted: SCRIPTED_VERIFIERS[scripted] for scripted in ("oracle", NOISY_ORACLE)}
            for verifier, partner in verifiers.items():
                games = play(run, seat(run, Role.PROPOSER), partner, configuration)
                yield pair("joint", name, verifier, configuration, games)


def veto(judge: Agent, alone: Runs, both: Runs) -> Iterator[Pair]:
    known = {name: SCRIPTED_VERIFIERS[name] for name in ("always-accept", "oracle")}
    for runs in (alone, both):
        for (name, run), (other, learned) in zip(runs.items(), both.items(), strict=True):
            verifiers = {**known, JUDGE: seat(judge, Role.VERIFIER, run.game), other: seat(learned, Role.VERIFIER)}
            for verifier, partner in verifiers.items():
                games = play(run, seat(run, Role.PROPOSER), partner, CONFIGURATION)
                yield pair("veto", name, verifier, CONFIGURATION, games)


def audit(judge: Agent, runs: Runs, independent: Runs) -> Iterator[Pair]:
    first = next(iter(runs.values()))
    assert first.game is not None
    verifiers = {name: seat(run, Role.VERIFIER) for name, run in runs.items()}
    verifiers |= {JUDGE: seat(judge, Role.VERIFIER, first.game)}
    experts = [scripted_proposers(first.game.dynamics())[name] for name in ("expert", "expert-deceptive")]
    for verifier, partner in verifiers.items():
        for name, run in runs.items():
            games = play(first, seat(run, Role.PROPOSER), partner, CONFIGURATION)
            yield pair("audit", name, verifier, CONFIGURATION, games)
        games = [game for expert in experts for game in play(first, expert, partner, CONFIGURATION)]
        yield pair("audit", "experts", verifier, CONFIGURATION, games)
    for name, run in independent.items():
        games = play(run, seat(run, Role.PROPOSER), seat(run, Role.VERIFIER), CONFIGURATION)
        yield pair("audit", name, name, CONFIGURATION, games)


def critique(runs: Runs, silent: Runs) -> Iterator[Pair]:
    for name, run in (runs | silent).items():
        verifier = seat(run, Role.VERIFIER)
        partners = {name: verifier}
        if name in runs:
            partners |= {f"{name} {change}": ChangedMessages(verifier, change) for change in MESSAGE_CHANGES}
        for other, partner in partners.items():
            games = play(run, seat(run, Role.PROPOSER), partner, CONFIGURATION)
            yield pair("critique", name, other, CONFIGURATION, games)


def pairs_of(directory: Path, judge: Agent) -> Iterator[Pair]:
    """The pairs of the experiments whose runs are there."""
    for experiment, names in EXPERIMENTS.items():
        paths = [sorted(directory.glob(f"{name}-{CONFIGURATION}-*")) for name in names]
        if not all(paths):
            continue
        runs = [{path.name: open_agent(path) for path in group} for group in paths]
        if experiment == "joint":
            yield from joint(*runs)
        elif experiment == "veto":
            yield from veto(judge, *runs)
        elif experiment == "audit":
            yield from audit(judge, *runs)
        else:
            yield from critique(*runs)


def recordings(runs: Sequence[Sequence[GameRecord]]) -> list[Any]:
    """The games in the form that is aggregated."""

    def episode(game: GameRecord) -> Any:
        return SimpleNamespace(statement=game.statement, is_success=game.outcome is Outcome.SUCCESS)

    return [SimpleNamespace(episodes=tuple(map(episode, games))) for games in runs]


def success(runs: Sequence[Any], seen: set[str]) -> tuple[str, str]:
    """Success in percent with its interval, and on statements that are in train verbatim, and on others."""
    known = accuracy_where(runs, lambda each: each.statement in seen)
    new = accuracy_where(runs, lambda each: each.statement not in seen)
    everywhere = accuracy_where(runs)
    assert everywhere is not None
    parts = ("-" if part is None else rounded(part.mean, 1) for part in (known, new))
    return everywhere._replace(deviation=None).text(1), " / ".join(parts)


def rates(runs: Sequence[Sequence[GameRecord]]) -> tuple[str, str, str]:
    """By target true / false, means of runs: true claims accepted, false claims rejected; and J of each run."""
    measures = [summarise(games) for games in runs]

    def both(name: str, *, rejected: bool = False) -> str:
        parts: list[str] = []
        for target in ("true", "false"):
            found = (each.by_target.get(target, {}).get(name) for each in measures)
            shares = [share for share in found if share is not None]
            parts.append(rounded(100 * abs(rejected - mean(shares)), 0) if shares else "-")
        return " / ".join(parts)

    js = [100 * each.j for each in measures if each.j is not None]
    shown = ", ".join("-" if each.j is None else rounded(100 * each.j, 0) for each in measures)
    if len(measures) > 3 and js:
        shown = f"{rounded(min(js), 0)} to {rounded(max(js), 0)}, mean {rounded(mean(js), 0)}"
    return both("true_accept_rate"), both("false_accept_rate", rejected=True), shown


def figures(pairs: Iterable[Pair]) -> dict[tuple[str, ...], dict[str, str]]:
    """The figures of the pairs that differ in their seeds alone, by name."""
    groups = {group: [pair.records() for pair in of] for group, of in grouped((p.group, p) for p in pairs).items()}
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for group, runs in groups.items():
        seen = {task.statement for task in tasks(group[-1], "train")}
        values = *success(recordings(runs), seen), *rates(runs)
        found[group] = dict(zip(("success", "seen / unseen", *COLUMNS["audit"]), values, strict=True))
        baseline = groups.get((*ALONE, CONFIGURATION)) if group[0] == "veto" else None
        if baseline is not None and baseline is not runs:
            difference = paired_difference(recordings(runs), recordings(baseline))
            assert difference is not None
            points, low, high = (f"{float(rounded(value, 1)):+.1f}" for value in difference[:3])
            found[group]["difference"] = f"{points} [{low}, {high}]"
    return found


def cells(pairs: Iterable[Pair]) -> Iterator[str]:
    """The cells of the page's tables, a text for each line or, in joint, configuration."""
    for group, values in figures(pairs).items():
        yield " | ".join(values[name] for name in COLUMNS[group[0]] if name in values)


def saved() -> list[Pair]:
    return [Pair(*row) for row in read("games")[1:]]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", metavar="DIR", type=Path, nargs="?")
    parser.add_argument("reward_model", metavar="REWARD_MODEL", type=Path, nargs="?")
    args = parser.parse_args()
    if args.results is not None:
        if args.reward_model is None:
            parser.error("DIR needs REWARD_MODEL")
        made = list(pairs_of(args.results / "runs", open_agent(args.reward_model)))
        if not made:
            parser.error(f"{args.results / 'runs'}: no experiment of the page has all its runs here")
        played = {pair.experiment for pair in made}
        pairs = sorted([*(pair for pair in saved() if pair.experiment not in played), *made])
        write("games", [Pair._fields, *pairs])
    names = ("success", "difference", "seen / unseen", *COLUMNS["audit"])
    lines = [[*group, *(values.get(name, "") for name in names)] for group, values in figures(saved()).items()]
    print(table(["experiment", "proposer", "verifier", "configuration", *names], lines))
