"""Measures of proposers and verifiers, over games played in batches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn, OracleVerifier, Partner, batch_actions
from lilgym_mp.envs.proposer_verifier.protocols import Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent, Judgement
from lilgym_mp.envs.proposer_verifier.settings import GameSetup
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.scene.arrays import Float64Array, Int64Array

CALIBRATION_BINS = 10
LARGEST_BATCH = 256
RESAMPLES = 1_000
INTERVAL = (2.5, 97.5)  # percentiles

Interval = tuple[float, float]


class GameRecord(NamedTuple):
    """The record of one game."""

    task: str
    statement: str
    target: bool
    outcome: Outcome
    rounds: int
    returns: tuple[float, float]  # by Role
    judgements: tuple[Judgement, ...]

    @property
    def accepted_false_claim(self) -> bool:
        """Whether the game ended in a false claim that the verifier accepted."""
        return any(judged.final and judged.accepted and not judged.holds for judged in self.judgements[-1:])


class CalibrationBin(NamedTuple):
    """The judgements with probabilities in one of ten equal bins."""

    count: int
    mean_probability: float
    share_holding: float


class TargetMetrics(NamedTuple):
    """Measures over the games with one target value; None if there are no claims to compute them from."""

    games: int
    success_rate: float
    completeness: float | None
    soundness: float | None
    j: float | None  # Youden's J, completeness + soundness - 1: 0 for a verifier whose answers tell nothing


@dataclass(frozen=True)
class Metrics:
    """Measures over games. Rates are None if there are no claims to compute them from.

    Completeness is the share of true claims that were accepted, soundness the share of false ones that were not;
    docs/proposer_verifier.md defines the claims of each protocol. In FlipIt the target alone predicts whether a claim
    holds, so the pooled rates mislead: compare `j`.
    """

    games: int
    success_rate: float  # the MDP's
    success_interval: Interval  # 95 %, resampling statements, like `j_interval`
    mean_rounds: float
    mean_return_proposer: float
    mean_return_verifier: float
    claims: int
    completeness: float | None
    soundness: float | None
    false_accept_rate: float | None
    false_reject_rate: float | None
    j: float | None  # mean over target values, None unless each has true and false claims
    j_interval: Interval | None
    accepted_false_claims: float  # share of games that end in an accepted false claim
    by_target: Mapping[str, TargetMetrics]  # by "true" and "false", those that occur
    brier_score: float | None  # mean squared difference between stated probability and truth
    calibration_error: float | None  # mean |mean_probability - share_holding| of the bins, weighted by count
    calibration: tuple[CalibrationBin, ...]

    def to_json(self) -> dict[str, Any]:
        return asdict(self) | {
            "by_target": {name: measured._asdict() for name, measured in self.by_target.items()},
            "calibration": [entry._asdict() for entry in self.calibration],
        }


def play_games(
    env: Any, proposer: Partner, verifier: Partner, *, tasks: Iterable[str] | None = None, seed: int = 0
) -> list[GameRecord]:
    """Plays each task once (None: all of the split, in file order), reproducibly for a given seed.

    `env`: a PettingZoo environment of the game, for its settings and tasks; its current game and its wrappers do not
    matter. Games are played in batches, but each has its own random generator, so records do not depend on other games.
    Raises PartnerError for illegal actions.
    """
    game_env = getattr(env, "unwrapped", env)
    if not isinstance(game_env, BaseGameEnv):
        raise TypeError(f"play_games needs a proposer-verifier environment, not {env!r}")
    setup = replace(game_env.engine.setup, reveals_truth=True)
    ids = setup.tasks.ids if tasks is None else tuple(tasks)
    return _Match(setup, (proposer, verifier), [setup.tasks.index_of(task) for task in ids], seed).play() if ids else []


class _Match:
    """Plays games of two partners; a slot of the batch whose game has ended plays the next one."""

    def __init__(self, setup: GameSetup, partners: tuple[Partner, Partner], tasks: Sequence[int], seed: int) -> None:
        self._setup, self._partners, self._tasks = setup, partners, np.array(tasks, np.int64)
        self._slots = min(len(tasks), LARGEST_BATCH)
        self._games = ObservedGames(setup, self._slots)
        self._rngs = [np.random.default_rng([seed, number]) for number in range(len(tasks))]
        self._playing = np.arange(self._slots)  # (slots,) number of the game played, -1 if none is left
        self._next = self._slots
        self._returns = np.zeros((len(Role), len(tasks)))
        self._judgements: list[list[Judgement]] = [[] for _ in tasks]
        self._records: list[GameRecord | None] = [None] * len(tasks)

    def play(self) -> list[GameRecord]:
        self._start(np.arange(self._slots))
        while (self._playing >= 0).any():
            actions = np.zeros((len(Role), self._slots), np.int64)
            for role, partner in zip(Role, self._partners, strict=True):
                moving = np.flatnonzero(self._games.movers[role] & (self._playing >= 0))
                if len(moving):
                    actions[role, moving] = batch_actions(partner, self._turn(role, moving))
            self._games.step(*actions)
            self._record()
        return [record for record in self._records if record is not None]

    def _start(self, slots: Int64Array) -> None:
        """Starts the games that these slots play; slots without one repeat the first task, unrecorded."""
        numbers = self._playing[slots]
        intents = [
            Intent.HELPFUL if number < 0 else self._setup.sample_intent(self._rngs[number])
            for number in numbers.tolist()
        ]
        self._games.start(slots, self._tasks[np.maximum(numbers, 0)], np.array(intents, np.int64))

    def _turn(self, role: Role, slots: Int64Array) -> BatchTurn:
        numbers = self._playing[slots]
        rngs = [self._rngs[number] for number in numbers.tolist()]
        return BatchTurn(self._games, role, slots, numbers, rngs)

    def _record(self) -> None:
        """Notes the turn just played, and starts the next games in slots whose game has ended."""
        games, numbers = self._games, self._playing
        active = np.flatnonzero(numbers >= 0)
        self._returns[:, numbers[active]] += games.rewards[:, active]
        for slot in active[~np.isnan(games.probabilities[active])].tolist():
            judgement = games.last_judgement(slot)
            assert judgement is not None
            self._judgements[numbers[slot]].append(judgement)
        ended = np.flatnonzero(games.terminated | games.truncated)
        for slot in ended.tolist():
            number = int(numbers[slot])
            if number >= 0:
                self._records[number] = self._finished(slot, number)
                self._playing[slot] = self._next if self._next < len(self._tasks) else -1
                self._next += 1
        if len(ended):
            self._start(ended)

    def _finished(self, slot: int, number: int) -> GameRecord:
        task = self._setup.tasks[int(self._tasks[number])]
        outcome = self._games.last_outcome(slot)
        assert outcome is not None
        proposer_return, verifier_return = self._returns[:, number].tolist()
        return GameRecord(
            task.id,
            task.statement,
            task.target,
            outcome,
            int(self._games.rounds[slot]),
            (proposer_return, verifier_return),
            tuple(self._judgements[number]),
        )


def summarise(records: Sequence[GameRecord]) -> Metrics:
    """The measures of these games. Raises ValueError if there are none."""
    if not records:
        raise ValueError("cannot summarise zero games")
    judgements = [judgement for record in records for judgement in record.judgements]
    probability = np.array([judgement.probability for judgement in judgements])
    holds = np.array([judgement.holds for judgement in judgements], np.bool_)
    counts = _counts_by_statement(records)  # (statements, targets, counts)
    total = counts.sum(0)
    completeness, soundness, _ = map(_or_none, _rates(total.sum(0)))
    j = _or_none(_mean_j(total))
    calibration = _calibration(probability, holds)
    gaps = [entry.count * abs(entry.mean_probability - entry.share_holding) for entry in calibration]
    returns = np.array([record.returns for record in records]).mean(0)
    resampled = _resampled(counts)  # (RESAMPLES, targets, counts)
    js = _mean_j(resampled)
    return Metrics(
        games=len(records),
        success_rate=float(_success_rate(total.sum(0))),
        success_interval=_interval(_success_rate(resampled.sum(1))),
        mean_rounds=float(np.mean([record.rounds for record in records])),
        mean_return_proposer=float(returns[Role.PROPOSER]),
        mean_return_verifier=float(returns[Role.VERIFIER]),
        claims=len(judgements),
        completeness=completeness,
        soundness=soundness,
        false_accept_rate=None if soundness is None else 1 - soundness,
        false_reject_rate=None if completeness is None else 1 - completeness,
        j=j,
        j_interval=None if j is None else _interval(js[~np.isnan(js)]),
        accepted_false_claims=float(np.mean([record.accepted_false_claim for record in records])),
        by_target={
            str(target).lower(): TargetMetrics(int(row[_GAMES]), float(_success_rate(row)), *map(_or_none, _rates(row)))
            for target, row in ((True, total[1]), (False, total[0]))
            if row[_GAMES]
        },
        brier_score=float(np.mean((probability - holds) ** 2)) if judgements else None,
        calibration_error=sum(gaps) / len(judgements) if judgements else None,
        calibration=calibration,
    )


# Columns of counts.
_GAMES, _SUCCESSES, _TRUE_CLAIMS, _TRUE_ACCEPTED, _FALSE_CLAIMS, _FALSE_REFUSED = range(6)


def _counts_by_statement(records: Sequence[GameRecord]) -> Float64Array:
    """(statements, 2, 6) counts by statement and target value."""
    statements = {statement: index for index, statement in enumerate(dict.fromkeys(r.statement for r in records))}
    counts = np.zeros((len(statements), 2, 6))
    for record in records:
        row = counts[statements[record.statement], int(record.target)]
        row[_GAMES] += 1
        row[_SUCCESSES] += record.outcome is Outcome.SUCCESS
        for judgement in record.judgements:
            row[_TRUE_CLAIMS if judgement.holds else _FALSE_CLAIMS] += 1
            if judgement.accepted == judgement.holds:
                row[_TRUE_ACCEPTED if judgement.holds else _FALSE_REFUSED] += 1
    return counts


def _rates(counts: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(...) completeness, soundness and J of counts (..., 6); NaN without true or false claims."""
    with np.errstate(invalid="ignore"):
        completeness = counts[..., _TRUE_ACCEPTED] / counts[..., _TRUE_CLAIMS]
        soundness = counts[..., _FALSE_REFUSED] / counts[..., _FALSE_CLAIMS]
    return completeness, soundness, completeness + soundness - 1


def _success_rate(counts: Float64Array) -> Float64Array:
    """(...) of counts (..., 6)."""
    return counts[..., _SUCCESSES] / counts[..., _GAMES]


def _mean_j(counts: Float64Array) -> Float64Array:
    """(...) the mean J of the target values that occur, from counts (..., 2, 6); NaN where one's is."""
    played = counts[..., _GAMES] > 0
    return np.where(played, _rates(counts)[2], 0).sum(-1) / played.sum(-1)


def _resampled(counts: Float64Array) -> Float64Array:
    """(RESAMPLES, 2, 6) counts of statements drawn with replacement, always the same draws."""
    statements = len(counts)
    weights = np.random.default_rng(0).multinomial(statements, np.full(statements, 1 / statements), size=RESAMPLES)
    return np.einsum("bs,stc->btc", weights.astype(np.float64), counts)


def _interval(values: NDArray[Any]) -> Interval:
    low, high = np.percentile(values, INTERVAL)
    return float(low), float(high)


def _or_none(value: Float64Array) -> float | None:
    return None if np.isnan(value) else float(value)


def measure(env: Any, proposer: Partner, verifier: Partner, **kwargs: Any) -> Metrics:
    """The measures of the games of `play_games`, with the same arguments."""
    return summarise(play_games(env, proposer, verifier, **kwargs))


def cross_play(
    env: Any, proposers: Mapping[str, Partner], verifiers: Mapping[str, Partner], **kwargs: Any
) -> dict[tuple[str, str], Metrics]:
    """The measures of every proposer with every verifier, by their names; keywords as for `play_games`."""
    return {
        (proposer, verifier): measure(env, proposers[proposer], verifiers[verifier], **kwargs)
        for proposer in proposers
        for verifier in verifiers
    }


def exploitability(env: Any, proposer: Partner, verifier: Partner, **kwargs: Any) -> float:
    """How much more the proposer earns per game against `verifier` than against an oracle verifier.

    0 if it cannot exploit the verifier's errors. Arguments as for `play_games`.
    """
    against_verifier, against_oracle = (
        measure(env, proposer, opponent, **kwargs).mean_return_proposer for opponent in (verifier, OracleVerifier())
    )
    return against_verifier - against_oracle


def _calibration(probability: np.ndarray, holds: np.ndarray) -> tuple[CalibrationBin, ...]:
    """The non-empty bins."""
    bins = np.minimum((probability * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    return tuple(
        CalibrationBin(int(members.sum()), float(probability[members].mean()), float(holds[members].mean()))
        for members in (bins == index for index in np.unique(bins))
    )
