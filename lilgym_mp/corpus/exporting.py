"""Builds corpus file entries for `write_corpus` from loaded tasks or scenes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.scene import Scene


class LabelledScene(NamedTuple):
    """A start scene and the statement's truth value in it."""

    scene: Scene
    label: bool


def entry_json(
    entry_id: str,
    appearance: str,
    split: str,
    statement: str,
    program: str,
    starts: Iterable[tuple[str, LabelledScene]],
) -> dict[str, object]:
    """A corpus file entry; `starts` are pairs of id and labelled scene."""
    return {
        "id": entry_id,
        "appearance": appearance,
        "split": split,
        "statement": statement,
        "program": program,
        "starts": [{"id": name, "label": start.label, "scene": start.scene.to_json()} for name, start in starts],
    }


def flipit_entries(tasks: TaskSet) -> Iterator[dict[str, object]]:
    """One entry per statement and program of the FlipIt tasks, with their start scenes under the task ids."""
    appearance, split = tasks.provenance.appearance, tasks.provenance.split
    starts: dict[tuple[str, str], list[tuple[str, LabelledScene]]] = {}
    for task in tasks:
        start = LabelledScene(task.start, not task.target)
        starts.setdefault((task.statement, task.program), []).append((task.id, start))
    for index, ((statement, program), found) in enumerate(starts.items(), start=1):
        yield entry_json(f"{appearance}/{split}/{index}", appearance, split, statement, program, found)
