"""Measures of verifiers, and the exploitability of their errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv, GameEngine
from lilgym_mp.envs.proposer_verifier.partners import OracleVerifier, Partner, PartnerTurn, partner_action
from lilgym_mp.envs.proposer_verifier.protocols import Role
from lilgym_mp.envs.proposer_verifier.rewards import ACCEPTANCE_THRESHOLD, Judgement
from lilgym_mp.rules import Outcome

CALIBRATION_BINS = 10


class GameRecord(NamedTuple):
    """The record of one game."""

    task: str
    outcome: Outcome
    rounds: int
    returns: tuple[float, float]  # by Role
    judgements: tuple[Judgement, ...]


class CalibrationBin(NamedTuple):
    """The judgements with probabilities in one of ten equal bins."""

    count: int
    mean_probability: float
    share_holding: float


@dataclass(frozen=True)
class Metrics:
    """Measures over games. Rates are None if there are no claims to compute them from.

    Completeness is the share of true claims that were accepted, soundness the share of false ones that were not;
    docs/proposer_verifier.md defines the claims of each protocol.
    """

    games: int
    success_rate: float  # the MDP's
    mean_rounds: float
    mean_return_proposer: float
    mean_return_verifier: float
    claims: int
    completeness: float | None
    soundness: float | None
    false_accept_rate: float | None
    false_reject_rate: float | None
    brier_score: float | None  # mean squared difference between stated probability and truth
    calibration_error: float | None  # mean |mean_probability - share_holding| of the bins, weighted by count
    calibration: tuple[CalibrationBin, ...]

    def to_json(self) -> dict[str, Any]:
        return asdict(self) | {"calibration": [entry._asdict() for entry in self.calibration]}


def play_games(
    env: Any, proposer: Partner, verifier: Partner, *, tasks: Iterable[str] | None = None, seed: int = 0
) -> list[GameRecord]:
    """Plays each task once (None: all of the split, in file order), reproducibly for a given seed.

    `env`: the game; do not step it elsewhere meanwhile. Raises PartnerError for illegal actions.
    """
    game_env = getattr(env, "unwrapped", env)
    if not isinstance(game_env, BaseGameEnv):
        raise TypeError(f"play_games needs a proposer-verifier environment, not {env!r}")
    engine = game_env.engine
    engine.reset(seed, None)
    rng = np.random.default_rng(seed)
    return [_play_game(engine, proposer, verifier, task, rng) for task in (tasks or game_env.tasks.ids)]


def _play_game(
    engine: GameEngine, proposer: Partner, verifier: Partner, task: str, rng: np.random.Generator
) -> GameRecord:
    engine.reset(None, {"task": task})
    returns = np.zeros(len(Role))
    judgements: list[Judgement] = []
    while engine.state.movers:
        actions = {
            role: partner_action(partner, PartnerTurn(engine, role, rng)) if role in engine.state.movers else None
            for role, partner in zip(Role, (proposer, verifier), strict=True)
        }
        step = engine.step(actions[Role.PROPOSER], actions[Role.VERIFIER])
        returns += step.rewards
        if (judgement := step.judgement) is not None:
            judgements.append(judgement)
    last = engine.last_step
    assert last is not None
    assert last.transition is not None
    proposer_return, verifier_return = returns.tolist()
    return GameRecord(
        task, last.transition.outcome, engine.state.mdp.steps, (proposer_return, verifier_return), tuple(judgements)
    )


def summarise(records: Sequence[GameRecord]) -> Metrics:
    """The measures of these games. Raises ValueError if there are none."""
    if not records:
        raise ValueError("cannot summarise zero games")
    judgements = [judgement for record in records for judgement in record.judgements]
    probability = np.array([judgement.probability for judgement in judgements])
    holds = np.array([judgement.holds for judgement in judgements], np.bool_)
    accepted = probability > ACCEPTANCE_THRESHOLD
    completeness, soundness = _share(accepted[holds]), _share(~accepted[~holds])
    calibration = _calibration(probability, holds)
    gaps = [entry.count * abs(entry.mean_probability - entry.share_holding) for entry in calibration]
    returns = np.mean([record.returns for record in records], axis=0)
    return Metrics(
        games=len(records),
        success_rate=float(np.mean([record.outcome is Outcome.SUCCESS for record in records])),
        mean_rounds=float(np.mean([record.rounds for record in records])),
        mean_return_proposer=float(returns[Role.PROPOSER]),
        mean_return_verifier=float(returns[Role.VERIFIER]),
        claims=len(judgements),
        completeness=completeness,
        soundness=soundness,
        false_accept_rate=None if soundness is None else 1 - soundness,
        false_reject_rate=None if completeness is None else 1 - completeness,
        brier_score=float(np.mean((probability - holds) ** 2)) if judgements else None,
        calibration_error=sum(gaps) / len(judgements) if judgements else None,
        calibration=calibration,
    )


def measure(env: Any, proposer: Partner, verifier: Partner, **kwargs: Any) -> Metrics:
    """The measures of the games of `play_games`, with the same arguments."""
    return summarise(play_games(env, proposer, verifier, **kwargs))


def exploitability(env: Any, proposer: Partner, verifier: Partner, **kwargs: Any) -> float:
    """How much more the proposer earns per game against `verifier` than against an oracle verifier.

    0 if it cannot exploit the verifier's errors. Arguments as for `play_games`.
    """
    against_verifier, against_oracle = (
        measure(env, proposer, opponent, **kwargs).mean_return_proposer for opponent in (verifier, OracleVerifier())
    )
    return against_verifier - against_oracle


def _share(flags: np.ndarray) -> float | None:
    return float(flags.mean()) if len(flags) else None


def _calibration(probability: np.ndarray, holds: np.ndarray) -> tuple[CalibrationBin, ...]:
    """The non-empty bins."""
    bins = np.minimum((probability * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    return tuple(
        CalibrationBin(int(members.sum()), float(probability[members].mean()), float(holds[members].mean()))
        for members in (bins == index for index in np.unique(bins))
    )
