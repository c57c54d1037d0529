"""More training tasks out of those there are: the same with their colours exchanged.

Exchanging two colours in a statement, its program and its start scene alike gives a task just as good: no rule of
the MDP and no word of the language tells one colour from another.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import permutations
from pathlib import Path
from typing import Any

from lilgym_mp.corpus import TaskSet, write_corpus
from lilgym_mp.evaluation.files import write_whole
from lilgym_mp.scene import Colour, Scene
from lilgym_mp.task import Task

_NAMES = {colour.name.lower(): colour for colour in Colour}
_COLOUR_WORD = re.compile(rf"(?<![a-z])({'|'.join(_NAMES)})(?![a-z])", re.IGNORECASE)

Exchange = Mapping[Colour, Colour]


def write_recoloured(path: Path, tasks: TaskSet) -> None:
    """Writes a corpus file with the tasks and every other task that exchanging colours makes of them."""
    origin = tasks.provenance
    entries = list(_entries(tasks))
    write_whole(
        path, lambda unfinished: write_corpus(unfinished, f"{origin.name}, recoloured", "as the original", entries)
    )


def _entries(tasks: TaskSet) -> Iterator[dict[str, Any]]:
    origin = tasks.provenance
    met = set[tuple[str, str, bool, Scene]]()
    for number, colours in enumerate(permutations(Colour)):  # the first changes nothing
        exchange = dict(zip(Colour, colours, strict=True))
        for task in tasks:
            new = recoloured(task, exchange)
            if new is None or (key := (new.statement, new.program, new.target, new.start)) in met:
                continue
            met.add(key)
            entry_id = f"{task.id}-colours-{number}"
            start = {"id": f"{entry_id}-start", "label": not new.target, "scene": new.start.to_json()}
            yield {
                "id": entry_id,
                "appearance": origin.appearance,
                "split": origin.split,
                "statement": new.statement,
                "program": new.program,
                "starts": [] if origin.start == "scratch" else [start],
            }


def recoloured(task: Task, exchange: Exchange) -> Task | None:
    """The task with its colours exchanged; None when statement and program do not name the same colours.

    That is so where a colour is misspelt or goes without saying; then a statement might no longer tell what its
    program demands. A task as it is, is always one.
    """
    unchanged = all(old == new for old, new in exchange.items())
    if not unchanged and _named(task.statement) != _named(task.program):
        return None
    boxes = ([item._replace(colour=exchange[item.colour]) for item in box.items] for box in task.start.boxes)
    return Task(
        task.id,
        _exchanged(task.statement, exchange),
        _exchanged(task.program, exchange),
        task.target,
        Scene.of(*boxes),
    )


def _named(text: str) -> set[str]:
    return {word.lower() for word in _COLOUR_WORD.findall(text)}


def _exchanged(text: str, exchange: Exchange) -> str:
    def replaced(match: re.Match[str]) -> str:
        word = match[0]
        name = exchange[_NAMES[word.lower()]].name
        return name if word.isupper() else name.capitalize() if word[0].isupper() else name.lower()

    return _COLOUR_WORD.sub(replaced, text)
