"""Writes corpora in the project's file format, which docs/corpus.md describes."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from lilgym_mp.corpus.formats import FORMAT, VERSION
from lilgym_mp.corpus.locations import PathLike
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.scene import Scene
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.grouping import grouped


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
    tags: Sequence[str] = (),
) -> AnyDict:
    """A corpus file entry; `starts` are pairs of id and labelled scene."""
    return {
        "id": entry_id,
        "appearance": appearance,
        "split": split,
        "statement": statement,
        "program": program,
        **({"tags": list(tags)} if tags else {}),
        "starts": [{"id": name, "label": start.label, "scene": start.scene.to_json()} for name, start in starts],
    }


def flipit_entries(tasks: TaskSet) -> Iterator[dict[str, object]]:
    """One entry per statement and program of the FlipIt tasks, with their start scenes under the task ids."""
    appearance = tasks.provenance.appearance
    split = tasks.provenance.split
    starts = grouped(
        ((task.statement, task.program, task.tags), (task.id, LabelledScene(task.start, not task.target)))
        for task in tasks
    )
    for index, ((statement, program, tags), found) in enumerate(starts.items(), start=1):
        yield entry_json(f"{appearance}/{split}/{index}", appearance, split, statement, program, found, tags)


def write_corpus(
    path: PathLike,
    name: str,
    licence: str,
    entries: Iterable[Mapping[str, object]],
) -> None:
    """Writes a corpus file; equal entries give equal bytes.

    Args:
        path: The file, gzipped if its name ends in .gz.
        name: The corpus's name.
        licence: Its licence.
        entries: One statement with its scenes each, in the form of corpus files.
    """
    write_lines(Path(path), (header_json(name, licence), *entries))


def header_json(name: str, licence: str) -> dict[str, object]:
    """The first line of a corpus file."""
    return {"format": FORMAT, "version": VERSION, "name": name, "licence": licence}


def write_lines(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Writes JSON lines, gzipped if the path ends in .gz; equal rows give equal bytes."""
    lines = (json.dumps(row, ensure_ascii=False, separators=(",", ":")) for row in rows)
    data = "".join(line + "\n" for line in lines).encode("utf-8")
    path.write_bytes(gzip.compress(data, compresslevel=9, mtime=0) if path.suffix == ".gz" else data)


def task_rows(sets: Iterable[TaskSet]) -> Iterator[dict[str, object]]:
    """A row for each task of the sets, Scratch and FlipIt alike, with the same keys; a missing program is null."""
    for tasks in sets:
        origin = tasks.provenance
        for task in (*tasks, *tasks.without_program):
            yield {
                "id": task.id,
                "appearance": origin.appearance,
                "start": origin.start,
                "split": origin.split,
                "statement": task.statement,
                "program": task.program or None,
                "target": task.target,
                "tags": list(task.tags),
                "scene": task.start.to_json(),
            }
