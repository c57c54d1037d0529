"""GRPO with TRL: prompts as a streaming dataset, rewards for whole replies, and an environment for several turns.

pip install . "trl==1.16.*" jmespath
python integrations/trl/lilgym_trl.py --model DIRECTORY_OR_NAME --level 2 --steps 200 [--turns]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from typing import Any

from datasets import IterableDataset
from trl import GRPOConfig, GRPOTrainer

from lilgym_mp.rlvr import Conversation, Row, RowError, rows, score


def stream(kind: str = "plan", appearance: str = "tower", level: int = 2, **settings: Any) -> IterableDataset:
    """Endless rows as TRL wants them; `settings` as for `lilgym_mp.rlvr.rows`."""
    return IterableDataset.from_generator(_examples, gen_kwargs={"arguments": (kind, appearance, level), **settings})


def _examples(arguments: tuple[str, str, int], **settings: Any) -> Iterator[dict[str, Any]]:
    for row in rows(*arguments, **settings):
        yield {"prompt": [{"role": "user", "content": row.prompt}], "row": json.dumps(row.to_json())}


def verified_reward(completions: Sequence[Any], row: Sequence[str], **columns: Any) -> list[float | None]:
    """1 for each right completion, else 0. None, which TRL leaves out, for a row that cannot be scored."""
    return [_reward(completion, data) for completion, data in zip(completions, row, strict=True)]


def _reward(completion: Any, data: str) -> float | None:
    reply = completion if isinstance(completion, str) else completion[-1].get("content")
    try:
        return score(reply, Row.from_json(json.loads(data))).reward
    except (RowError, ValueError):
        return None


class PlanEnvironment:
    """For `environment_factory`: one action for each call of the tool `act`.

    Always train with a dataset of rows as well: TRL resets each member of a group on its own, so without rows the
    members would get different tasks, and their rewards could not be compared.
    """

    def reset(self, row: str, **columns: Any) -> str:
        """The start, which is appended to the prompt."""
        self._talk, self._reward = Conversation(Row.from_json(json.loads(row))), 0.0
        return f"\nNow act step by step, with the tool.\n{self._talk.prompt}"

    def act(self, action: str) -> str:
        """
        Take one action.

        Args:
            action: The action's name, such as ADD(LEFT, BLUE), REMOVE(LEFT) or STOP.

        Returns:
            The scene after it, or how the episode ended.
        """
        if self._talk.done:
            return "The episode is over."
        turn = self._talk.step(action)
        self._reward += turn.reward
        return turn.text

    def get_reward(self) -> float:
        return self._reward


def trainer(
    model: Any, *, turns: bool = False, tokenizer: Any = None, dataset: Any = None, **settings: Any
) -> GRPOTrainer:
    """A trainer of plans. `settings`: of GRPOConfig."""
    rewards = {"environment_factory": PlanEnvironment} if turns else {"reward_funcs": verified_reward}
    return GRPOTrainer(
        model=model,
        args=GRPOConfig(**settings),
        train_dataset=stream() if dataset is None else dataset,
        processing_class=tokenizer,
        **rewards,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", required=True)
    parser.add_argument("--level", type=int, default=2)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--turns", action="store_true")
    args = parser.parse_args()
    settings = {"output_dir": "runs/grpo", "max_steps": args.steps, "num_generations": 8, "logging_steps": 1}
    trainer(args.model, turns=args.turns, dataset=stream(level=args.level), **settings).train()


if __name__ == "__main__":
    main()
