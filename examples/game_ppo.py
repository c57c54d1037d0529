"""PPO for both sides of the two-agent game in one file: what `lilgym-mp train game` does, without its options.

Under the protocol "joint" the proposer edits while the verifier says when to stop, and both get the reward of the MDP:
one must learn to make the statement true, the other to recognise when it is. Each side has a network of its own, which
reads the statement's words and the blocks of each box. docs/game_experiments.md has its results.
Needs the extra `train`. Run: python examples/game_ppo.py
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length
from lilgym_mp.envs.proposer_verifier import AGENTS, BatchedGames

try:
    import torch
    from torch import Tensor, nn
    from torch.distributions import Categorical
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[train]"')

GAME: dict[str, Any] = {"appearance": "tower", "protocol": "joint", "rewards": "common", "views": "structured"}
GROUPS, GAMES_PER_GROUP = 32, 8  # the games of a group play tasks of one statement
TURNS = 16  # of every game in a rollout
EPOCHS, MINI_BATCHES = 2, 4
LEARNING_RATE, CLIP, VALUE_WEIGHT, GRADIENT_NORM = 1e-3, 0.2, 0.5, 0.5
ENTROPY = (0.08, 0.01)  # weight at the beginning and at the end
DISCOUNT, TRACE = 0.99, 0.95
WIDTH, HEADS, BOX_WIDTH, SCENE_WIDTH = 64, 4, 64, 128
COLOUR = 3  # index of an item's colour in `item_array`


class Observation(NamedTuple):
    """One side's observations of B states."""

    colours: Tensor  # (B, 3, slots) of each box's blocks from the bottom, 0 in empty slots
    statement_of: Tensor  # (B,) index of the statement's tokens
    target: Tensor  # (B,)
    legal: Tensor  # (B, actions) bool


class Network(nn.Module):
    """Policy and value of one side: the statement scales and shifts the features of each box and of the scene."""

    def __init__(self, tokens: Tensor, boxes: int, slots: int, actions: int) -> None:
        """`tokens`: (statements, length) token ids, 0 is padding."""
        super().__init__()
        self.tokens = tokens
        self.words = nn.Embedding(int(tokens.max()) + 1, WIDTH)
        self.positions = nn.Parameter(torch.randn(tokens.shape[1], WIDTH) * 0.02)
        self.reader = nn.TransformerEncoderLayer(WIDTH, HEADS, 2 * WIDTH, 0.0, batch_first=True, norm_first=True)
        self.scales = nn.Linear(2 * WIDTH, 2 * 3 * BOX_WIDTH)
        self.scene_scales = nn.Linear(2 * WIDTH, 2 * SCENE_WIDTH)
        self.blocks = nn.Embedding(slots * 4, BOX_WIDTH)  # by slot and colour, 0 for none
        self.boxes = nn.ModuleList(nn.Linear(BOX_WIDTH, BOX_WIDTH) for _ in range(3))
        self.targets = nn.Embedding(2, SCENE_WIDTH)
        self.scene = nn.Linear(boxes * BOX_WIDTH, SCENE_WIDTH)
        self.body = nn.Linear(SCENE_WIDTH, SCENE_WIDTH)
        self.policy = nn.Linear(SCENE_WIDTH, actions)
        self.value = nn.Linear(SCENE_WIDTH, 1)
        nn.init.normal_(self.policy.weight, std=0.01)

    def forward(self, seen: Observation) -> tuple[Categorical, Tensor]:
        """The distribution over legal actions, and the values (B,)."""
        statements, statement_of = seen.statement_of.unique(return_inverse=True)  # each statement is encoded once
        tokens = self.tokens[statements]
        padding = tokens == 0
        words = self.reader(self.words(tokens) + self.positions, src_key_padding_mask=padding)
        words = words.masked_fill(padding[..., None], -torch.inf)
        read = torch.cat([words.amax(1), words.logsumexp(1)], 1)
        scales = self.scales(read)[statement_of].unflatten(1, (3, 2, 1, BOX_WIDTH))
        slots = torch.arange(seen.colours.shape[2]) * 4
        boxes = self.blocks(seen.colours + slots).sum(2)  # (B, 3, BOX_WIDTH)
        for layer, index in zip(self.boxes, range(3), strict=True):
            boxes = boxes + ((1 + scales[:, index, 0]) * layer(boxes) + scales[:, index, 1]).relu()
        scale, shift = self.scene_scales(read)[statement_of].chunk(2, 1)
        scene = ((1 + scale) * (self.scene(boxes.flatten(1)) + self.targets(seen.target)) + shift).relu()
        scene = scene + self.body(scene).relu()
        logits = self.policy(scene).masked_fill(~seen.legal, -torch.inf)
        return Categorical(logits=logits, validate_args=False), self.value(scene)[:, 0]


@dataclass
class Turn:
    """One turn of all N games, for one side."""

    seen: Observation
    actions: Tensor  # (N,)
    log_probabilities: Tensor  # (N,)
    values: Tensor  # (N,)
    rewards: Tensor  # (N,)
    ended: Tensor  # (N,) 1.0 if the game ended


class StatementSampler:
    """Chooses tasks so that the games of a group play one statement, which changes with each rollout."""

    def __init__(self, statement_of: np.ndarray, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        order = np.argsort(statement_of, kind="stable")
        self.tasks = np.split(order, np.flatnonzero(np.diff(statement_of[order])) + 1)  # by statement
        self.next_statements()

    def next_statements(self) -> None:
        self.statements = self.rng.integers(len(self.tasks), size=GROUPS)

    def __call__(self, games: np.ndarray) -> np.ndarray:
        return np.array([self.rng.choice(self.tasks[self.statements[game // GAMES_PER_GROUP]]) for game in games])


class Trainer:
    """A batch of games, and both sides' networks and optimisers."""

    def __init__(self, start: str, corpus: str, seed: int) -> None:
        settings = {**GAME, "start": start, "corpus": corpus}
        tasks = BatchedGames(1, **settings).tasks
        statements = {statement: index for index, statement in enumerate(dict.fromkeys(t.statement for t in tasks))}
        vocabulary, length = Vocabulary.from_statements(statements), default_length(statements)
        tokens = torch.from_numpy(np.stack([vocabulary.encode(statement, length) for statement in statements]))
        self.statement_of = torch.tensor([statements[task.statement] for task in tasks])
        self.sampler = StatementSampler(self.statement_of.numpy(), seed)
        self.games = BatchedGames(GROUPS * GAMES_PER_GROUP, sampler=self.sampler, copy=False, **settings)
        self.observations, self.infos = self.games.reset(seed=seed)
        self.networks, self.optimisers = {}, {}
        for agent in AGENTS:
            parts: Any = self.games.single_observation_spaces[agent]["observation"]
            actions = int(self.games.single_action_spaces[agent].n)
            self.networks[agent] = Network(tokens, *parts["item_array"].shape[:2], actions=actions)
            self.optimisers[agent] = torch.optim.Adam(self.networks[agent].parameters(), LEARNING_RATE, eps=1e-5)
        self.ended: list[bool] = []  # whether each game that ended was a success

    def seen(self, agent: str) -> Observation:
        """A side's current observation."""
        observation = self.observations[agent]
        parts = observation["observation"]
        return Observation(
            torch.from_numpy(parts["item_array"][..., COLOUR].astype(np.int64)) + 1,
            self.statement_of[torch.from_numpy(self.infos["task_index"])],
            torch.from_numpy(parts["target"]),
            torch.from_numpy(observation["action_mask"].astype(bool)),
        )

    @torch.no_grad()
    def play(self) -> dict[str, list[Turn]]:
        """A rollout of all games, for both sides."""
        self.sampler.next_statements()
        turns: dict[str, list[Turn]] = {agent: [] for agent in AGENTS}
        for _ in range(TURNS):
            actions: dict[str, np.ndarray] = {}
            for agent in AGENTS:
                seen = self.seen(agent)
                policy, values = self.networks[agent](seen)
                chosen = policy.sample()
                turns[agent].append(Turn(seen, chosen, policy.log_prob(chosen), values, values, values))
                actions[agent] = chosen.numpy()
            self.observations, rewards, terminated, truncated, self.infos = self.games.step(actions)
            ended = terminated | truncated
            for agent in AGENTS:
                turns[agent][-1].rewards = torch.from_numpy(rewards[agent]).float()
                turns[agent][-1].ended = torch.from_numpy(ended).float()
            self.ended += self.infos["is_success"][ended].tolist()
        return turns

    def learn(self, agent: str, turns: list[Turn], done: float) -> None:
        """PPO updates on a rollout. `done`: training progress, 0 to 1."""
        network, optimiser = self.networks[agent], self.optimisers[agent]
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * (1 - done)
        entropy_weight = ENTROPY[0] + (ENTROPY[1] - ENTROPY[0]) * done
        with torch.no_grad():
            following = network(self.seen(agent))[1]
            advantage, advantages = torch.zeros_like(following), []
            for turn in reversed(turns):
                goes_on = 1 - turn.ended
                advantage = turn.rewards + DISCOUNT * goes_on * (following + TRACE * advantage) - turn.values
                advantages.append(advantage)
                following = turn.values
            gains = torch.cat(advantages[::-1])
        seen = Observation(*(torch.cat(parts) for parts in zip(*(turn.seen for turn in turns), strict=True)))
        actions, old, values = (
            torch.cat([getattr(turn, name) for turn in turns]) for name in ("actions", "log_probabilities", "values")
        )
        returns, scaled = gains + values, (gains - gains.mean()) / (gains.std() + 1e-6)
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(actions)).chunk(MINI_BATCHES):
                policy, value = network(Observation(*(part[rows] for part in seen)))
                ratio = (policy.log_prob(actions[rows]) - old[rows]).exp()
                clipped = ratio.clamp(1 - CLIP, 1 + CLIP)
                gain = torch.minimum(ratio * scaled[rows], clipped * scaled[rows]).mean()
                entropy = -(policy.probs * policy.probs.clamp(min=1e-9).log()).sum(1).mean()
                loss = -gain + VALUE_WEIGHT * (value - returns[rows]).pow(2).mean() - entropy_weight * entropy
                optimiser.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(network.parameters(), GRADIENT_NORM)
                optimiser.step()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1_500_000, help="turns of all games together")
    parser.add_argument("--start", default="scratch", help="scratch or flipit")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    trainer = Trainer(args.start, args.corpus, args.seed)
    steps, reported = 0, 0
    print("  turns  success")
    while steps < args.steps:
        turns = trainer.play()
        for agent in AGENTS:
            trainer.learn(agent, turns[agent], steps / args.steps)
        steps += TURNS * GROUPS * GAMES_PER_GROUP
        if 10 * steps >= (reported + 1) * args.steps:
            reported = 10 * steps // args.steps
            recent = trainer.ended[-4_000:]
            print(f"{steps:7,}  {np.mean(recent) if recent else 0.0:.3f}", flush=True)


if __name__ == "__main__":
    main()
