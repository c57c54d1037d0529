"""Trains both agents at once, one actor-critic each, over a batch of games.

Under the protocol "joint" the proposer edits while the verifier says when to stop, and both get the reward of the MDP:
one must learn to make the statement true, the other to recognise when it is. Needs torch (extra `sb3`).
Run: python examples/proposer_verifier_both_learn.py --steps 400000
"""

from __future__ import annotations

import argparse
import sys
from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.envs.proposer_verifier import AGENTS, BatchedGames

try:
    import torch
    from torch import Tensor, nn
    from torch.distributions import Categorical
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[sb3]"')

GAME: dict[str, Any] = {
    "appearance": "tower",
    "start": "scratch",
    "protocol": "joint",
    "rewards": "common",
    "views": "structured",
}
DISCOUNT, TRACE = 0.99, 0.95
ILLEGAL = -1e8  # logit


class Player(nn.Module):
    """Policy and value network: colours of the items, slot by slot, gated by an encoding of the statement."""

    def __init__(self, words: int, slots: int, actions: int, width: int = 128) -> None:
        super().__init__()
        self.colours = nn.Embedding(4, 8)  # no item, or one of three colours
        self.words = nn.Embedding(words, 32, padding_idx=0)
        self.reader = nn.GRU(32, width, batch_first=True)
        self.scene = nn.Linear(slots * 8, width)
        self.body = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU())
        self.heads = nn.Linear(width, actions + 1)

    def forward(self, observation: dict[str, Tensor]) -> tuple[Categorical, Tensor]:
        """The distribution over legal actions, and the value (B,)."""
        scene = self.scene(self.colours(observation["item_array"][..., 3].long() + 1).flatten(1))
        states, _ = self.reader(self.words(observation["statement"]))
        read = states[torch.arange(len(states)), (observation["statement"] > 0).sum(1).clamp(min=1) - 1]
        out = self.heads(self.body(torch.cat([scene * read, read], 1)))
        logits = out[:, :-1].masked_fill(observation["action_mask"] == 0, ILLEGAL)
        return Categorical(logits=logits, validate_args=False), out[:, -1]


class Turn(NamedTuple):
    """One step of all N games, for one agent."""

    observation: dict[str, Tensor]
    actions: Tensor  # (N,)
    rewards: Tensor  # (N,)
    over: Tensor  # (N,) 1.0 if the game ended


def tensors(observation: dict[str, Any]) -> dict[str, Tensor]:
    parts = {key: torch.from_numpy(array) for key, array in observation["observation"].items()}
    return {**parts, "action_mask": torch.from_numpy(observation["action_mask"])}


def loss(player: nn.Module, turns: list[Turn], last: dict[str, Tensor], entropy_weight: float) -> Tensor:
    """The advantage actor-critic loss over (T, N) turns, with generalised advantage estimation."""
    outputs = [player(turn.observation) for turn in turns]
    values = torch.stack([value for _, value in outputs])
    with torch.no_grad():
        following = torch.cat([values[1:], player(last)[1][None]])
        advantage, advantages = torch.zeros_like(values[0]), []
        for turn, value, after in zip(reversed(turns), values.flip(0), following.flip(0), strict=True):
            alive = 1 - turn.over
            advantage = turn.rewards + DISCOUNT * alive * after - value + DISCOUNT * TRACE * alive * advantage
            advantages.append(advantage)
        gains = torch.stack(advantages[::-1])
        targets = gains + values
    log_probability = torch.stack(
        [policy.log_prob(turn.actions) for (policy, _), turn in zip(outputs, turns, strict=True)]
    )
    entropy = torch.stack([policy.entropy() for policy, _ in outputs]).mean()
    scaled = (gains - gains.mean()) / (gains.std() + 1e-6)
    return -(log_probability * scaled).mean() + 0.5 * (values - targets).pow(2).mean() - entropy_weight * entropy


def make_player(batch: BatchedGames, agent: str) -> Player:
    """A new player for an agent that sees the structured scene and the statement."""
    parts: Any = batch.single_observation_spaces[agent]["observation"]
    boxes, capacity, _ = parts["item_array"].shape
    words = int(parts["statement"].high.max()) + 1
    return Player(words, boxes * capacity, int(batch.single_action_spaces[agent].n))


class Table:
    """A batch of games, both players with their optimisers, and the infos of finished games."""

    def __init__(self, batch: BatchedGames, players: dict[str, nn.Module], seed: int) -> None:
        self.batch = batch
        self.players = players
        self.optimisers = {agent: torch.optim.Adam(player.parameters(), 1e-3) for agent, player in players.items()}
        self.observations, _ = batch.reset(seed=seed)
        self.ended: list[dict[str, Any]] = []

    @torch.no_grad()
    def play(self, steps: int) -> dict[str, list[Turn]]:
        turns: dict[str, list[Turn]] = {agent: [] for agent in AGENTS}
        for _ in range(steps):
            observation = {agent: tensors(self.observations[agent]) for agent in AGENTS}
            actions = {agent: self.players[agent](observation[agent])[0].sample() for agent in AGENTS}
            self.observations, rewards, terminated, truncated, infos = self.batch.step(
                {agent: action.numpy() for agent, action in actions.items()}
            )
            over = torch.from_numpy((terminated | truncated).astype(np.float32))
            for agent in AGENTS:
                earned = torch.from_numpy(rewards[agent]).float()
                turns[agent].append(Turn(observation[agent], actions[agent], earned, over))
            self.ended.extend(info[AGENTS[0]] for info in infos.get("final_info", ()) if info is not None)
        return turns

    def learn(self, turns: dict[str, list[Turn]], entropy_weight: float) -> None:
        for agent, player in self.players.items():
            self.optimisers[agent].zero_grad()
            loss(player, turns[agent], tensors(self.observations[agent]), entropy_weight).backward()
            nn.utils.clip_grad_norm_(player.parameters(), 0.5)
            self.optimisers[agent].step()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=400_000, help="total number of rounds over all games")
    parser.add_argument("--games", type=int, default=64, help="number of parallel games")
    parser.add_argument("--rollout", type=int, default=16, help="rounds between updates")
    parser.add_argument("--reports", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    batch = BatchedGames(args.games, **GAME)
    table = Table(batch, {agent: make_player(batch, agent) for agent in AGENTS}, args.seed)
    updates = max(1, args.steps // (args.games * args.rollout))
    for update in range(1, updates + 1):
        table.learn(table.play(args.rollout), entropy_weight=0.02)
        if update % max(1, updates // args.reports) == 0 or update == updates:
            successes = [info["is_success"] for info in table.ended]
            share = float(np.mean(successes)) if successes else float("nan")
            rounds = update * args.games * args.rollout
            print(f"{rounds:8} rounds  success {share:.3f} of {len(successes)} games", flush=True)
            table.ended.clear()


if __name__ == "__main__":
    main()
