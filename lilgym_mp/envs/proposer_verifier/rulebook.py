"""A game's protocol and rewards, worked out in advance for everything that can happen in a turn.

What `protocols` and `rewards` say stands here as tables, which one game looks up and many games index at once.
"""

from __future__ import annotations

from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.envs.proposer_verifier.protocols import GameProtocol
from lilgym_mp.envs.proposer_verifier.rewards import Judged, RewardScheme
from lilgym_mp.envs.proposer_verifier.states import (
    NO_CHOICE,
    STOP_ACTION,
    Case,
    Conditions,
    Intent,
    Proposal,
    Ruling,
)

# A whole number, or an array of them: one game's, or as many games'.
Numbers = TypeVar("Numbers", int, NDArray[np.int64])

EXCHANGES_SPENT = (False, True)
TRUTHS = (False, True)


class Rulebook:
    """The rulings of a game by number, which of them holds in each case, and what each is worth."""

    def __init__(self, protocol: GameProtocol, conditions: Conditions, rewards: RewardScheme) -> None:
        self._exchanges = conditions.exchanges
        answers = (None, *range(len(protocol.answers(conditions))))
        self._answer_count = len(answers)
        turns = (False,) if protocol.simultaneous else (False, True)
        cases = product(turns, Proposal, answers, EXCHANGES_SPENT)
        rulings = [protocol.decide(conditions, Case(*case)) for case in cases]
        numbers = {ruling: number for number, ruling in enumerate(dict.fromkeys(rulings))}
        self.rulings = tuple(numbers)
        self.numbers = [numbers[ruling] for ruling in rulings]  # by place of the case
        verdicts = conditions.dynamics.verdicts
        self.nothing_played = len(verdicts)  # in place of a verdict's number
        self._verdict_count = len(verdicts) + 1
        worth = [
            0.0 if number == self.nothing_played else verdicts[number].reward for number in range(self._verdict_count)
        ]
        self.worths = [
            rewards(reward, _judged(ruling, holds=holds), intent)
            for ruling, reward, holds, intent in product(self.rulings, worth, TRUTHS, Intent)
        ]  # both agents', by place of the outcome
        self.truth_matters = [self._truth_matters(number) for number in range(len(self.rulings))]  # to the worth

    def _truth_matters(self, ruling: int) -> bool:
        outcomes = product(range(self._verdict_count), Intent)
        return any(
            self.worths[self.outcome(ruling, verdict, 0, intent)]
            != self.worths[self.outcome(ruling, verdict, 1, intent)]
            for verdict, intent in outcomes
        )

    def case(self, is_answer: Numbers, proposal: Numbers, answer: Numbers, rejections: Numbers) -> Numbers:
        """The place of the case in `numbers`. `proposal` and `answer` are NO_CHOICE where there is none."""
        kind = (proposal > NO_CHOICE) * 1 + (proposal > STOP_ACTION)  # a Proposal
        place = (is_answer * len(Proposal) + kind) * self._answer_count + answer + 1
        return place * len(EXCHANGES_SPENT) + (rejections >= self._exchanges)

    def outcome(self, ruling: Numbers, verdict: Numbers, holds: Numbers, intent: Numbers) -> Numbers:
        """The place of the outcome in `worths`. `holds`: whether what was judged is true, 0 or 1."""
        return ((ruling * self._verdict_count + verdict) * len(TRUTHS) + holds) * len(Intent) + intent


def _judged(ruling: Ruling, *, holds: bool) -> Judged | None:
    return None if ruling.probability is None else Judged(ruling.probability, ruling.final, holds)
