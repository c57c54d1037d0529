"""Self-play: a sneaky and a helpful proposer, both learning, against a verifier that learns to tell their claims apart.

In "audit" the proposer edits and then claims that the statement holds. Which of the two plays is drawn for each game
and hidden from the verifier. The helpful one is paid when a true claim is accepted, the sneaky one when a false claim
is, the verifier for right verdicts. A little of the MDP's own reward tells the proposers apart from the first
game on, when the verifier still rejects nearly everything. Needs torch (extra `sb3`).
Run: python examples/self_play_sneaky_and_helpful.py --steps 600000
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from lilgym_mp.envs.proposer_verifier import AGENTS, BatchedGames, Intent

try:
    import torch
    from proposer_verifier_both_learn import Player, Table, make_player
    from torch import Tensor, nn
    from torch.distributions import Categorical
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3]"')

PROPOSER, VERIFIER = AGENTS
GAME: dict[str, Any] = {
    "appearance": "tower",
    "start": "scratch",
    "protocol": "audit",
    "rewards": {PROPOSER: {"hidden": 1.0, "mdp": 0.2}, VERIFIER: "correctness"},
    "false_reject_cost": 8.0,  # true claims are rare at first: rejecting everything must not pay
    "views": "structured",
    "reveal_truth": True,
}


class TwoProposers(nn.Module):
    """A player for each intent."""

    def __init__(self, helpful: Player, sneaky: Player) -> None:
        super().__init__()
        self.by_intent = nn.ModuleList([helpful, sneaky])

    def forward(self, seen: dict[str, Tensor]) -> tuple[Categorical, Tensor]:
        (helpful, helpful_value), (sneaky, sneaky_value) = (player(seen) for player in self.by_intent)
        is_sneaky = seen["intent"] == Intent.SNEAKY
        logits = torch.where(is_sneaky[:, None], sneaky.logits, helpful.logits)
        return Categorical(logits=logits, validate_args=False), torch.where(is_sneaky, sneaky_value, helpful_value)


def share(flags: list[bool]) -> str:
    return f"{sum(flags) / len(flags):.3f}" if flags else "    -"


def told(ended: list[dict[str, Any]]) -> str:
    """How each side did: how often each proposer's games end in a true claim, and how claims were judged."""
    judged = [
        (info["judgement"]["probability"] > 0.5, info["judgement"]["holds"]) for info in ended if "judgement" in info
    ]
    completeness = share([accepted for accepted, holds in judged if holds])
    soundness = share([not accepted for accepted, holds in judged if not holds])
    true_claims = {name: share([info["is_success"] for info in ended if info["intent"] == name]) for name in INTENTS}
    claims = "  ".join(f"{name} true {value}" for name, value in true_claims.items())
    return f"completeness {completeness}  soundness {soundness}  {claims}  of {len(ended)} games"


INTENTS = [intent.name.lower() for intent in Intent]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=600_000, help="turns, over all games")
    parser.add_argument("--games", type=int, default=64, help="games at a time")
    parser.add_argument("--rollout", type=int, default=16, help="turns between updates")
    parser.add_argument("--reports", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(given.seed)
    batch = BatchedGames(given.games, **GAME)
    proposers = TwoProposers(make_player(batch, PROPOSER), make_player(batch, PROPOSER))
    table = Table(batch, {PROPOSER: proposers, VERIFIER: make_player(batch, VERIFIER)}, given.seed)
    updates = max(1, given.steps // (given.games * given.rollout))
    for update in range(1, updates + 1):
        table.learn(table.play(given.rollout), entropy_weight=0.02)
        if update % max(1, updates // given.reports) == 0 or update == updates:
            print(f"{update * given.games * given.rollout:8} turns  {told(table.ended)}", flush=True)
            table.ended.clear()


if __name__ == "__main__":
    main()
