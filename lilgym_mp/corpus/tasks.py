"""Task sets, and the conversion of records to validated tasks."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, cast, overload

from lilgym_mp.corpus.faults import FaultLog
from lilgym_mp.corpus.records import Record, shown
from lilgym_mp.programs import Program, ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Box, Item, Scene, SceneError
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.arrays import BOOLEANS

MAX_ID_SEARCHED = 200  # characters of an unknown id that are compared with existing ids


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a set of tasks comes from."""

    corpus: str  # as requested: "builtin", "lilgym" or a path
    name: str  # the corpus's own name
    path: str
    appearance: str
    start: str
    split: str
    sha256: str  # SHA-256 of the file's bytes

    def __str__(self) -> str:
        return f"corpus {self.corpus!r}, {self.appearance} {self.start}, split {self.split!r}"


class TaskSet(Sequence[Task]):
    """The tasks of one configuration and split, in file order; immutable and shared."""

    __slots__ = ("_indices", "_tags", "_tasks", "provenance")

    def __init__(
        self, tasks: Iterable[Task], provenance: Provenance, tags: Mapping[str, tuple[str, ...]] | None = None
    ) -> None:
        """`tags`: the corpus's annotations by task id."""
        self._tasks = tuple(tasks)
        self._tags = dict(tags or {})
        self._indices = {task.id: index for index, task in enumerate(self._tasks)}
        self.provenance = provenance

    @property
    def ids(self) -> tuple[str, ...]:
        """Every task's id, in file order."""
        return tuple(self._indices)

    def by_id(self, task_id: object) -> Task:
        """The task with that id, "1757" or 1757. Raises ValueError naming the id, the task set and similar ids."""
        return self._tasks[self.index_of(task_id)]

    def index_of(self, task_id: object) -> int:
        """The index of the task with that id, "1757" or 1757. Raises ValueError as `by_id` does."""
        name: Any = cast("Any", task_id).item() if getattr(task_id, "shape", None) == () else task_id
        if not isinstance(name, (str, *BOOLEANS)):
            with suppress(TypeError):
                name = str(operator.index(name))
        index = self._indices.get(name) if isinstance(name, str) else None
        if index is None:
            close = get_close_matches(str(task_id)[:MAX_ID_SEARCHED], self.ids, n=3, cutoff=0.5) or self.ids[:3]
            raise ValueError(f"no task {task_id!r} in {self.provenance}; existing ids include {', '.join(close)}")
        return index

    def find(self, task: Task) -> int | None:
        """The index of `task`, None if it is not one of these tasks, even if one has its id."""
        index = self._indices.get(task.id)
        return index if index is not None and self._tasks[index] == task else None

    def tags(self, task_id: object) -> tuple[str, ...]:
        """The corpus's annotations of the task's statement, such as "unseen form"."""
        return self._tags.get(self.by_id(task_id).id, ())

    @overload
    def __getitem__(self, index: int) -> Task: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Task, ...]: ...
    def __getitem__(self, index: int | slice) -> Task | tuple[Task, ...]:
        return self._tasks[index]

    def __len__(self) -> int:
        return len(self._tasks)

    def __iter__(self) -> Iterator[Task]:
        return iter(self._tasks)

    def __repr__(self) -> str:
        return f"TaskSet({len(self)} tasks of {self.provenance})"


def contexts(tasks: Iterable[Task]) -> int:
    """The number of contexts (MDPs) among the tasks: distinct pairs of statement and target (docs/spec.md, "Tasks")."""
    return len({(task.statement, task.target) for task in tasks})


class TaskReader:
    """Validates records of one appearance and converts them to tasks; equal texts, boxes and scenes are shared."""

    def __init__(self, appearance: str, faults: FaultLog, *, trusted: bool = False) -> None:
        """`trusted`: programs and labels are known to be valid and are not checked."""
        self._trusted = trusted
        self._check_scene = APPEARANCES[appearance].check_scene
        self._faults = faults
        self._empty = self._check_scene(Scene.empty())
        self._texts: dict[str, str] = {}
        self._programs: dict[str, Program | None] = {}
        self._boxes: dict[tuple[Item, ...], Box] = {}
        self._scenes: dict[tuple[tuple[Item, ...], ...], Scene] = {}

    def tasks(self, records: Iterable[Record]) -> Iterator[tuple[Task, tuple[str, ...]]]:
        """The tasks of the valid records, with their tags; faults go to the log."""
        return ((task, record.tags) for record in records if (task := self._task(record)) is not None)

    def _task(self, record: Record) -> Task | None:
        _, name, statement, source, label, *_ = cast("tuple[Any, ...]", record)
        program = None if self._trusted else self._program(record)
        start = self._scene(record) if record.is_flipit else self._empty
        if start is None:
            return None
        if not self._trusted:
            if program is None or (label is not None and self._truth(record, program, start) != label):
                return None
            source = program.source
        if None in (name, statement, source) or not record.is_valid or (record.is_flipit and label is None):
            return None
        return Task(name, self._texts.setdefault(statement, statement), source, not label, start)

    def _program(self, record: Record) -> Program | None:
        """The compiled program, evaluated once on the empty scene; logs a fault and returns None when it is invalid."""
        source = record.program
        if source is None:
            return None
        if source not in self._programs:
            self._programs[source] = None
            try:
                program = compile_program(source)
            except ProgramError as fault:
                self._faults.add(record.where, f"program {shown(source)}: {fault}")
                return None
            if self._value(record, program, self._empty) is not None:
                self._programs[source] = program
        return self._programs[source]

    def _truth(self, record: Record, program: Program, start: Scene) -> bool | None:
        """The truth value in `start`; logs a fault when it differs from the label."""
        value = self._value(record, program, start)
        if value is not None and value != record.label:
            label, found = str(record.label).lower(), str(value).lower()
            self._faults.add(record.where, f"label is {label} but the program is {found} in this scene")
        return value

    def _value(self, record: Record, program: Program, scene: Scene) -> bool | None:
        try:
            return program.evaluate(scene)
        except ProgramRuntimeError as fault:
            place = "its start scene" if any(scene.items()) else "the empty scene"
            self._programs[program.source] = None  # failing may be slow, so do not evaluate it on further scenes
            self._faults.add(record.where, f"program {shown(program.source)} has no value on {place}: {fault}")
            return None

    def _scene(self, record: Record) -> Scene | None:
        try:
            items = tuple(box.items for box in Scene.from_json(record.scene).boxes)
            scene = self._scenes.get(items)
            if scene is None:
                left, middle, right = (self._boxes.setdefault(box, Box(box)) for box in items)
                scene = self._check_scene(Scene((left, middle, right)))
                self._scenes[items] = scene
        except SceneError as fault:
            self._faults.add(record.where, f"scene: {fault}")
            return None
        return scene
