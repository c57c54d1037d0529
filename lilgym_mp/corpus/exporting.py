"""Entries of a corpus file from what is already loaded or found: the form that `write_corpus` takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.scene import Scene


class LabelledScene(NamedTuple):
    """A start scene, and the statement's truth value in it."""

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
    """An entry with its starts, each with its id."""
    return {
        "id": entry_id,
        "appearance": appearance,
        "split": split,
        "statement": statement,
        "program": program,
        "starts": [{"id": name, "label": start.label, "scene": start.scene.to_json()} for name, start in starts],
    }


def flipit_entries(tasks: TaskSet) -> Iterator[dict[str, object]]:
    """One entry a statement and program of FlipIt tasks, with all their start scenes under their own ids."""
    appearance, split = tasks.provenance.appearance, tasks.provenance.split
    starts: dict[tuple[str, str], list[tuple[str, LabelledScene]]] = {}
    for task in tasks:
        start = LabelledScene(task.start, not task.target)
        starts.setdefault((task.statement, task.program), []).append((task.id, start))
    for number, ((statement, program), found) in enumerate(starts.items(), start=1):
        yield entry_json(f"{appearance}/{split}/{number}", appearance, split, statement, program, found)
