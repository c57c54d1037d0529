"""Behaviour cloning: PPO's network learns the expert's actions from data sets, without playing.

Write data sets with observations as items; docs/datasets.md has the accuracy:
    lilgym-mp data collect TowerScratch --observation structured --out scratch.npz
    lilgym-mp data collect TowerFlipIt --observation structured --out flipit.npz
    python examples/behaviour_cloning.py scratch.npz flipit.npz
If the data sets have all optimal actions (--optimal-actions), the probability of the set is maximised. Colours are
exchanged in words, items and actions as data augmentation. Needs the extra `train`.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import evaluate

try:
    import torch

    from lilgym_mp.learning.common.augmentation import RECOLOURINGS
    from lilgym_mp.learning.common.factored_policy import FactoredPolicy
    from lilgym_mp.learning.common.model import Model
    from lilgym_mp.learning.common.states import BoxImageTable
    from lilgym_mp.learning.ppo.agent import ModelPolicy, make_model
    from lilgym_mp.learning.ppo.learner import PPORecipe
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[train]"')

BATCH, LEARNING_RATE, WEIGHT_DECAY = 512, 1e-3, 1e-2
COLOUR = 3  # index of an item's colour in `item_array`


class Data:
    """The states of data sets of one appearance: their statement, boxes and target, and the actions to take in them."""

    def __init__(self, files: list[Path]) -> None:
        parts = [np.load(file) for file in files]
        self.settings = EnvConfig.from_json(json.loads(str(parts[0]["about"]))["settings"])
        appearance = self.settings.dynamics().appearance

        def column(name: str) -> np.ndarray:
            """A field of the episodes, for each action."""
            return np.concatenate([np.repeat(part[name], np.diff(part["starts"])) for part in parts])

        statements, self.statement = np.unique(column("statement"), return_inverse=True)
        self.statements = [[recolouring.text(text) for text in statements.tolist()] for recolouring in RECOLOURINGS]
        self.target = column("target").astype(np.int64)
        self.table = BoxImageTable()
        slots = max(part["item_array"].shape[2] for part in parts)
        items = np.concatenate([padded(part["item_array"], slots) for part in parts])
        one_hot = np.eye(appearance.action_count, dtype=bool)
        wanted = np.concatenate([part["optimal"] if "optimal" in part else one_hot[part["action"]] for part in parts])
        self.boxes, self.wanted = [], []  # by recolouring
        for recolouring in RECOLOURINGS:
            seen = items.copy()
            seen[..., COLOUR] = np.array([*recolouring.colours, -1])[items[..., COLOUR]]
            self.boxes.append(self.table.item_indices(seen))
            actions = map(appearance.decode, range(appearance.action_count))
            becomes = [appearance.encode(recolouring.action(action)) for action in actions]
            moved = np.zeros_like(wanted)
            moved[:, becomes] = wanted
            self.wanted.append(moved)

    def batches(self, rng: np.random.Generator) -> list[np.ndarray]:
        """The indices of all states in random order, but those of a statement together: a batch reads it once."""
        order = rng.permutation(len(self.statements[0]))[self.statement].argsort(kind="stable")
        return [batch for batch in np.array_split(order, -(-len(order) // BATCH)) if len(batch)]


def padded(items: np.ndarray, slots: int) -> np.ndarray:
    """(N, 3, slots, 5) item arrays with more empty slots."""
    return np.pad(items, ((0, 0), (0, 0), (0, slots - items.shape[2]), (0, 0)), constant_values=-1)


def accuracy(model: Model, settings: EnvConfig) -> float:
    """The share of dev's tasks that the most probable legal actions solve."""
    model.clear_cache()
    episodes = evaluate(ModelPolicy(model, mask=True, sampled=False), settings, "dev")
    return sum(episode.is_success for episode in episodes) / len(episodes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "files", nargs="+", type=Path, help="data sets with structured observations; dev is the first's"
    )
    parser.add_argument("--updates", type=int, default=4_000, help="updates of the optimiser")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    data = Data(args.files)
    words = [statement for statements in data.statements for statement in statements]
    model = make_model(PPORecipe(), data.settings.dynamics().appearance, statements=words)
    optimiser = torch.optim.AdamW(model.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    print(f"{len(data.target):,} actions of {len(data.statements[0]):,} statements", flush=True)
    print("updates  loss  dev")
    batches = list[np.ndarray]()
    for update in range(args.updates):
        batch = (batches := batches or data.batches(rng)).pop()
        which = int(rng.integers(len(RECOLOURINGS)))
        texts = [data.statements[which][index] for index in data.statement[batch].tolist()]
        prediction = model(data.table.states_of(texts, data.boxes[which][batch], data.target[batch]))
        log_probs = FactoredPolicy(model.factorisation, prediction.types, prediction.heads).joint_log_probs()
        wanted = torch.from_numpy(data.wanted[which][batch])
        loss = -log_probs.masked_fill(~wanted, -torch.inf).logsumexp(1).mean()
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * (1 - update / args.updates)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if (update + 1) % max(1, args.updates // 10) == 0:
            print(f"{update + 1:7,}  {loss.item():.2f}  {accuracy(model, data.settings):.3f}", flush=True)


if __name__ == "__main__":
    main()
