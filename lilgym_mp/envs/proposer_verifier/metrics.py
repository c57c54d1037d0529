"""Measures of proposers and verifiers, over games played in batches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn, Partner, batch_actions
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, Role
from lilgym_mp.envs.proposer_verifier.rewards import Judgement
from lilgym_mp.envs.resampling import drawn_counts, percentile_interval
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, BoolArray, Float64Array, Int64Array

LARGEST_BATCH = 1024
RESAMPLES = 1_000

Interval = tuple[float, float]


class GameRecord(NamedTuple):
    """The record of one game."""

    task: str
    statement: str
    target: bool
    outcome: Outcome | str  # a text of its own where a partner ended the game without an action
    rounds: int
    returns: tuple[float, float]  # indexed by role
    judgements: tuple[Judgement, ...]

    @property
    def accepted_false_claim(self) -> bool:
        """Whether the game ended in a false claim that the verifier accepted."""
        return any(judged.final and judged.accepted and not judged.holds for judged in self.judgements[-1:])


@dataclass(frozen=True)
class Metrics:
    """Measures over games. Rates are None if there are no claims to compute them from.

    docs/proposer_verifier.md defines the claims of each protocol. In FlipIt the target alone predicts whether a claim
    holds, so the pooled rates mislead: compare `j`.

    Attributes:
        games: Number of games.
        success_rate: Share of games that end in success of the MDP.
        success_interval: 95 %, resampling statements, like `j_interval`.
        mean_rounds: Mean number of rounds.
        mean_return_proposer: Mean sum of the proposer's rewards.
        mean_return_verifier: Mean sum of the verifier's rewards.
        claims: Number of judged claims.
        true_accept_rate: Share of true claims that were accepted; the others are false rejects.
        false_accept_rate: Share of false claims that were accepted.
        j: Youden's J, the rates' difference: mean over targets, None unless each has true and false claims.
        j_interval: The interval of `j`.
        accepted_false_claims: Share of games that end in an accepted false claim.
        by_target: Games, success_rate, both rates and j by "true" and "false", if played.
    """

    games: int
    success_rate: float  # the MDP's
    success_interval: Interval  # 95 %, resampling statements, like `j_interval`
    mean_rounds: float
    mean_return_proposer: float
    mean_return_verifier: float
    claims: int
    true_accept_rate: float | None  # share of true claims that were accepted; the others are false rejects
    false_accept_rate: float | None  # share of false claims that were accepted
    j: float | None  # Youden's J, the rates' difference: mean over targets, None unless each has true and false claims
    j_interval: Interval | None
    accepted_false_claims: float  # share of games that end in an accepted false claim
    by_target: Mapping[str, AnyMapping]  # games, success_rate, both rates and j by "true" and "false", if played


def play_games(
    env: Any, proposer: Partner, verifier: Partner, *, tasks: Iterable[str] | None = None, seed: int = 0
) -> list[GameRecord]:
    """Plays each task once (None: all of the split, in file order), reproducibly for a given seed.

    `env`: a PettingZoo environment of the game, for its settings and tasks; its current game and its wrappers do not
    matter. Games are played in batches, but each has its own random generator, so records do not depend on other games.
    A game that a partner ends (`BatchTurn.endings`) has that outcome, and both get the reward of an illegal action.
    Raises PartnerError for illegal actions.
    """
    game_env = getattr(env, "unwrapped", env)
    if not isinstance(game_env, BaseGameEnv):
        raise TypeError(f"play_games needs a proposer-verifier environment, not {env!r}")
    game = game_env.engine.game.revealing_truth()
    indices = np.array([game.tasks.index_of(task) for task in (game.tasks.ids if tasks is None else tasks)], np.int64)
    records: list[GameRecord] = []
    for first in range(0, len(indices), LARGEST_BATCH):
        played = indices[first : first + LARGEST_BATCH]
        numbers = first + np.arange(len(played))
        records += _play_batch(game, (proposer, verifier), played, numbers, seed)
    return records


def _play_batch(
    game: Game, partners: tuple[Partner, Partner], tasks: Int64Array, numbers: Int64Array, seed: int
) -> list[GameRecord]:
    """The records of games (k,) of these tasks and numbers; a game that has ended goes on, unrecorded."""
    count = len(tasks)
    games = ObservedGames(game, len(tasks))
    rngs = [np.random.default_rng([seed, number]) for number in numbers.tolist()]
    intents = np.array([int(game.sample_intent(rng)) for rng in rngs], np.int64)
    games.start(np.arange(count), tasks, intents)
    returns = np.zeros((len(Role), count))
    judgements = [list[Judgement]() for _ in rngs]
    records: dict[int, GameRecord] = {}
    active = np.ones(count, bool)
    illegal = game.dynamics.rules.signals[Outcome.INVALID_ACTION].reward

    def record(index: int, outcome: Outcome | str) -> None:
        task = game.tasks[int(tasks[index])]
        earned = tuple(returns[:, index].tolist())
        rounds = int(games.rounds[index])
        judged = tuple(judgements[index])
        records[index] = GameRecord(task.id, task.statement, task.target, outcome, rounds, earned, judged)

    while active.any():
        actions = np.zeros((len(Role), count), np.int64)
        for role, partner in zip(Role, partners, strict=True):
            moving = np.flatnonzero(games.movers[role] & active)
            if len(moving):
                turn = BatchTurn(games, role, moving, numbers[moving], [rngs[index] for index in moving.tolist()])
                actions[role, moving] = batch_actions(partner, turn)
                for index, ending in turn.endings.items():
                    active[index] = False
                    returns[:, index] += illegal
                    record(index, ending)
        games.step(*actions)
        returns += games.rewards * active
        for index in np.flatnonzero(active & (games.verdicts != NO_CHOICE)).tolist():
            judgement = games.last_judgement(index)
            assert judgement is not None
            judgements[index].append(judgement)
        over = games.terminated | games.truncated
        for index in np.flatnonzero(active & over).tolist():
            outcome = games.last_outcome(index)
            assert outcome is not None
            record(index, outcome)
        active &= ~over
        if over.any():
            ended = np.flatnonzero(over)
            games.start(ended, tasks[ended], intents[ended])
    return [records[index] for index in range(count)]


def summarise(records: Sequence[GameRecord]) -> Metrics:
    """The measures of these games. Raises ValueError if there are none."""
    if not records:
        raise ValueError("cannot summarise zero games")
    counts = _counts_by_statement(records)  # (statements, targets, counts)
    total = counts.sum(0)
    resampled = np.einsum("bs,stc->btc", drawn_counts(len(counts), RESAMPLES), counts)  # statements with replacement
    j, js = (mean_j(each, each[..., 0] > 0) for each in (total, resampled))
    has_j = not np.isnan(j)
    measures: AnyDict = {**_measures(total.sum(0)), "j": float(j) if has_j else None}
    proposer_return, verifier_return = np.array([record.returns for record in records]).mean(0).tolist()
    return Metrics(
        **measures,
        success_interval=percentile_interval(claim_rates(resampled.sum(1))["success_rate"]),
        mean_rounds=float(np.mean([record.rounds for record in records])),
        mean_return_proposer=proposer_return,
        mean_return_verifier=verifier_return,
        claims=sum(len(record.judgements) for record in records),
        j_interval=percentile_interval(js[~np.isnan(js)]) if has_j else None,
        accepted_false_claims=float(np.mean([record.accepted_false_claim for record in records])),
        by_target={name: _measures(row) for name, row in (("true", total[1]), ("false", total[0])) if row[0]},
    )


def _counts_by_statement(records: Sequence[GameRecord]) -> Float64Array:
    """(statements, 2, 6) counts by statement and target value: games, successes, and true and false claims, each
    followed by how many of them were accepted."""
    statements = {statement: index for index, statement in enumerate(dict.fromkeys(r.statement for r in records))}
    counts = np.zeros((len(statements), 2, 6))
    for record in records:
        row = counts[statements[record.statement], int(record.target)]
        row[:2] += 1, record.outcome is Outcome.SUCCESS
        for judgement in record.judgements:
            first = 2 if judgement.holds else 4
            row[first : first + 2] += 1, judgement.accepted
    return counts


def claim_rates(counts: Float64Array) -> dict[str, Float64Array]:
    """(...) the rates from counts (..., 6); NaN without games, or true or false claims, to compute them from."""
    games, successes, true, true_accepted, false, false_accepted = np.moveaxis(counts, -1, 0)
    with np.errstate(invalid="ignore"):
        success = successes / games
        true_accepts = true_accepted / true
        false_accepts = false_accepted / false
    names = ("success_rate", "true_accept_rate", "false_accept_rate", "j")
    return dict(zip(names, (success, true_accepts, false_accepts, true_accepts - false_accepts), strict=True))


def _measures(counts: Float64Array) -> AnyDict:
    """The measures that counts (6,) determine, None for NaN."""
    rates = {name: None if np.isnan(rate) else float(rate) for name, rate in claim_rates(counts).items()}
    return {"games": int(counts[0]), **rates}


def mean_j(counts: Float64Array, averaged: BoolArray) -> Float64Array:
    """(...) the mean J over the target values in the mask, from counts (..., 2, 6); NaN where one's is."""
    with np.errstate(invalid="ignore"):
        return np.where(averaged, claim_rates(counts)["j"], 0).sum(-1) / averaged.sum(-1)


def measure(env: Any, proposer: Partner, verifier: Partner, **kwargs: Any) -> Metrics:
    """Plays games and measures them.

    Args:
        env: A PettingZoo environment of the game, for its settings and tasks.
        proposer: Partner that plays the proposer.
        verifier: Partner that plays the verifier.
        kwargs: `tasks` and `seed` of `play_games`.

    Returns:
        The measures of the games.

    Raises:
        TypeError: For another environment.
        PartnerError: For illegal actions.
    """
    return summarise(play_games(env, proposer, verifier, **kwargs))
