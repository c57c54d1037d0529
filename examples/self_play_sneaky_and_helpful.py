"""Trains a sneaky and a helpful proposer together with a verifier that learns to tell their claims apart.

Under the protocol "audit" the proposer edits and then claims that the statement holds. Each game draws one of the two
proposers, unknown to the verifier. The helpful one is rewarded if a true claim is accepted, the sneaky one if a false
claim is, the verifier for right verdicts. A small share of the MDP's reward gives the proposers a signal early on, when
the verifier still rejects nearly everything. Needs torch (extra `sb3`).
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
    "false_reject_cost": 8.0,  # true claims are rare at first, so rejecting everything must not pay
    "views": "structured",
    "reveal_truth": True,
}


class TwoProposers(nn.Module):
    """One player per intent."""

    def __init__(self, helpful: Player, sneaky: Player) -> None:
        super().__init__()
        self.by_intent = nn.ModuleList([helpful, sneaky])

    def forward(self, observation: dict[str, Tensor]) -> tuple[Categorical, Tensor]:
        (helpful, helpful_value), (sneaky, sneaky_value) = (player(observation) for player in self.by_intent)
        is_sneaky = observation["intent"] == Intent.SNEAKY
        logits = torch.where(is_sneaky[:, None], sneaky.logits, helpful.logits)
        return Categorical(logits=logits, validate_args=False), torch.where(is_sneaky, sneaky_value, helpful_value)


def share(flags: list[bool]) -> str:
    return f"{sum(flags) / len(flags):.3f}" if flags else "    -"


def summary(ended: list[dict[str, Any]]) -> str:
    """Completeness and soundness of the verifier, and how often each proposer's claims are true."""
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
    parser.add_argument("--steps", type=int, default=600_000, help="total number of turns over all games")
    parser.add_argument("--games", type=int, default=64, help="number of parallel games")
    parser.add_argument("--rollout", type=int, default=16, help="turns between updates")
    parser.add_argument("--reports", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    batch = BatchedGames(args.games, **GAME)
    proposers = TwoProposers(make_player(batch, PROPOSER), make_player(batch, PROPOSER))
    table = Table(batch, {PROPOSER: proposers, VERIFIER: make_player(batch, VERIFIER)}, args.seed)
    updates = max(1, args.steps // (args.games * args.rollout))
    for update in range(1, updates + 1):
        table.learn(table.play(args.rollout), entropy_weight=0.02)
        if update % max(1, updates // args.reports) == 0 or update == updates:
            print(f"{update * args.games * args.rollout:8} turns  {summary(table.ended)}", flush=True)
            table.ended.clear()


if __name__ == "__main__":
    main()
