"""Behaviour cloning from a Minari dataset of the expert's solutions, with the network of ppo_single_file.py.

Write the dataset first (a few seconds); docs/solver.md gives the accuracy on dev:
    lilgym-mp demos TowerFlipIt --minari lilgym/tower-flipit-v0 --observation structured
    python examples/behaviour_cloning.py lilgym/tower-flipit-v0 --minutes 3
Needs the extras `train` and `minari`.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np

import lilgym_mp

try:
    import minari  # pyright: ignore[reportMissingImports]
    import torch
    from ppo_single_file import COLOUR, MEANT, SEEN, SWAPS, Network, State, Tasks
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[train,minari]"')

BATCH, LEARNING_RATE, WEIGHT_DECAY = 512, 1e-3, 1e-2
MADE = MEANT.argsort(1)  # (6, 13) the action with swapped colours for each of the environment's actions


class Demonstrations:
    """The states before each action of a dataset, and the actions."""

    def __init__(self, dataset: minari.MinariDataset) -> None:
        self.tasks = Tasks(dataset.recover_environment())
        statement_of = dict(zip(self.tasks.ids, self.tasks.statement_of, strict=True))
        episodes = list(dataset.iterate_episodes())
        self.actions = np.concatenate([each.actions for each in episodes])
        self.statement = np.repeat(
            [statement_of[each.infos["task"][0].decode()] for each in episodes],
            [len(each.actions) for each in episodes],
        )
        self.colours = np.concatenate([each.observations["item_array"][:-1, ..., COLOUR] for each in episodes]) + 1
        self.target = np.concatenate([each.observations["target"][:-1, 0] for each in episodes])
        self.legal = np.ones((len(self.actions), MEANT.shape[1]), bool)  # datasets have no masks

    def swapped(self, rng: np.random.Generator) -> tuple[State, torch.Tensor]:
        """All states and actions, with colours swapped at random in each statement."""
        swaps = rng.integers(len(SWAPS), size=self.statement.max() + 1)[self.statement]
        colours, row = SEEN[swaps[:, None, None], self.colours], len(SWAPS) * self.statement + swaps
        state = State(*map(torch.from_numpy, (row, colours, self.target, self.legal)))
        return state, torch.from_numpy(MADE[swaps, self.actions])


@torch.no_grad()
def accuracy(network: Network, env: Any) -> float:
    """The share of the environment's tasks that the most probable legal actions solve."""
    solved = 0
    for task_id in env.unwrapped.tasks.ids:
        observation, info = env.reset(options={"task": task_id})
        while "is_success" not in info:
            colours = observation["item_array"][None, ..., COLOUR].astype(np.int64) + 1
            legal = lilgym_mp.action_masks(env)[None]
            state = State(*map(torch.from_numpy, (np.zeros(1, np.int64), colours, observation["target"], legal)))
            policy, _ = network(torch.from_numpy(observation["statement"][None]), state)
            observation, *_, info = env.step(int(policy.logits.argmax()))
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
    rng = np.random.default_rng(args.seed)
    dataset = minari.load_dataset(args.dataset)
    demonstrations, env = Demonstrations(dataset), dataset.recover_environment(eval_env=True)
    tasks, count = demonstrations.tasks, len(demonstrations.actions)
    network = Network(len(tasks.vocabulary), tasks.length, demonstrations.colours.shape[2])
    optimiser = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    print(f"{count:,} actions of {dataset.total_episodes:,} episodes; dev before: {accuracy(network, env):.3f}")
    begin, done, loss = time.process_time(), 0.0, torch.tensor(torch.nan)
    while done < 1:
        states, actions = demonstrations.swapped(rng)
        # In random order, but the states of a statement together, as each batch reads its statements once.
        order = rng.permutation(demonstrations.statement.max() + 1)[demonstrations.statement].argsort()
        for batch in torch.from_numpy(order).split(BATCH):
            policy, _ = network(tasks.tokens, State(*(part[batch] for part in states)))
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
