"""lilgym_mp as a dataset of reasoning-gym: `reasoning_gym.create_dataset("lilgym", kind="plan", level=2, seed=0)`."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from typing import Any

from reasoning_gym.coaching import BaseCurriculum, ScalarAttributeDefinition
from reasoning_gym.factory import ProceduralDataset, register_dataset

from lilgym_mp.contrib.rlvr import Row, expert_reply, rows, score

DIFFICULTY = {"level": [1, 2, 3, 4, 5], "min_actions": [2, 3, 4, 5]}  # fields that the curriculum raises


@dataclass
class LilgymConfig:
    """The arguments of `lilgym_mp.contrib.rlvr.rows`, and the dataset's size."""

    kind: str = "plan"
    appearance: str = "tower"
    level: int = 2
    split: str = "train"
    min_actions: int = 2
    max_actions: int | None = None
    seed: int | None = None
    size: int = 500

    def validate(self) -> None:
        """Raises ValueError naming the value and the choices."""
        self.rows(0)

    def rows(self, seed: int) -> Iterator[Row]:
        """Endless rows."""
        given = asdict(self) | {"seed": seed}
        del given["size"]
        return rows(**given)


class LilgymDataset(ProceduralDataset):
    """Endless through `ReseedingDataset`. An entry's answer is one of many right ones, which `score_answer` accepts."""

    def __init__(self, config: LilgymConfig) -> None:
        super().__init__(config, config.seed, config.size)
        self._rows = list(islice(config.rows(self.seed), config.size))

    def __getitem__(self, idx: int) -> dict[str, Any]:
        row = self._rows[idx]
        metadata = {
            "source_dataset": "lilgym",
            "source_index": idx,
            "actions": row.steps,  # of a shortest plan; None for other kinds
            "difficulty": {name: getattr(self.config, name) for name in DIFFICULTY},
            "row": row.to_json(),
        }
        return {"question": row.prompt, "answer": expert_reply(row), "metadata": metadata}

    def score_answer(self, answer: str | None, entry: dict[str, Any]) -> float:
        """1 or 0. The library gives no finish_reason; a caller that has it may put it into the entry's metadata."""
        metadata = entry["metadata"]
        return score(answer, Row.from_json(metadata["row"]), finish_reason=metadata.get("finish_reason")).reward


class LilgymCurriculum(BaseCurriculum):
    """Raises the difficulty of the language, and the length of plans."""

    def __init__(self) -> None:
        super().__init__(LilgymCurriculum.__name__, LilgymConfig)
        for name, levels in DIFFICULTY.items():
            self._define_attributes(
                ScalarAttributeDefinition(name=name, field_name=name, levels=levels, description=name)
            )


register_dataset("lilgym", LilgymDataset, LilgymConfig, LilgymCurriculum)
