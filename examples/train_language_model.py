"""Trains a tiny language model from scratch: first on plans of the expert, then by rewards for its own plans.

Needs torch and no download. Each line printed has a step, the success rate on 400 tasks of dev (greedy), the mean
number of actions, and the share of plans that do nothing: empty ones and those that begin with STOP.
Try: python examples/train_language_model.py --supervised-steps 20 --reward-steps 5 --rows 500
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from itertools import chain, islice
from pathlib import Path

import torch
from torch import Tensor, nn

from lilgym_mp.contrib.rlvr import Row, expert_reply, rows, score
from lilgym_mp.contrib.rlvr.rows import dynamics_of
from lilgym_mp.corpus import words
from lilgym_mp.scene.actions import describe

TOWER = dynamics_of("tower").appearance
ACTIONS = [describe(TOWER.decode(index)) for index in range(TOWER.action_count)]
END, PAD = len(ACTIONS), len(ACTIONS) + 1  # tokens after those of the actions
MAX_WORDS, SLOTS, MAX_PLAN = 20, 12, 8  # words of a statement, places for blocks, actions of a plan
PROMPT = SLOTS + 1 + MAX_WORDS + 1
GROUP, TEMPERATURE = 8, 1.0


class Tokens:
    """Encodes prompts: the scene's blocks, the target, the statement's words. Words not seen before are ignored."""

    def __init__(self, seen: Sequence[Row]) -> None:
        names = ["yellow", "black", "blue", "true", "false", "plan"]
        names += sorted({word for row in seen for word in words(row.task.statement)} - set(names))
        self.index = {name: PAD + 1 + number for number, name in enumerate(names)}
        self.count = PAD + 1 + len(names)

    def prompts(self, batch: Sequence[Row]) -> Tensor:  # (B, PROMPT)
        return torch.tensor([self._prompt(row) for row in batch])

    def _prompt(self, row: Row) -> list[int]:
        boxes = ([item.colour.name.lower() for item in box.items] for box in row.task.start.boxes)
        statement = [word for word in words(row.task.statement) if word in self.index]
        text = [
            *chain.from_iterable(_padded(box, 4) for box in boxes),
            str(row.task.target).lower(),
            *_padded(statement, MAX_WORDS),
            "plan",
        ]
        return [PAD if word is None else self.index[word] for word in text]


def _padded(names: list[str], length: int) -> list[str | None]:
    return [*names[:length], *[None] * (length - len(names))]


class LanguageModel(nn.Module):
    """A causal transformer."""

    def __init__(self, tokens: int, width: int = 96, layers: int = 3) -> None:
        super().__init__()
        self.token = nn.Embedding(tokens, width)
        self.position = nn.Parameter(torch.randn(PROMPT + MAX_PLAN + 1, width) * 0.02)
        layer = nn.TransformerEncoderLayer(width, 4, 4 * width, dropout=0.0, batch_first=True, norm_first=True)
        self.layers = nn.TransformerEncoder(layer, layers, nn.LayerNorm(width), enable_nested_tensor=False)
        self.head = nn.Linear(width, END + 1)

    def forward(self, tokens: Tensor) -> Tensor:  # (B, T) -> (B, T - PROMPT + 1, END + 1): logits of the plan's tokens
        length = tokens.shape[1]
        mask = nn.Transformer.generate_square_subsequent_mask(length)
        hidden = self.layers(self.token(tokens) + self.position[:length], mask=mask, is_causal=True)
        return self.head(hidden[:, PROMPT - 1 :])

    @torch.no_grad()
    def plans(self, prompts: Tensor, temperature: float) -> Tensor:  # (B, MAX_PLAN + 1), PAD after END
        tokens, ended = prompts, torch.zeros(len(prompts), dtype=torch.bool)
        for _ in range(MAX_PLAN + 1):
            logits = self(tokens)[:, -1]
            drawn = torch.multinomial((logits / temperature).softmax(-1), 1)[:, 0] if temperature else logits.argmax(-1)
            drawn = torch.where(ended, PAD, drawn)
            ended |= drawn == END
            tokens = torch.cat([tokens, drawn[:, None]], 1)
            if ended.all():
                break
        return tokens[:, prompts.shape[1] :]

    def log_probabilities(self, prompts: Tensor, plans: Tensor) -> Tensor:  # (B,)
        logits = self(torch.cat([prompts, plans[:, :-1]], 1)).log_softmax(-1)
        chosen = logits.gather(-1, plans.clamp(max=END)[..., None])[..., 0]
        return (chosen * (plans != PAD)).sum(1)


def encoded_plans(replies: Sequence[str]) -> Tensor:
    plans = [[*map(ACTIONS.index, reply.splitlines()[:MAX_PLAN]), END] for reply in replies]
    return torch.tensor([plan + [PAD] * (MAX_PLAN + 1 - len(plan)) for plan in plans])


def reply_of(plan: Sequence[int]) -> str:
    return "\n".join(ACTIONS[token] for token in plan if token < END)


class Training:
    def __init__(self, args: argparse.Namespace) -> None:
        torch.manual_seed(args.seed)
        lengths = {"min_actions": args.min_actions, "max_actions": args.max_actions}
        self.stream = rows("plan", "tower", args.level, seed=args.seed, **lengths)
        self.dev = list(islice(rows("plan", "tower", args.level, split="dev", **lengths), 400))
        self.seen = list(islice(self.stream, args.rows))
        self.tokens = Tokens(self.seen)
        self.model = LanguageModel(self.tokens.count)
        self.args = args
        self.begun = time.process_time()

    def supervise(self) -> None:
        """Learns the expert's plans."""
        replies = encoded_plans(list(map(expert_reply, self.seen)))
        prompts = self.tokens.prompts(self.seen)
        optimizer = torch.optim.AdamW(self.model.parameters(), lr=1e-3)
        for step in range(self.args.supervised_steps):
            chosen = torch.randint(len(prompts), (128,))
            loss = -self.model.log_probabilities(prompts[chosen], replies[chosen]).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            if step % 100 == 0:
                self.report("supervised", step)
        self.report("supervised", self.args.supervised_steps)

    def reinforce(self) -> None:
        """Group-relative policy gradient: each plan against the others for the same prompt."""
        optimizer = torch.optim.AdamW(self.model.parameters(), lr=self.args.learning_rate)
        for step in range(1, self.args.reward_steps + 1):
            batch = [row for row in islice(self.stream, self.args.prompts) for _ in range(GROUP)]
            prompts = self.tokens.prompts(batch)
            plans = self.model.plans(prompts, TEMPERATURE)
            replies = map(reply_of, plans.tolist())
            rewards = torch.tensor([score(reply, row).reward for reply, row in zip(replies, batch, strict=True)])
            groups = rewards.view(-1, GROUP)
            advantages = ((groups - groups.mean(1, keepdim=True)) / (groups.std(1, keepdim=True) + 1e-3)).flatten()
            loss = -(advantages * self.model.log_probabilities(prompts, plans)).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
            optimizer.step()
            if step % self.args.report_every == 0 or step == self.args.reward_steps:
                self.report("rewarded", step)

    def report(self, phase: str, step: int) -> None:
        plans = self.model.plans(self.tokens.prompts(self.dev), 0.0).tolist()
        replies = list(map(reply_of, plans))
        record = {
            "phase": phase,
            "step": step,
            "success": sum(score(reply, row).reward for reply, row in zip(replies, self.dev, strict=True))
            / len(self.dev),
            "actions": sum(len(reply.splitlines()) for reply in replies) / len(self.dev),
            "does_nothing": sum(reply.splitlines()[:1] in ([], ["STOP"]) for reply in replies) / len(self.dev),
            "cpu_seconds": round(time.process_time() - self.begun),
        }
        print(json.dumps(record), flush=True)
        if self.args.out is not None:
            with self.args.out.open("a") as file:
                file.write(json.dumps({"seed": self.args.seed, **record}) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description="Train a tiny language model from scratch.")
    parser.add_argument("--level", type=int, default=1)
    parser.add_argument("--min-actions", type=int, default=2)
    parser.add_argument("--max-actions", type=int, default=5)
    parser.add_argument("--rows", type=int, default=10_000, help="tasks with plans to learn from")
    parser.add_argument("--supervised-steps", type=int, default=400)
    parser.add_argument("--reward-steps", type=int, default=100)
    parser.add_argument("--prompts", type=int, default=32, help="per step of the second phase")
    parser.add_argument("--learning-rate", type=float, default=3e-4, help="of the second phase")
    parser.add_argument("--report-every", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="append the lines to this file")
    training = Training(parser.parse_args())
    training.supervise()
    training.reinforce()


if __name__ == "__main__":
    main()
