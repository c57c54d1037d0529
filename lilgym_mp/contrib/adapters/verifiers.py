"""Tasks with one reply each, for verifiers; docs/language_models.md has a command."""

from collections.abc import Iterator
from itertools import islice
from typing import Any

import verifiers.v1 as vf

from lilgym_mp.contrib.rlvr import Row, rows, score


class LilgymConfig(vf.TasksetConfig):
    """The arguments of `lilgym_mp.contrib.rlvr.rows`, and the number of tasks."""

    kind: str = "plan"
    appearance: str = "tower"
    level: int = 2
    seed: int = 0
    split: str = "train"
    min_actions: int = 2
    max_actions: int | None = None
    size: int = 500  # tasks


class LilgymData(vf.TaskData):
    """A row as JSON values."""

    row: dict[str, Any]


class LilgymTask(vf.Task[LilgymData, vf.State, vf.TaskConfig]):
    """A row with its reward."""

    @vf.reward
    async def verified(self, trace: vf.Trace) -> float:
        return score(trace.last_reply, Row.from_json(self.data.row)).reward


class LilgymTaskset(vf.Taskset[LilgymTask, LilgymConfig]):
    """Tasks made by the generator."""

    def load(self) -> Iterator[LilgymTask]:
        names = ("kind", "appearance", "level", "seed", "split", "min_actions", "max_actions")
        endless = rows(**{name: getattr(self.config, name) for name in names})
        for row in islice(endless, self.config.size):
            yield LilgymTask(LilgymData(id=row.id, prompt=row.prompt, row=row.to_json()), self.config.task)


__all__ = ["LilgymTaskset"]
