"""How good a verifier is, and how much a proposer can make of its errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.envs.proposer_verifier.partners import OracleVerifier, Partner, PartnerTurn, ask
from lilgym_mp.envs.proposer_verifier.session import Session
from lilgym_mp.envs.proposer_verifier.shared import GameAccess
from lilgym_mp.envs.proposer_verifier.states import ACCEPTS_ABOVE, Judgement, Role
from lilgym_mp.rules import Outcome

CALIBRATION_BINS = 10


class GameRecord(NamedTuple):
    """One game as played."""

    task: str
    outcome: Outcome
    rounds: int
    returns: tuple[float, float]  # by Role
    judgements: tuple[Judgement, ...]


class CalibrationBin(NamedTuple):
    """The judgements whose probability lies in one of ten equal ranges."""

    count: int
    mean_probability: float
    share_holding: float


@dataclass(frozen=True)
class Metrics:
    """Measures over games. Rates over no claims are None.

    Completeness is the share of true claims that were accepted, soundness the share of false ones that were not; a
    claim is what the verifier judges (docs/proposer_verifier.md says what that is in each protocol).
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
    brier_score: float | None  # mean squared difference of stated probability and truth
    calibration_error: float | None  # mean distance of stated probability and share holding, weighted by count
    calibration: tuple[CalibrationBin, ...]

    def to_json(self) -> dict[str, Any]:
        return asdict(self) | {"calibration": [entry._asdict() for entry in self.calibration]}


def play_games(
    env: Any, proposer: Partner, verifier: Partner, *, tasks: Iterable[str] | None = None, seed: int = 0
) -> list[GameRecord]:
    """Plays each task once (None: every one of the split, in file order), the same for the same seed.

    `env`: any form of the game; it is played, so let nobody else. Raises PartnerError for illegal actions.
    """
    access = getattr(env, "unwrapped", env)
    if not isinstance(access, GameAccess):
        raise TypeError(f"play_games needs a proposer-verifier environment, not {env!r}")
    session = access.session
    session.reset(seed, None)
    rng = np.random.default_rng(seed)
    return [_played(session, proposer, verifier, task, rng) for task in (tasks or access.tasks.ids)]


def _played(session: Session, proposer: Partner, verifier: Partner, task: str, rng: np.random.Generator) -> GameRecord:
    session.reset(None, {"task": task})
    returns = np.zeros(len(Role))
    judgements: list[Judgement] = []
    while session.state.movers:
        asked = {
            role: ask(partner, PartnerTurn(session, role, rng)) if role in session.state.movers else None
            for role, partner in zip(Role, (proposer, verifier), strict=True)
        }
        step = session.play(asked[Role.PROPOSER], asked[Role.VERIFIER])
        returns += step.rewards
        if (judgement := step.judgement) is not None:
            judgements.append(judgement)
    last = session.last
    assert last is not None
    assert last.played is not None
    proposer_return, verifier_return = returns.tolist()
    return GameRecord(
        task, last.played.outcome, session.state.mdp.steps, (proposer_return, verifier_return), tuple(judgements)
    )


def summarise(records: Sequence[GameRecord]) -> Metrics:
    """Raises ValueError for no games."""
    if not records:
        raise ValueError("cannot summarise zero games")
    judgements = [judgement for record in records for judgement in record.judgements]
    probability = np.array([judgement.probability for judgement in judgements])
    holds = np.array([judgement.holds for judgement in judgements], np.bool_)
    accepted = probability > ACCEPTS_ABOVE
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


def measure(env: Any, proposer: Partner, verifier: Partner, **how: Any) -> Metrics:
    """The measures of `play_games`, which takes the same arguments."""
    return summarise(play_games(env, proposer, verifier, **how))


def exploitability(env: Any, proposer: Partner, verifier: Partner, **how: Any) -> float:
    """How much more the proposer earns a game against `verifier` than against one that knows the truth.

    0 when it cannot make anything of the verifier's errors; arguments as those of `play_games`.
    """
    earned, honest = (
        measure(env, proposer, opponent, **how).mean_return_proposer for opponent in (verifier, OracleVerifier())
    )
    return earned - honest


def _share(flags: np.ndarray) -> float | None:
    return float(flags.mean()) if len(flags) else None


def _calibration(probability: np.ndarray, holds: np.ndarray) -> tuple[CalibrationBin, ...]:
    """The ranges that hold any judgement."""
    numbers = np.minimum((probability * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    return tuple(
        CalibrationBin(int(here.sum()), float(probability[here].mean()), float(holds[here].mean()))
        for here in (numbers == number for number in np.unique(numbers))
    )
