"""Behaviour cloning from a Minari dataset of the expert's solutions, with the network of ppo_single_file.py.

Write the dataset first (a few seconds); docs/solver.md gives the accuracy on dev:
    lilgym-mp demos TowerFlipIt --minari lilgym/tower-flipit-v0 --observation structured
    python examples/behaviour_cloning.py lilgym/tower-flipit-v0 --minutes 1
Needs the extras `sb3` (for torch) and `minari`.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np

import lilgym_mp

try:
    import minari
    import torch
    from ppo_single_file import COLOUR, Network, State
    from torch import Tensor
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3,minari]"')

BATCH, LEARNING_RATE, WEIGHT_DECAY = 256, 1e-3, 1e-2


def stacked(dataset: minari.MinariDataset) -> tuple[dict[str, np.ndarray], Tensor]:
    """The observations before each action, and the actions."""
    episodes = list(dataset.iterate_episodes())
    names = ("item_array", "statement", "target")
    observations = {name: np.concatenate([each.observations[name][:-1] for each in episodes]) for name in names}
    return observations, torch.from_numpy(np.concatenate([each.actions for each in episodes]))


def state_of(observations: dict[str, np.ndarray], legal: Tensor) -> tuple[Tensor, State]:
    """The distinct statements' tokens, and the network's input."""
    tokens, statement_of = np.unique(observations["statement"], axis=0, return_inverse=True)
    colours = observations["item_array"][..., COLOUR].astype(np.int64) + 1
    parts = map(torch.from_numpy, (statement_of.ravel(), colours, observations["target"][:, 0]))
    return torch.from_numpy(tokens), State(*parts, legal=legal)


@torch.no_grad()
def accuracy(network: Network, env: Any) -> float:
    """The share of the environment's tasks that the most probable legal actions solve."""
    solved = 0
    for task_id in env.unwrapped.tasks.ids:
        observation, info = env.reset(options={"task": task_id})
        while "is_success" not in info:
            legal = torch.from_numpy(lilgym_mp.action_masks(env))[None]
            tokens, state = state_of({name: part[None] for name, part in observation.items()}, legal)
            observation, *_, info = env.step(int(network(tokens, state)[0].logits.argmax()))
        solved += info["is_success"]
    return solved / len(env.unwrapped.tasks)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", help="a Minari dataset with structured observations of Tower")
    parser.add_argument("--minutes", type=float, default=1.0, help="CPU minutes of training")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    dataset = minari.load_dataset(args.dataset)
    observations, actions = stacked(dataset)
    env: Any = dataset.recover_environment(eval_env=True)
    tokens, states = state_of(observations, torch.ones(len(actions), int(env.action_space.n), dtype=torch.bool))
    words = int(env.observation_space["statement"].high.max()) + 1
    network = Network(words, tokens.shape[1], states.colours.shape[2])
    optimiser = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    print(f"{len(actions):,} actions of {dataset.total_episodes:,} episodes; dev before: {accuracy(network, env):.3f}")
    begin, done = time.process_time(), 0.0
    while done < 1:
        for batch in torch.randperm(len(actions)).split(BATCH):
            policy, _ = network(tokens, State(*(part[batch] for part in states)))
            loss = -policy.log_prob(actions[batch]).mean()
            for group in optimiser.param_groups:
                group["lr"] = LEARNING_RATE * (1 - done)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            done = min(1.0, (time.process_time() - begin) / (60 * args.minutes))
            if done == 1:
                break
    print(f"loss {loss:.2f}; dev after {args.minutes:g} CPU minutes: {accuracy(network, env):.3f}")


if __name__ == "__main__":
    main()
