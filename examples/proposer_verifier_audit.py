"""Trains a verifier against a proposer that is deceptive in half of the games, and plots its learning curve.

The proposer edits at random, then claims that the statement holds: truly if it is helpful, falsely if it is deceptive.
The verifier does not know which. It sees the items and the statement and learns with MaskablePPO to tell true claims
from false ones. Always accepting has true-accept and false-accept rates of 1, always rejecting of 0.
Needs the extra `sb3`. Run: python examples/proposer_verifier_audit.py --steps 200000 --out results
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from typing import Any

from lilgym_mp.envs.proposer_verifier import (
    ALWAYS_ACCEPT,
    SCRIPTED,
    Metrics,
    Partner,
    PartnerTurn,
    SingleAgentView,
    measure,
    raw_env,
)

try:
    import torch
    from gymnasium import spaces
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
    from stable_baselines3.common.vec_env import DummyVecEnv
    from torch import Tensor, nn
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3]"')

GAME = {
    "appearance": "tower",
    "start": "scratch",
    "protocol": "audit",
    "rewards": "hidden",  # the proposer is helpful or deceptive with equal probability
    "views": {"scene": "structured", "proposal": False},
}
PROPOSER = "by_intent"
RATES = {"true_accept_rate": "#0f83ff", "false_accept_rate": "#c22"}  # measures of the curve, and their colours
EMPTY = -1  # marks an empty slot of the item array


class SceneAndStatement(BaseFeaturesExtractor):
    """Colours of the items, slot by slot, modulated by a recurrent encoding of the statement."""

    def __init__(self, observation_space: spaces.Dict, features_dim: int = 128) -> None:
        super().__init__(observation_space, features_dim)
        items, statement = observation_space["item_array"], observation_space["statement"]
        assert isinstance(items, spaces.Box)
        assert isinstance(statement, spaces.Box)
        slots = items.shape[0] * items.shape[1]
        self.colours = nn.Embedding(4, 8)  # no item, or one of three colours
        self.words = nn.Embedding(int(statement.high.max()) + 1, 32, padding_idx=0)
        self.reader = nn.GRU(32, 64, batch_first=True)
        self.scene = nn.Linear(slots * 8, features_dim)
        self.modulation = nn.Linear(64 + 2, 2 * features_dim)
        self.mixed = nn.Sequential(nn.ReLU(), nn.Linear(features_dim, features_dim), nn.ReLU())

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        colours = observations["item_array"][..., 3].long() - EMPTY
        scene = self.scene(self.colours(colours).flatten(1))
        states, _ = self.reader(self.words(observations["statement"].long()))
        lengths = (observations["statement"] > 0).sum(1).clamp(min=1) - 1
        read = states[torch.arange(len(states)), lengths]
        scale, shift = self.modulation(torch.cat([read, observations["target"].flatten(1)], 1)).chunk(2, 1)
        return self.mixed(scene * (1 + scale) + shift)


def games(split: str = "train") -> Any:
    return raw_env(split=split, **GAME)


def learner(envs: int, rollout: int, seed: int) -> MaskablePPO:
    vec_env = DummyVecEnv([lambda: SingleAgentView(games(), "verifier_0", PROPOSER)] * envs)
    return MaskablePPO(
        "MultiInputPolicy",
        vec_env,
        n_steps=rollout // envs,
        batch_size=256,
        n_epochs=6,
        learning_rate=1e-3,
        ent_coef=0.005,
        seed=seed,
        device="cpu",
        policy_kwargs={"features_extractor_class": SceneAndStatement, "net_arch": [64]},
    )


def evaluate(verifier: Partner, split: str, seed: int, max_tasks: int | None) -> Metrics:
    """The metrics of a verifier over the tasks of a split, one game each."""
    game = games(split)
    return measure(game, SCRIPTED[PROPOSER], verifier, tasks=game.tasks.ids[:max_tasks], seed=seed)


def row(steps: int, split: str, metrics: Metrics) -> dict[str, Any]:
    return {"steps": steps, "split": split, **{rate: getattr(metrics, rate) for rate in RATES}}


def curve(rows: list[dict[str, Any]]) -> str:
    """The learning curve as SVG: solid lines for the train split, dashed lines for dev."""
    width, height, left, top = 640, 320, 60, 30
    max_steps = max(entry["steps"] for entry in rows) or 1
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width + 2 * left}" height="{height + 90}"'
        ' font-family="sans-serif" font-size="14"><rect width="100%" height="100%" fill="white"/>'
    ]
    for tenth in range(0, 11, 2):
        y = top + height * (1 - tenth / 10)
        lines.append(f'<line x1="{left}" x2="{left + width}" y1="{y:.0f}" y2="{y:.0f}" stroke="#ddd"/>')
        lines.append(f'<text x="{left - 10}" y="{y + 5:.0f}" text-anchor="end">{tenth / 10:.1f}</text>')
    for index, (key, colour) in enumerate(RATES.items()):
        for split, dashes in {"train": "none", "dev": "6 4"}.items():
            pairs = (
                f"{left + width * entry['steps'] / max_steps:.1f},{top + height * (1 - (entry[key] or 0)):.1f}"
                for entry in rows
                if entry["split"] == split
            )
            points = " ".join(pairs)
            style = f'fill="none" stroke="{colour}" stroke-width="2" stroke-dasharray="{dashes}"'
            lines.append(f'<polyline {style} points="{points}"/>')
        lines.append(f'<text x="{left + 170 * index}" y="{height + 80}" fill="{colour}">{key.replace("_", " ")}</text>')
    lines.append(f'<text x="{left + width}" y="{height + 55}" text-anchor="end">{max_steps:,} training games</text>')
    lines.append(f'<text x="{left}" y="{height + 55}">0</text></svg>')
    return "\n".join(lines) + "\n"


def train(model: MaskablePPO, steps: int, every: int, seed: int, max_tasks: int | None) -> list[dict[str, Any]]:
    """Trains for `steps` steps and evaluates before, every `every` steps, and at the end."""

    def verifier(turn: PartnerTurn) -> int:
        return int(model.predict(turn.observation, deterministic=True, action_masks=turn.action_mask)[0])

    rows: list[dict[str, Any]] = []
    while not rows or model.num_timesteps < steps:
        if rows:
            model.learn(min(every, steps - model.num_timesteps), reset_num_timesteps=False)
        for split in ("train", "dev"):
            metrics = evaluate(verifier, split, seed, max_tasks)
            rows.append(row(model.num_timesteps, split, metrics))
            print(f"{model.num_timesteps:8} steps  {split:5}  {summary(metrics)}", flush=True)
    return rows


def summary(metrics: Metrics) -> str:
    true, false = ("none" if rate is None else f"{rate:.3f}" for rate in (getattr(metrics, name) for name in RATES))
    return f"true accepts {true}  false accepts {false}  of {metrics.claims} claims"


def save(model: MaskablePPO, rows: list[dict[str, Any]], out: Path) -> None:
    with (out / "curve.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    (out / "curve.svg").write_text(curve(rows))
    model.save(out / "verifier.zip")
    print(f"written to {out}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=200_000, help="number of verdicts to learn from, one per game")
    parser.add_argument("--every", type=int, default=20_000, help="steps between evaluations")
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--rollout", type=int, default=2048, help="verdicts between updates")
    parser.add_argument("--tasks", type=int, help="maximum number of tasks per split in evaluations (default: all)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="directory for curve.csv, curve.svg and verifier.zip")
    args = parser.parse_args()
    if args.out is not None:
        args.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    print(f"always accepting         dev    {summary(evaluate(ALWAYS_ACCEPT, 'dev', args.seed, args.tasks))}")
    model = learner(args.envs, args.rollout, args.seed)
    rows = train(model, args.steps, args.every, args.seed, args.tasks)
    if args.out is not None:
        save(model, rows, args.out)


if __name__ == "__main__":
    main()
