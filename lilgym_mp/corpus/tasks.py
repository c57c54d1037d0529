"""Task sets, and the conversion of records to validated tasks."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from sys import intern
from typing import Any, cast, overload

from lilgym_mp.corpus.faults import Fault, checked
from lilgym_mp.corpus.records import Record, check_prose, check_text, shown
from lilgym_mp.programs import Program, ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Box, Item, Scene, SceneError
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.arrays import BOOLEANS, Strings

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
    """The tasks of one configuration and split, in file order; immutable and shared.

    Args:
        tasks: The tasks; their ids must differ.
        provenance: Where they come from.
        without_program: What the corpus has for statements without a program: to be shown and annotated, not played.
    """

    __slots__ = ("_indices", "_tasks", "provenance", "without_program")

    def __init__(self, tasks: Iterable[Task], provenance: Provenance, without_program: Iterable[Task] = ()) -> None:
        self._tasks = tuple(tasks)
        self.without_program = tuple(without_program)
        self._indices = {task.id: index for index, task in enumerate(self._tasks)}
        self.provenance = provenance

    @property
    def ids(self) -> Strings:
        """Every task's id, in file order."""
        return tuple(self._indices)

    def by_id(self, task_id: object) -> Task:
        """The task with an id.

        Args:
            task_id: Such as "1757" or 1757.

        Raises:
            ValueError: Naming the id, the task set and similar ids.
        """
        return self._tasks[self.index_of(task_id)]

    def index_of(self, task_id: object) -> int:
        """The index of the task with an id.

        Args:
            task_id: Such as "1757" or 1757.

        Raises:
            ValueError: As `by_id`.
        """
        name: Any = cast("Any", task_id).item() if getattr(task_id, "shape", None) == () else task_id
        if not isinstance(name, (str, *BOOLEANS)):
            with suppress(TypeError):
                name = str(operator.index(name))
        index = self._indices.get(name) if isinstance(name, str) else None
        if index is None and any(task.id == name for task in self.without_program):
            raise ValueError(f"task {name!r} has no program: it can be shown and annotated, but not played")
        if index is None:
            close = get_close_matches(str(task_id)[:MAX_ID_SEARCHED], self.ids, n=3, cutoff=0.5) or self.ids[:3]
            raise ValueError(f"no task {task_id!r} in {self.provenance}; existing ids include {', '.join(close)}")
        return index

    def find(self, task: Task) -> int | None:
        """The index of a task, None if it is not one of these tasks, even if one has its id.

        Args:
            task: The task.
        """
        index = self._indices.get(task.id)
        return index if index is not None and self._tasks[index] == task else None

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

    def __init__(self, appearance: str, faults: list[Fault]) -> None:
        self._check_scene = make_appearance(appearance).check_scene
        self._faults = faults
        self._empty = self._check_scene(Scene.empty())
        self._programs: dict[str, Program | None] = {}
        self._boxes: dict[tuple[Item, ...], Box] = {}
        self._scenes: dict[tuple[tuple[Item, ...], ...], Scene] = {}

    def tasks(self, records: Iterable[Record], *, trusted: bool = False) -> Iterator[Task]:
        """The tasks of the valid records; the program of those without one is "".

        `trusted`: their programs are known to be valid and are not compiled.
        """
        found = (self._task(record, trusted=trusted) for record in records)
        return (task for task in found if task is not None)

    def _task(self, record: Record, *, trusted: bool) -> Task | None:
        faults = self._faults
        where = record.where
        name = checked(faults, where, check_text, "id", record.id)
        statement = checked(faults, record.entry, check_prose, "statement", record.statement)
        source = "" if not record.has_program else checked(faults, record.entry, check_prose, "program", record.program)
        program = None if not source or trusted else self._program(source, record.entry)
        is_known = program is not None or trusted or not record.has_program
        start = self._empty
        label = False
        if record.is_flipit:
            label = checked(faults, where, _check_label, record.label)
            start = checked(faults, where, self._scene, record.scene)
            if program is not None and start is not None:
                label = checked(faults, where, self._agreed, program, start, label)
        is_valid = record.is_valid and is_known
        if is_valid and name and statement and source is not None and start is not None and label is not None:
            return Task(name, intern(statement), intern(source), not label, start, tags=record.tags)
        return None

    def _program(self, source: str, where: str) -> Program | None:
        """The compiled program, evaluated once on the empty scene; None, and a fault, when it is invalid."""
        if source not in self._programs:
            self._programs[source] = checked(self._faults, where, self._compiled, source)
        return self._programs[source]

    def _compiled(self, source: str) -> Program:
        try:
            program = compile_program(source)
        except ProgramError as fault:
            raise ValueError(f"program {shown(source)}: {fault}") from None
        self._value(program, self._empty)
        return program

    def _value(self, program: Program, scene: Scene) -> bool:
        try:
            return program.evaluate(scene)
        except ProgramRuntimeError as fault:
            place = "its start scene" if any(scene.items()) else "the empty scene"
            self._programs[program.source] = None  # failing may be slow, so do not evaluate it on further scenes
            raise ValueError(f"program {shown(program.source)} has no value on {place}: {fault}") from None

    def _agreed(self, program: Program, scene: Scene, label: bool | None) -> bool | None:
        """The label, if it is the program's value in the scene or unknown."""
        value = self._value(program, scene)
        if label not in (None, value):
            raise ValueError(f"label is {str(label).lower()} but the program is {str(value).lower()} in this scene")
        return label

    def _scene(self, data: object) -> Scene:
        try:
            items = tuple(box.items for box in Scene.from_json(data).boxes)
            if items not in self._scenes:
                boxes = (self._boxes.setdefault(box, Box(box)) for box in items)
                self._scenes[items] = self._check_scene(Scene.of_boxes(boxes))
            return self._scenes[items]
        except SceneError as fault:
            raise ValueError(f"scene: {fault}") from None


def _check_label(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"label must be true or false, not {shown(value)}")
    return value
