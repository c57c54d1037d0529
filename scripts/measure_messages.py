"""How much a pair of trained agents needs its messages: success as trained, silenced and at random, and how many bits
of the proposer's next proposal the verifier's message tells.

Run: python scripts/measure_messages.py PROPOSER_RUN VERIFIER_RUN [--corpus lilgym] [--split dev] [--seed 0]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import entropy

from lilgym_mp.envs.proposer_verifier import BatchTurn, Partner, Role, env, measure
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner, batch_actions
from lilgym_mp.evaluation.game_partners import MESSAGE_CHANGES, ChangedMessages
from lilgym_mp.evaluation.terminal import table
from lilgym_mp.learning.common.agents import open_agent


class Listening(BatchPartner):
    """A proposer that counts what it proposes after each message."""

    def __init__(self, partner: Partner, messages: int, proposals: int) -> None:
        self._partner = partner
        self.counts = np.zeros((messages, proposals))

    def batch(self, turn: BatchTurn) -> Any:
        """The partner's actions."""
        actions = batch_actions(self._partner, turn)
        proposals = actions // turn.game.encode_action(Role.PROPOSER, 1)
        heard = turn.games.messages[Role.VERIFIER, turn.indices]
        proposed = proposals < self.counts.shape[1]  # not "wait"
        np.add.at(self.counts, (heard[proposed], proposals[proposed]), 1)
        return actions

    @property
    def information(self) -> tuple[float, float]:
        """Mutual information of message and next proposal, and the proposals' entropy, in bits."""
        joint = self.counts / self.counts.sum()
        messages, proposals = joint.sum(1), joint.sum(0)
        apart = entropy(messages, base=2) + entropy(proposals, base=2)
        return max(0.0, float(apart - entropy(joint.ravel(), base=2))), float(entropy(proposals, base=2))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proposer", type=Path)
    parser.add_argument("verifier", type=Path)
    parser.add_argument("--corpus", default="lilgym")
    parser.add_argument("--configuration", help="another than the proposer's")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    agents = {Role.PROPOSER: open_agent(args.proposer, "cpu"), Role.VERIFIER: open_agent(args.verifier, "cpu")}
    settings = agents[Role.PROPOSER].game
    if settings is None:
        raise SystemExit(f"{args.proposer}: not trained in the game")
    changes = {"corpus": args.corpus, "split": args.split}
    if args.configuration:
        changes["configuration"] = args.configuration
    game = env(**{**vars(settings), **changes})
    sizes = settings.message_sizes()[Role.VERIFIER] + 1, settings.dynamics().appearance.action_count
    rows: list[tuple[str, ...]] = []
    for sampled in (False, True):
        for change in (None, *MESSAGE_CHANGES):
            proposer, verifier = (agents[role].partner(role, sampled=sampled) for role in Role)
            if proposer is None or verifier is None:
                raise SystemExit("one of the runs has no trained agent for its seat")
            proposer = Listening(proposer, *sizes)
            if change is not None:
                verifier = ChangedMessages(verifier, change)
            found = measure(game, proposer, verifier, seed=args.seed)
            low, high = (f"{100 * bound:.1f}" for bound in found.success_interval)
            told, all_bits = proposer.information
            rows.append(
                (
                    "sampled" if sampled else "greedy",
                    change or "as trained",
                    f"{100 * found.success_rate:.1f} [{low}, {high}]",
                    f"{told:.2f} of {all_bits:.2f}",
                    f"{found.mean_rounds:.1f}",
                )
            )
    print(table(("actions", "messages", "success (%)", "bits", "rounds"), rows))


if __name__ == "__main__":
    main()
