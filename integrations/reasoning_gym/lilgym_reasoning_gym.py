"""lilgym_mp as a dataset of reasoning-gym: `reasoning_gym.create_dataset("lilgym", kind="plan", level=2, seed=0)`."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Any

from reasoning_gym.factory import ProceduralDataset, register_dataset

from lilgym_mp.rlvr import KINDS, Row, expert_reply, rows, score


@dataclass
class LilgymConfig:
    kind: str = "plan"
    appearance: str = "tower"
    level: int = 2
    seed: int | None = None
    size: int = 500

    def validate(self) -> None:
        assert self.kind in KINDS, f"unknown kind {self.kind!r}; choose from {', '.join(KINDS)}"


class LilgymDataset(ProceduralDataset):
    """Endless through `ReseedingDataset`. An entry's answer is one of many right ones, which `score_answer` accepts."""

    def __init__(self, config: LilgymConfig) -> None:
        super().__init__(config, config.seed, config.size)
        self._rows = _rows(config.kind, config.appearance, config.level, self.seed, config.size)

    def __getitem__(self, idx: int) -> dict[str, Any]:
        row = self._rows[idx]
        metadata = {"source_dataset": "lilgym", "source_index": idx, "row": row.to_json()}
        return {"question": row.prompt, "answer": expert_reply(row), "metadata": metadata}

    def score_answer(self, answer: str | None, entry: dict[str, Any]) -> float:
        return score(answer, Row.from_json(entry["metadata"]["row"])).reward


@lru_cache(maxsize=8)
def _rows(kind: str, appearance: str, level: int, seed: int, size: int) -> list[Row]:
    return list(islice(rows(kind, appearance, level, seed=seed), size))


register_dataset("lilgym", LilgymDataset, LilgymConfig)
