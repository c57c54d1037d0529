"""Self-play by best responses: each round trains a proposer against all verifiers so far, and a verifier against all
proposers, in audit, where half of the proposer's games are deceptive (rewards "hidden").

Pools start with scripted agents. Exploitability after a round is what the two new agents gain over the pools that they
respond to, in mean return: 0 if nobody can do better. It is a lower bound, as good as the training that finds it.
Run: python examples/self_play.py --rounds 4 --steps 200000 --out runs/self_play
"""

from __future__ import annotations

import argparse
import csv
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.cli import main as lilgym_mp
from lilgym_mp.envs.proposer_verifier import Metrics, Partner, Role, measure, raw_env
from lilgym_mp.evaluation.game_partners import scripted_proposers, scripted_verifiers
from lilgym_mp.learning.common.agents import open_agent

GAME: dict[str, Any] = {"protocol": "audit", "rewards": "hidden"}
STARTS = {Role.PROPOSER: ["helpful", "deceptive"], Role.VERIFIER: ["target-only", "always-accept"]}
OPPONENTS = {Role.PROPOSER: "--verifiers", Role.VERIFIER: "--proposers"}  # of the agent that learns


class Round(NamedTuple):
    """A row of exploitability.csv."""

    round: int
    exploitability: float
    proposer_gain: float
    verifier_gain: float
    lies_accepted: float  # share of games that end in one, over all pairs of the pools
    success: float


class SelfPlay:
    """Growing pools of proposers and verifiers."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.args = args
        self.pools = {role: list(names) for role, names in STARTS.items()}
        self.env = raw_env(args.configuration, corpus=args.corpus, split="dev", **GAME)
        self._partner, self._measures = cache(self._make_partner), cache(self._measure)

    def play_round(self, number: int) -> Round:
        """Trains a best response of each side, measures both, and adds them to the pools."""
        before = dict(self.pools)
        responses = {role: self._train(role, number) for role in Role}
        gain, other_gain = (
            self._value(role, {**before, role: [responses[role]]}) - self._value(role, before) for role in Role
        )
        pairs = [self._measures(*pair) for pair in product(before[Role.PROPOSER], before[Role.VERIFIER])]
        self.pools = {role: [*before[role], responses[role]] for role in Role}
        lies, success = (
            sum(getattr(one, name) for one in pairs) / len(pairs) for name in ("accepted_false_claims", "success_rate")
        )
        return Round(number, gain + other_gain, gain, other_gain, lies, success)

    def _train(self, role: Role, number: int) -> str:
        """The run of an agent that learned against the other side's pool."""
        args, out = self.args, self.args.out / f"{role.name.lower()}-{number}"
        if not (out / "agent.safetensors").exists():
            command = ["train", "game", args.configuration, "--corpus", args.corpus, "--protocol", GAME["protocol"]]
            command += ["--rewards", GAME["rewards"], OPPONENTS[role], *self.pools[role.other]]
            command += ["--steps", str(args.steps), "--seed", str(args.seed + number), "--out", str(out)]
            if lilgym_mp([*command, *args.train]):
                raise SystemExit(f"no agent in {out}")
        return str(out)

    def _value(self, role: Role, pools: dict[Role, list[str]]) -> float:
        """The mean return of one side over all pairs of two pools."""
        pairs = [self._measures(*pair) for pair in product(pools[Role.PROPOSER], pools[Role.VERIFIER])]
        name = f"mean_return_{role.name.lower()}"
        return sum(getattr(one, name) for one in pairs) / len(pairs)

    def _measure(self, proposer: str, verifier: str) -> Metrics:
        partners = self._partner(Role.PROPOSER, proposer), self._partner(Role.VERIFIER, verifier)
        return measure(self.env, *partners, seed=self.args.seed)

    def _make_partner(self, role: Role, name: str) -> Partner:
        scripted = scripted_proposers if role is Role.PROPOSER else scripted_verifiers
        known = scripted(self.env.dynamics)
        return known[name] if name in known else open_agent(Path(name), "cpu").partner(role, sampled=True)  # pyright: ignore


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--steps", type=int, default=200_000, help="turns of each training")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--configuration", default="TowerFlipIt")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--out", type=Path, default=Path("runs/self_play"), help="directory of runs and the curve")
    parser.add_argument("train", nargs="*", help="more options of `lilgym-mp train game`, after --")
    args = parser.parse_args()
    play, curve = SelfPlay(args), args.out / "exploitability.csv"
    args.out.mkdir(parents=True, exist_ok=True)
    with curve.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(Round._fields)
        for number in range(1, args.rounds + 1):
            row = play.play_round(number)
            writer.writerow([row.round, *(round(value, 4) for value in row[1:])])
            file.flush()
            print(f"round {number}: exploitability {row.exploitability:.3f}, lies accepted {row.lies_accepted:.1%}")
    print(f"curve: {curve}")


if __name__ == "__main__":
    main()
