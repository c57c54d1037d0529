"""How much a pair of trained agents needs its messages: success as trained, silenced and at random, and how many bits
of the proposer's next proposal the verifier's message tells.

Run: python scripts/measure_messages.py PROPOSER_RUN VERIFIER_RUN [--corpus lilgym] [--split dev] [--seed 0]

`--save PAIR` writes the results as rows of docs/results/messages.csv, in place of this pair's, and prints the cells of
docs/game_experiments.md and a digest for runs.csv. A row has a digit for each start scene, in the order of the file:
whether its game succeeded.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import entropy
from write_result_tables import read, tasks, write

from lilgym_mp.envs.proposer_verifier import BatchTurn, GameRecord, Metrics, Partner, Role, env, play_games, summarise
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner, batch_actions
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.evaluation.game_partners import MESSAGE_CHANGES, ChangedMessages, scripted_verifiers
from lilgym_mp.evaluation.results import rounded
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


def metrics(configuration: str, successes: str) -> Metrics:
    """The success of games, by the statements of their start scenes."""
    games = zip(tasks(configuration), successes, strict=True)
    outcomes = {"1": Outcome.SUCCESS, "0": Outcome.WRONG_STOP}
    return summarise(
        [GameRecord(task.id, task.statement, task.target, outcomes[digit], 1, (0.0, 0.0), ()) for task, digit in games]
    )


def cells(rows: Sequence[Sequence[str]]) -> str:
    """The cells of the page's table for the rows of a pair in messages.csv: success, silenced, at random, bits."""

    def both(messages: str) -> Iterator[Metrics]:
        return (metrics(row[1], row[-1]) for row in rows if row[3] == messages)

    def text(found: Metrics) -> str:
        return rounded(100 * found.success_rate, 1)

    low, high = max(both("as trained"), key=lambda found: found.success_rate).success_interval
    shown = [" / ".join(map(text, both(messages))) for messages in ("as trained", *MESSAGE_CHANGES)]
    shown[0] += f" [{rounded(100 * low, 1)}, {rounded(100 * high, 1)}]"
    return " | ".join((*shown, rows[0][4]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proposer", type=Path)
    parser.add_argument("verifier", type=Path, help="a run, or guide: the scripted one")
    parser.add_argument("--corpus", default="lilgym")
    parser.add_argument("--configuration", help="another than the proposer's")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--save", metavar="PAIR", help="name of the pair in docs/results/messages.csv")
    args = parser.parse_args()
    builder = open_agent(args.proposer, "cpu")
    settings = builder.game
    if settings is None:
        raise SystemExit(f"{args.proposer}: not trained in the game")
    changes = {"corpus": args.corpus, "split": args.split}
    if args.configuration:
        changes["configuration"] = args.configuration
    game = env(**{**vars(settings), **changes})
    scripted = scripted_verifiers(settings.dynamics()).get(str(args.verifier))
    guide = open_agent(args.verifier, "cpu") if scripted is None else None
    sizes = settings.message_sizes()[Role.VERIFIER] + 1, settings.dynamics().appearance.action_count
    rows: list[tuple[str, ...]] = []
    saved: list[list[str]] = []
    for sampled in (False, True):
        for change in (None, *MESSAGE_CHANGES)[: sizes[0]]:  # without messages there is nothing to change
            proposer = builder.partner(Role.PROPOSER, sampled=sampled)
            verifier = scripted if guide is None else guide.partner(Role.VERIFIER, sampled=sampled)
            if proposer is None or verifier is None:
                raise SystemExit("one of the runs has no trained agent for its seat")
            proposer = Listening(proposer, *sizes)
            if change is not None:
                verifier = ChangedMessages(verifier, change)
            records = play_games(game, proposer, verifier, seed=args.seed)
            found = summarise(records)
            low, high = (rounded(100 * bound, 1) for bound in found.success_interval)
            told, all_bits = proposer.information
            bits = f"{told:.2f} of {all_bits:.2f}"
            kind = ("sampled" if sampled else "greedy", change or "as trained")
            successes = "".join(str(int(record.outcome is Outcome.SUCCESS)) for record in records)
            saved.append(
                [
                    args.save,
                    args.configuration or settings.configuration,
                    *kind,
                    bits,
                    successes,
                ]
            )
            rows.append(
                (
                    *kind,
                    f"{rounded(100 * found.success_rate, 1)} [{low}, {high}]",
                    bits,
                    f"{found.mean_rounds:.1f}",
                )
            )
    if args.save is not None:
        head, *others = read("messages")
        write("messages", [head, *(row for row in others if row[0] != args.save), *saved])
        print(cells(saved))
        print("digest", hashlib.sha256(repr([row[2:] for row in saved]).encode()).hexdigest()[:12])
    print(table(("actions", "messages", "success (%)", "bits", "rounds"), rows))


if __name__ == "__main__":
    main()
