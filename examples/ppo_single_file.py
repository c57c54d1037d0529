"""PPO in one file, from pixels and text, over `gym.make_vec`: for Tower, with a network that reads the statement.

What matters besides the network: action masks; STOP is forced wherever it succeeds in training, with its whole return
as advantage; and the sampler of tasks: eight environments at a time play one statement, which is read once for all of
them, and colours are exchanged in words and scenes alike, which makes six statements of each.
docs/training.md shows the curve. Needs the extra `train`. Run: python examples/ppo_single_file.py --steps 1000000
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.learning.common.statement_sampler import StatementSampler

try:
    import torch
    from torch import Tensor, nn
    from torch.distributions import Categorical
    from torch.nn import functional
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[train]"')

ENVS, GROUP = 512, 8  # groups of environments play one statement
STEPS = 8  # of each environment in a rollout
EPOCHS, MINI_BATCH = 2, 1024
LEARNING_RATE, CLIP, VALUE_WEIGHT, GRADIENT_NORM = 1e-3, 0.2, 0.5, 0.5
ENTROPY = (0.08, 0.01)  # weight at the beginning and at the end
DISCOUNT, TRACE = 0.99, 0.95
WIDTH, HEADS = 64, 4
STOP, COLOURS, BOXES = 0, 3, 3  # actions: STOP, ADD of each colour to each box, REMOVE from each box
FIRST, EVERY = 2, 5  # the pixels seen of each row and column: four of each block
SIDE, PITCH = 10, 14  # seen pixels: a box's side, and from a box to the next


class State(NamedTuple):
    """The policy's observations of B states."""

    statement: Tensor  # (B, length) token ids, 0 is padding
    image: Tensor  # (B, 10, 38, 3) the seen pixels
    target: Tensor  # (B,)
    legal: Tensor  # (B, actions) bool


def seen_pixels(images: np.ndarray) -> np.ndarray:
    """(B, 10, 38, 3) from images (B, 50, 190, 3)."""
    return images[:, FIRST::EVERY, FIRST::EVERY].copy()


def observe(envs: Any, observation: dict[str, Any]) -> State:
    """The states of a batch."""
    parts = (
        observation["statement"],
        seen_pixels(observation["image"]),
        observation["target"][:, 0],
        envs.action_masks(),
    )
    return State(*map(torch.from_numpy, parts))


class Attention(nn.Module):
    """Vectors of B states read the words of their statements."""

    def __init__(self) -> None:
        super().__init__()
        self.norm, self.query, self.out = nn.LayerNorm(WIDTH), nn.Linear(WIDTH, WIDTH), nn.Linear(WIDTH, WIDTH)
        self.key_value = nn.Linear(WIDTH, 2 * WIDTH)
        hidden = nn.Linear(WIDTH, 2 * WIDTH)
        self.body = nn.Sequential(nn.LayerNorm(WIDTH), hidden, nn.ReLU(), nn.Linear(2 * WIDTH, WIDTH))

    def forward(self, x: Tensor, words: Tensor, mask: Tensor, statement_of: Tensor) -> Tensor:
        """(B, vectors, WIDTH) from x of that shape and words (statements, length, WIDTH)."""
        both = self.key_value(words).unflatten(2, (2 * HEADS, -1)).transpose(1, 2)
        key, value = both.index_select(0, statement_of).chunk(2, 1)
        query = self.query(self.norm(x)).unflatten(2, (HEADS, -1)).transpose(1, 2)
        read = functional.scaled_dot_product_attention(query, key, value, mask[statement_of][:, None, None])
        x = x + self.out(read.transpose(1, 2).flatten(2))
        return x + self.body(x)


class Network(nn.Module):
    """Policy and value: boxes read the statement, the scene is their sum."""

    def __init__(self, words: int, length: int) -> None:
        super().__init__()
        self.words = nn.Embedding(words, WIDTH)
        self.positions = nn.Parameter(torch.randn(length, WIDTH) * 0.02)
        layer = nn.TransformerEncoderLayer(WIDTH, HEADS, 2 * WIDTH, 0.0, batch_first=True, norm_first=True)
        self.reader = nn.TransformerEncoder(layer, 2, enable_nested_tensor=False)
        self.box = nn.Sequential(nn.Linear(3 * SIDE**2, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH))
        self.box_readings = nn.ModuleList([Attention(), Attention()])
        self.place = nn.Parameter(torch.randn(BOXES, WIDTH) * 0.02)
        self.part, self.whole = nn.Linear(WIDTH, WIDTH), nn.Linear(WIDTH, WIDTH)
        self.scene_reading = Attention()
        self.truth = nn.Linear(WIDTH, 1)  # whether the statement is true, which says when to STOP
        self.targets = nn.Embedding(2, WIDTH)
        self.judge = nn.Sequential(nn.Linear(WIDTH, WIDTH), nn.ReLU())
        self.stop, self.value = nn.Linear(WIDTH, 1), nn.Linear(WIDTH, 1)
        last_of_edits = nn.Linear(WIDTH, COLOURS + 1)
        self.edits = nn.Sequential(nn.Linear(2 * WIDTH, WIDTH), nn.ReLU(), last_of_edits)
        for last in (self.truth, self.stop, last_of_edits):
            nn.init.normal_(last.weight, std=0.01)

    def forward(self, state: State) -> tuple[Categorical, Tensor]:
        """The distribution over legal actions, and the values (B,)."""
        tokens, statement_of = state.statement.unique(dim=0, return_inverse=True)  # each statement is read once
        tokens = tokens[:, : int((tokens != 0).sum(1).max())]
        padding = tokens == 0
        words = self.reader(self.words(tokens) + self.positions[: tokens.shape[1]], src_key_padding_mask=padding)
        pixels = state.image.float() / 127.5 - 1
        boxes = self.box(pixels.unfold(2, SIDE, PITCH).transpose(1, 2).flatten(2))  # (B, 3, WIDTH)
        for reading in self.box_readings:
            boxes = reading(boxes, words, ~padding, statement_of)
        scene = self.whole((self.part(boxes) + self.place).relu().sum(1, keepdim=True))
        scene = self.scene_reading(scene, words, ~padding, statement_of)[:, 0]
        judged = self.judge(scene + self.targets(state.target))
        stop = self.stop(judged) + self.truth(scene) * (2 * state.target[:, None] - 1)
        edits = self.edits(torch.cat([boxes, judged[:, None].expand_as(boxes)], 2))  # (B, 3, colours and REMOVE)
        logits = torch.cat([stop, edits[..., :-1].flatten(1), edits[..., -1]], 1).masked_fill(~state.legal, -torch.inf)
        values = self.value(judged)[:, 0].tanh()  # returns are in -1 .. 1
        return Categorical(logits=logits, validate_args=False), values


def make(env_id: str, count: int, **options: Any) -> Any:
    return gym.make_vec(env_id, num_envs=count, observation="arrays", autoreset_mode=AutoresetMode.SAME_STEP, **options)


@torch.no_grad()
def accuracy(network: Network, env_id: str, **options: Any) -> float:
    """The share of dev's tasks that the most probable actions solve."""
    count = len(gym.make(env_id, split="dev", corpus=options["corpus"]).get_wrapper_attr("tasks"))
    envs = make(env_id, count, split="dev", evaluation=True, **options)
    observation, _ = envs.reset(seed=0)
    solved, ended = 0, np.zeros(count, bool)
    while not ended.all():
        policy, _ = network(observe(envs, observation))
        observation, _, terminated, truncated, infos = envs.step(policy.logits.argmax(1).numpy())
        ends = (terminated | truncated) & ~ended
        if ends.any():
            solved += int(infos["final_info"]["is_success"][ends].sum())
        ended |= ends
    return solved / count


def train(env_id: str, corpus: str, max_steps: int, seed: int) -> None:
    torch.manual_seed(seed)
    sampler = StatementSampler(env_id, corpus, same_statement=GROUP, recolour=True)
    envs = make(env_id, ENVS, corpus=corpus, sampler=sampler)
    observation, _ = envs.reset(seed=seed)
    length = envs.single_observation_space["statement"].shape[0]
    options = {"corpus": corpus, "vocabulary": sampler.vocabulary, "length": length}
    network = Network(len(sampler.vocabulary), length)
    optimiser = torch.optim.Adam(network.parameters(), LEARNING_RATE, eps=1e-5)
    begin, steps, reported, successes = time.process_time(), 0, 0, []
    print("    steps  CPU s  training  dev")
    while steps < max_steps:
        # A rollout.
        states, rows = [], []
        for _ in range(STEPS):
            with torch.no_grad():
                state = observe(envs, observation)
                policy, values = network(state)
                forced = torch.from_numpy(envs.goal_reached())
                actions = policy.sample().where(~forced, STOP)
            observation, rewards, terminated, truncated, infos = envs.step(actions.numpy())
            ended = terminated | truncated
            states.append(state)
            results = torch.tensor(rewards).float(), torch.tensor(ended)
            rows.append((actions, policy.log_prob(actions), values, forced, *results))
            if ended.any():
                successes += infos["final_info"]["is_success"][ended].tolist()
        steps += STEPS * ENVS

        # Advantages; episodes that end have no future, as the horizon is part of the rules.
        actions, old, values, forced, rewards, ended = map(torch.stack, zip(*rows, strict=True))
        with torch.no_grad():
            following = network(observe(envs, observation))[1]
        advantages, gae = torch.zeros_like(values), torch.zeros(ENVS)
        for t in reversed(range(STEPS)):
            goes_on = DISCOUNT * ~ended[t]
            gae = rewards[t] + goes_on * (following + TRACE * gae) - values[t]
            advantages[t], following = gae, values[t]
        returns = advantages + values
        advantages = advantages.where(~forced, returns)
        advantages /= advantages.std() + 1e-8  # scaled, not centred: a STOP that succeeds is always encouraged

        # PPO's updates.
        done = min(1.0, steps / max_steps)
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * (1 - done)
        entropy_weight = ENTROPY[0] + (ENTROPY[1] - ENTROPY[0]) * done
        state = State(*(torch.cat(parts) for parts in zip(*states, strict=True)))
        actions, old, returns, advantages = (part.flatten() for part in (actions, old, returns, advantages))
        for _ in range(EPOCHS):
            for batch in torch.randperm(len(actions)).split(MINI_BATCH):
                policy, value = network(State(*(part[batch] for part in state)))
                ratio, advantage = (policy.log_prob(actions[batch]) - old[batch]).exp(), advantages[batch]
                gain = torch.minimum(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage).mean()
                entropy = -(policy.probs * policy.probs.clamp(min=1e-9).log()).sum(1).mean()
                loss = -gain + VALUE_WEIGHT * (value - returns[batch]).pow(2).mean() - entropy_weight * entropy
                optimiser.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(network.parameters(), GRADIENT_NORM)
                optimiser.step()

        if done >= (reported + 1) / 10:
            reported = int(10 * done)
            seconds, dev = time.process_time() - begin, accuracy(network, env_id, **options)
            print(f"{steps:9,} {seconds:6.0f}     {np.mean(successes or 0):.3f}  {dev:.3f}", flush=True)
            successes.clear()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of all environments together")
    parser.add_argument("--env", default="lilgym_mp/TowerScratch-v0", help="or lilgym_mp/TowerFlipIt-v0")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    train(args.env, args.corpus, args.steps, args.seed)


if __name__ == "__main__":
    main()
