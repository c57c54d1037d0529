"""Behaviour cloning from a Minari dataset of the expert's solutions, with the network of ppo_single_file.py.

Write the dataset first (a few seconds); docs/solver.md gives the accuracy on dev:
    lilgym-mp demos TowerFlipIt --minari lilgym/tower-flipit-v0 --observation arrays
    python examples/behaviour_cloning.py lilgym/tower-flipit-v0 --minutes 3
Needs the extras `train` and `minari`.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import permutations
from typing import Any

import numpy as np

import lilgym_mp
from lilgym_mp.corpus import Vocabulary

try:
    import minari  # pyright: ignore[reportMissingImports]
    import torch
    from ppo_single_file import Network, State, seen_pixels
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[train,minari]"')

BATCH, LEARNING_RATE, WEIGHT_DECAY = 512, 1e-3, 1e-2
COLOURS = {"yellow": (250, 255, 0), "black": (0, 0, 0), "blue": (15, 131, 255)}  # with the RGB of their blocks
SWAPS = np.array(list(permutations(range(3))))  # (6, 3) the colour shown instead of each colour; the first: itself
ADDS = 1 + 3 * np.arange(3)[:, None] + SWAPS[:, None]  # (6, 3, 3) the ADD made instead of each, by box and colour
MADE = np.hstack([np.zeros((6, 1), int), ADDS.reshape(6, -1), np.tile([10, 11, 12], (6, 1))])  # (6, 13) all actions


class Demonstrations:
    """The states before each action of a dataset, and the actions."""

    def __init__(self, dataset: minari.MinariDataset) -> None:
        tasks = dataset.recover_environment().unwrapped.tasks
        self.vocabulary = Vocabulary.from_statements(task.statement for task in tasks)
        episodes = list(dataset.iterate_episodes())
        self.actions = np.concatenate([each.actions for each in episodes])
        statements, targets = (
            np.concatenate([each.observations[part][:-1] for each in episodes]) for part in ("statement", "target")
        )
        images = np.concatenate([seen_pixels(each.observations["image"][:-1]) for each in episodes])
        self.rgb, index = np.unique(images.reshape(-1, 3), axis=0, return_inverse=True)
        self.images = index.reshape(images.shape[:-1])  # of each pixel's colour in `rgb`
        self.statements, self.statement = np.unique(statements, axis=0, return_inverse=True)
        self.target = targets[:, 0]
        self.legal = np.ones((len(self.actions), MADE.shape[1]), bool)  # datasets have no masks

    def swapped(self, rng: np.random.Generator) -> tuple[State, torch.Tensor]:
        """All states and actions, with colours swapped at random in each statement."""
        swaps = rng.integers(len(SWAPS), size=len(self.statements))[self.statement]
        words = np.tile(np.arange(len(self.vocabulary)), (len(SWAPS), 1))  # (6, words) the word instead of each
        names = np.array([self.vocabulary.token_id(name) for name in COLOURS])
        words[:, names] = names[SWAPS]
        shown, blocks = np.tile(self.rgb, (len(SWAPS), 1, 1)), np.array(list(COLOURS.values()), np.uint8)
        for colour, rgb in enumerate(blocks):
            shown[:, (self.rgb == rgb).all(1)] = blocks[SWAPS[:, colour]][:, None]
        statement = words[swaps[:, None], self.statements[self.statement]]
        image = shown[swaps[:, None, None], self.images]
        state = State(*map(torch.from_numpy, (statement, image, self.target, self.legal)))
        return state, torch.from_numpy(MADE[swaps, self.actions])


@torch.no_grad()
def accuracy(network: Network, env: Any) -> float:
    """The share of the environment's tasks that the most probable legal actions solve."""
    solved = 0
    for task_id in env.unwrapped.tasks.ids:
        observation, info = env.reset(options={"task": task_id})
        while "is_success" not in info:
            seen = {name: np.asarray(part)[None] for name, part in observation.items()}
            legal = lilgym_mp.action_masks(env)[None]
            parts = seen["statement"], seen_pixels(seen["image"]), observation["target"], legal
            policy, _ = network(State(*map(torch.from_numpy, parts)))
            observation, *_, info = env.step(int(policy.logits.argmax()))
        solved += info["is_success"]
    return solved / len(env.unwrapped.tasks)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", help="a Minari dataset with observations of Tower as arrays")
    parser.add_argument("--minutes", type=float, default=1.0, help="CPU minutes of training")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    dataset = minari.load_dataset(args.dataset)
    demonstrations, env = Demonstrations(dataset), dataset.recover_environment(eval_env=True)
    count, length = len(demonstrations.actions), demonstrations.statements.shape[1]
    network = Network(len(demonstrations.vocabulary), length)
    optimiser = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    print(f"{count:,} actions of {dataset.total_episodes:,} episodes; dev before: {accuracy(network, env):.3f}")
    begin, done, loss = time.process_time(), 0.0, torch.tensor(torch.nan)
    while done < 1:
        states, actions = demonstrations.swapped(rng)
        # In random order, but the states of a statement together, as each batch reads its statements once.
        order = rng.permutation(len(demonstrations.statements))[demonstrations.statement].argsort()
        for batch in torch.from_numpy(order).split(BATCH):
            policy, _ = network(State(*(part[batch] for part in states)))
            loss = -policy.log_prob(actions[batch]).mean()
            for group in optimiser.param_groups:
                group["lr"] = LEARNING_RATE * (1 - done)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            done = (time.process_time() - begin) / (60 * args.minutes)
            if done >= 1:
                break
    print(f"loss {loss:.2f}; dev after {args.minutes:g} CPU minutes: {accuracy(network, env):.3f}")


if __name__ == "__main__":
    main()
