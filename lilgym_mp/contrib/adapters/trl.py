"""GRPO with TRL: prompts as a streaming dataset, rewards for whole replies, and an environment for several turns.

python -m lilgym_mp.contrib.adapters.trl --model DIRECTORY_OR_NAME --level 2 --steps 200 [--turns] [--scene image]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence, Set
from functools import partial
from typing import Any

import torch
from datasets import IterableDataset
from transformers import AutoTokenizer
from trl import GRPOConfig, GRPOTrainer
from trl.chat_template_utils import qwen3_chat_template

from lilgym_mp.contrib.rlvr import Conversation, Row, images_of, messages_of, rows, score
from lilgym_mp.wrappers.text import content_of


def stream(
    kind: str = "plan",
    appearance: str = "tower",
    level: int = 2,
    *,
    turns: bool = False,
    scene: str = "list",
    **settings: Any,
) -> IterableDataset:
    """Endless rows as TRL wants them; `settings` as for `lilgym_mp.contrib.rlvr.rows`.

    `turns`: prompts for `PlanEnvironment`. `scene`: "image" or "both" for a model that sees, with a column "images".
    """
    arguments = {"arguments": (kind, appearance, level), "turns": turns, "scene": scene, **settings}
    return IterableDataset.from_generator(_examples, gen_kwargs=arguments)


def _examples(arguments: tuple[str, str, int], *, turns: bool, scene: str, **settings: Any) -> Iterator[dict[str, Any]]:
    for row in rows(*arguments, **settings):
        images = images_of(row) if scene in ("image", "both") else []
        prompt = messages_of(row, scene, inline=False)
        if turns:
            text = f"{Conversation(row, scene=scene).prompt}\nAct step by step, with the tool."
            prompt = [{"role": "user", "content": content_of(text, images, inline=False)}]
        yield {"prompt": prompt, "row": json.dumps(row.to_json()), **({"images": images} if images else {})}


def row_of(text: str) -> Row:
    """The row of an example's column "row"."""
    return Row.from_json(json.loads(text))


def verified_reward(
    completions: Sequence[Any],
    row: Sequence[str],
    *,
    completion_ids: Sequence[Sequence[int]] | None = None,
    ends: Set[int] = frozenset(),
    **columns: Any,
) -> list[float]:
    """1 for each right completion, else 0, also for an empty one.

    `ends`: tokens that end a reply; a completion without one was cut, and is not read. By default that is not known.
    """
    rewards: list[float] = []
    for said, data, tokens in zip(completions, row, completion_ids or [None] * len(completions), strict=True):
        cut = ends and tokens is not None and ends.isdisjoint(tokens[-1:])
        rewards.append(score(said, row_of(data), finish_reason="length" if cut else None).reward)
    return rewards


def with_tools(tokenizer: Any) -> Any:
    """The tokenizer, whose chat template has tools: Qwen 3's, of TRL, if it has none and writes <|im_start|>.

    Raises SystemExit for another model, with which TRL cannot train in turns.
    """
    if "tools" in (tokenizer.chat_template or ""):
        return tokenizer
    if "<|im_start|>" not in tokenizer.get_vocab():
        raise SystemExit("--turns needs a chat template with tools, or a tokenizer with <|im_start|>, as Qwen's have")
    tokenizer.chat_template = qwen3_chat_template
    return tokenizer


class PlanEnvironment:
    """For `environment_factory`: one action for each call of the tool `act`.

    Always train with `stream(turns=True)`, whose prompts show the start: TRL resets each member of a group on its own,
    so without rows the members would get different tasks, and their rewards could not be compared. `scene`: that of the
    prompts.
    """

    def __init__(self, scene: str = "list") -> None:
        self._scene = scene

    def reset(self, row: str, **columns: Any) -> None:
        self._talk = Conversation(row_of(row), scene=self._scene)
        self._reward = 0.0
        self.regrets: list[float | None] = []  # of each turn, for trainers that reward turns

    def act(self, action: str) -> Any:
        """
        Take one action.

        Args:
            action: The action's name or number, such as ADD(LEFT, BLUE), REMOVE(LEFT) or STOP.

        Returns:
            The scene after it, or how the episode ended.
        """
        if self._talk.done:
            return "The episode is over."
        turn = self._talk.step(action)
        self._reward += turn.reward
        self.regrets.append(turn.regret)
        shown = [{"type": "image", "image": image} for image in self._talk.images]
        return [*shown, {"type": "text", "text": turn.text}] if shown else turn.text

    def get_reward(self) -> float:
        return self._reward


def main() -> None:
    """Trains a model as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", required=True)
    parser.add_argument("--level", type=int, default=2)
    parser.add_argument("--max-actions", type=int, help="of the shortest plan, STOP included")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--turns", action="store_true")
    parser.add_argument("--scene", choices=["list", "image", "both"], default="list")
    parser.add_argument("--max-completion-length", type=int, default=256, help="in tokens")
    parser.add_argument("--out", default="runs/grpo")
    parser.add_argument("--option", nargs="+", default=[], metavar="KEY=VALUE", help="others of GRPOConfig, in JSON")
    args = parser.parse_args()
    settings = {"output_dir": args.out, "max_steps": args.steps, "logging_steps": 1}
    settings |= {"max_completion_length": args.max_completion_length, "use_cpu": not torch.accelerator.is_available()}
    settings |= {key: json.loads(value) for key, _, value in (option.partition("=") for option in args.option)}
    tokenizer = AutoTokenizer.from_pretrained(args.model)
    played: dict[str, Any] = {"reward_funcs": partial(verified_reward, ends={tokenizer.eos_token_id})}
    if args.turns:
        played = {"environment_factory": partial(PlanEnvironment, args.scene)}
        if args.scene == "list":
            played["processing_class"] = with_tools(tokenizer)
    GRPOTrainer(
        model=args.model,
        args=GRPOConfig(**settings),
        train_dataset=stream(level=args.level, max_actions=args.max_actions, turns=args.turns, scene=args.scene),
        **played,
    ).train()


if __name__ == "__main__":
    from lilgym_mp.contrib.adapters import trl as adapter  # as a module, whose functions are pickled by name

    adapter.main()
