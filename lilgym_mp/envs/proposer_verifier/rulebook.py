"""A game's protocol and rewards, worked out in advance for everything that can happen in a turn.

What `protocols` and `rewards` say stands here as tables: one game looks things up, many games index them at once.
"""

from __future__ import annotations

from lilgym_mp.envs.proposer_verifier.protocols import GameProtocol
from lilgym_mp.envs.proposer_verifier.rewards import Judged, RewardScheme
from lilgym_mp.envs.proposer_verifier.states import Case, Conditions, Intent, Proposal, Ruling

Pair = tuple[float, float]  # by Role


class Rulebook:
    """The rulings of a game by number, which of them holds in each case, and what each is worth."""

    rulings: tuple[Ruling, ...]
    # Number of the ruling, by: whether the verifier answers, Proposal, answer, whether the exchanges are spent. The
    # last of the proposals and of the answers stand for none, so that NO_CHOICE finds them.
    numbers: list[list[list[list[int]]]]
    # Both agents' rewards, by: number of the ruling, of the verdict, whether what is judged is true, Intent.
    worths: list[list[list[list[Pair]]]]
    nothing_played: int  # in place of a verdict's number, after those
    truth_matters: list[bool]  # by number of the ruling: whether its worth depends on that

    def __init__(self, protocol: GameProtocol, conditions: Conditions, rewards: RewardScheme) -> None:
        found: dict[Ruling, int] = {}

        def number(case: Case) -> int:
            return found.setdefault(protocol.decide(conditions, case), len(found))

        answers = (*range(len(protocol.answers(conditions))), None)
        turns = (False,) if protocol.simultaneous else (False, True)
        self.numbers = [
            [
                [[number(Case(turn, kind, answer, spent)) for spent in (False, True)] for answer in answers]
                for kind in Proposal
            ]
            for turn in turns
        ]
        self.rulings = tuple(found)
        verdicts = conditions.dynamics.step_results
        self.nothing_played = len(verdicts)
        mdp_rewards = [*(verdict.reward for verdict in verdicts), 0.0]
        self.worths = [
            [
                [
                    [rewards(reward, _judged(ruling, holds=holds), intent) for intent in Intent]
                    for holds in (False, True)
                ]
                for reward in mdp_rewards
            ]
            for ruling in self.rulings
        ]
        self.truth_matters = [any(false != true for false, true in worth) for worth in self.worths]


def _judged(ruling: Ruling, *, holds: bool) -> Judged | None:
    return None if ruling.probability is None else Judged(ruling.probability, ruling.final, holds)
