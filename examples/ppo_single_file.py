"""PPO for Tower in one file, over `gym.make_vec`: action masks, stop forcing, and a network that reads the statement.

It sees the blocks of each box instead of pixels (`structured_observation_v0`). What matters besides the network: in
training STOP is forced wherever it succeeds, with its whole return as advantage; and data augmentation: colours are
swapped in words, blocks and actions alike, which makes six statements of each.
docs/training.md shows the curve. Needs the extra `train`. Run: python examples/ppo_single_file.py --minutes 5
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import permutations
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length
from lilgym_mp.wrappers import structured_observation_v0

try:
    import torch
    from torch import Tensor, nn
    from torch.distributions import Categorical
    from torch.nn import functional
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[train]"')

GROUPS, GROUP = 64, 8  # 64 groups of 8 environments; a group plays one statement, which is read once for all
STEPS = 8  # of each environment in a rollout
EPOCHS, MINI_BATCH = 2, 1024
LEARNING_RATE, CLIP, VALUE_WEIGHT, GRADIENT_NORM = 1e-3, 0.2, 0.5, 0.5
ENTROPY = (0.08, 0.01)  # weight at the beginning and at the end
DISCOUNT, TRACE = 0.99, 0.95
WIDTH, HEADS = 64, 4
STOP, COLOURS, BOXES = 0, 3, 3  # actions: STOP, ADD of each colour to each box, REMOVE from each box
COLOUR = 3  # index of an item's colour in `item_array`
COLOUR_NAMES = ("yellow", "black", "blue")
SWAPS = np.array(list(permutations(range(COLOURS))))  # (6, 3) the colour seen instead of each colour; the first: itself
SEEN = np.pad(SWAPS + 1, ((0, 0), (1, 0)))  # (6, 4) likewise for 0 = none, 1 = yellow, ...
BACK = SWAPS.argsort(1)  # (6, 3) the colour meant by each colour
ADDS = 1 + COLOURS * np.arange(BOXES)[:, None] + BACK[:, None]  # (6, 3, 3) the ADD meant, by box and colour
MEANT = np.hstack([np.full((6, 1), STOP), ADDS.reshape(6, -1), np.tile([10, 11, 12], (6, 1))])  # (6, 13) actions meant


class State(NamedTuple):
    """What the policy sees in B states."""

    statement: Tensor  # (B,) row of the tokens
    colours: Tensor  # (B, 3, slots) of the blocks of each box from the bottom, 0 in empty slots
    target: Tensor  # (B,)
    legal: Tensor  # (B, actions) bool


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

    def __init__(self, words: int, length: int, slots: int) -> None:
        super().__init__()
        self.words = nn.Embedding(words, WIDTH)
        self.positions = nn.Parameter(torch.randn(length, WIDTH) * 0.02)
        layer = nn.TransformerEncoderLayer(WIDTH, HEADS, 2 * WIDTH, 0.0, batch_first=True, norm_first=True)
        self.reader = nn.TransformerEncoder(layer, 2, enable_nested_tensor=False)
        self.blocks = nn.Embedding(slots * (1 + COLOURS), WIDTH)  # by slot and colour
        self.box = nn.Sequential(nn.ReLU(), nn.Linear(WIDTH, WIDTH))
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

    def forward(self, tokens: Tensor, state: State) -> tuple[Categorical, Tensor]:
        """The distribution over legal actions, and the values (B,). `tokens`: (statements, length), 0 is padding."""
        statements, statement_of = state.statement.unique(return_inverse=True)  # each statement is read once
        tokens = tokens[statements]
        tokens = tokens[:, : int((tokens != 0).sum(1).max())]
        padding = tokens == 0
        words = self.reader(self.words(tokens) + self.positions[: tokens.shape[1]], src_key_padding_mask=padding)
        slots = torch.arange(state.colours.shape[2]) * (1 + COLOURS)
        boxes = self.box(self.blocks(state.colours + slots).sum(2))  # (B, 3, WIDTH)
        for reading in self.box_readings:
            boxes = reading(boxes, words, ~padding, statement_of)
        scene = self.whole((self.part(boxes) + self.place).relu().sum(1, keepdim=True))
        scene = self.scene_reading(scene, words, ~padding, statement_of)[:, 0]
        judged = self.judge(scene + self.targets(state.target))
        stop = self.stop(judged) + self.truth(scene) * (2 * state.target[:, None] - 1)
        edits = self.edits(torch.cat([boxes, judged[:, None].expand_as(boxes)], 2))  # (B, 3, colours and REMOVE)
        logits = torch.cat([stop, edits[..., :-1].flatten(1), edits[..., -1]], 1).masked_fill(~state.legal, -torch.inf)
        return Categorical(logits=logits, validate_args=False), self.value(judged)[
            :, 0
        ].tanh()  # returns are in -1 .. 1


class Tasks:
    """The tasks of a split with six ways to swap colours: way k of statement i is row 6 i + k of `tokens`."""

    def __init__(self, envs: Any, vocabulary: Vocabulary | None = None, length: int | None = None) -> None:
        tasks = envs.unwrapped.tasks
        self.ids = np.array(tasks.ids, object)
        statements = {statement: row for row, statement in enumerate(dict.fromkeys(task.statement for task in tasks))}
        self.statement_of = np.array([statements[task.statement] for task in tasks])
        self.vocabulary = vocabulary or Vocabulary.from_statements(statements)
        self.length = length or default_length(statements)
        tokens = np.stack([self.vocabulary.encode(statement, self.length) for statement in statements])
        words = np.tile(np.arange(len(self.vocabulary)), (len(SWAPS), 1))  # (6, words) the word seen instead of each
        names = np.array([self.vocabulary.token_id(name) for name in COLOUR_NAMES])
        words[:, names] = names[SWAPS]
        self.tokens = torch.from_numpy(words[:, tokens].swapaxes(0, 1).reshape(-1, self.length))


def observe(envs: Any, observation: dict[str, Any], statement: np.ndarray, swaps: np.ndarray) -> State:
    """The states of N environments: (N,) indices of statements and of swaps."""
    colours = SEEN[swaps[:, None, None], observation["item_array"][..., COLOUR] + 1]
    legal = envs.action_masks()[np.arange(len(swaps))[:, None], MEANT[swaps]]
    row = len(SWAPS) * statement + swaps
    return State(*map(torch.from_numpy, (row, colours, np.asarray(observation["target"]), legal)))


@torch.no_grad()
def accuracy(network: Network, env_id: str, corpus: str, trained: Tasks) -> float:
    """The share of dev's tasks that the most probable actions solve."""
    options: dict[str, Any] = {"corpus": corpus, "split": "dev"}
    count = len(gym.make(env_id, **options).get_wrapper_attr("tasks"))
    mode = AutoresetMode.SAME_STEP
    envs: Any = gym.make_vec(env_id, num_envs=count, evaluation=True, autoreset_mode=mode, **options)
    envs = structured_observation_v0(envs)
    tasks = Tasks(envs, trained.vocabulary, trained.length)
    observation, _ = envs.reset(seed=0)
    solved, ended, swaps = 0, np.zeros(count, bool), np.zeros(count, np.int64)
    while not ended.all():
        policy, _ = network(tasks.tokens, observe(envs, observation, tasks.statement_of, swaps))
        observation, _, terminated, truncated, infos = envs.step(policy.logits.argmax(1).numpy())
        ends = (terminated | truncated) & ~ended
        if ends.any():
            solved += int(infos["final_info"]["is_success"][ends].sum())
        ended |= ends
    return solved / count


def train(env_id: str, corpus: str, minutes: float, max_steps: int | None, seed: int) -> None:
    rng, count = np.random.default_rng(seed), GROUPS * GROUP
    torch.manual_seed(seed)
    envs: Any = gym.make_vec(env_id, num_envs=count, corpus=corpus, copy=False, autoreset_mode=AutoresetMode.DISABLED)
    envs = structured_observation_v0(envs)
    tasks = Tasks(envs)
    tasks_of = [np.flatnonzero(tasks.statement_of == statement) for statement in range(tasks.statement_of.max() + 1)]
    slots = envs.single_observation_space["item_array"].shape[1]
    network = Network(len(tasks.vocabulary), tasks.length, slots)
    optimiser = torch.optim.Adam(network.parameters(), LEARNING_RATE, eps=1e-5)
    statement, swaps = np.zeros(count, np.int64), np.zeros(count, np.int64)  # of each environment's episode

    def restart(ended: np.ndarray) -> dict[str, Any]:
        """Starts episodes of the groups' statements."""
        statement[ended], swaps[ended] = group_statement[ended], group_swaps[ended]
        chosen = [
            tasks.ids[rng.choice(tasks_of[of])] if ends else None for of, ends in zip(statement, ended, strict=True)
        ]
        return envs.reset(options={"task": chosen, "reset_mask": ended})[0]

    begin, steps, done, reported, successes = time.process_time(), 0, 0.0, 0, []
    print("    steps  CPU s  training  dev")
    while done < 1:
        # A rollout: each group plays its new statement as soon as its episodes end.
        group_statement = rng.integers(len(tasks_of), size=GROUPS).repeat(GROUP)
        group_swaps = rng.integers(len(SWAPS), size=GROUPS).repeat(GROUP)
        if steps == 0:
            observation = restart(np.ones(count, bool))
        states, rows = [], []
        for _ in range(STEPS):
            with torch.no_grad():
                state = observe(envs, observation, statement, swaps)
                policy, values = network(tasks.tokens, state)
                forced = torch.from_numpy(envs.goal_reached().copy())
                actions = policy.sample().where(~forced, STOP)
            meant = MEANT[swaps, actions.numpy()]
            observation, rewards, terminated, truncated, infos = envs.step(meant)
            ended = terminated | truncated
            states.append(state)
            results = torch.tensor(rewards).float(), torch.tensor(ended)
            rows.append((actions, policy.log_prob(actions), values, forced, *results))
            if ended.any():
                successes += infos["is_success"][ended].tolist()
                observation = restart(ended)
        steps += STEPS * count

        # Advantages; episodes that end have no future, as the horizon is part of the rules.
        actions, old, values, forced, rewards, ended = map(torch.stack, zip(*rows, strict=True))
        with torch.no_grad():
            following = network(tasks.tokens, observe(envs, observation, statement, swaps))[1]
        advantages, gae = torch.zeros_like(values), torch.zeros(count)
        for t in reversed(range(STEPS)):
            goes_on = DISCOUNT * ~ended[t]
            gae = rewards[t] + goes_on * (following + TRACE * gae) - values[t]
            advantages[t], following = gae, values[t]
        returns = advantages + values
        advantages = advantages.where(~forced, returns)
        advantages /= advantages.std() + 1e-8  # scaled, not centred: a STOP that succeeds is always encouraged

        # PPO's updates.
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * (1 - done)
        entropy_weight = ENTROPY[0] + (ENTROPY[1] - ENTROPY[0]) * done
        state = State(*(torch.cat(parts) for parts in zip(*states, strict=True)))
        actions, old, returns, advantages = (part.flatten() for part in (actions, old, returns, advantages))
        for _ in range(EPOCHS):
            for batch in torch.randperm(len(actions)).split(MINI_BATCH):
                policy, value = network(tasks.tokens, State(*(part[batch] for part in state)))
                ratio, advantage = (policy.log_prob(actions[batch]) - old[batch]).exp(), advantages[batch]
                gain = torch.minimum(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage).mean()
                entropy = -(policy.probs * policy.probs.clamp(min=1e-9).log()).sum(1).mean()
                loss = -gain + VALUE_WEIGHT * (value - returns[batch]).pow(2).mean() - entropy_weight * entropy
                optimiser.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(network.parameters(), GRADIENT_NORM)
                optimiser.step()

        seconds = time.process_time() - begin
        done = min(1.0, steps / max_steps if max_steps else seconds / (60 * minutes))
        if done >= (reported + 1) / 10:
            reported = int(10 * done)
            dev = accuracy(network, env_id, corpus, tasks)
            print(f"{steps:9,} {seconds:6.0f}     {np.mean(successes or 0):.3f}  {dev:.3f}", flush=True)
            successes.clear()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="CPU minutes of training")
    parser.add_argument("--steps", type=int, help="steps of all environments together, instead of --minutes")
    parser.add_argument("--env", default="lilgym_mp/TowerScratch-v0", help="or lilgym_mp/TowerFlipIt-v0")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    train(args.env, args.corpus, args.minutes, args.steps, args.seed)


if __name__ == "__main__":
    main()
