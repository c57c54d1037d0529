"""The statements of the corpus with their scenes, programs and parts, searched and filtered."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

from pydantic import BaseModel

from lilgym_mp.analysis.phenomena import Phenomenon, phenomena, syntactic_phenomena
from lilgym_mp.corpus import NoTasksError, statement_form, words
from lilgym_mp.corpus.records import FLIPIT, SCRATCH
from lilgym_mp.evaluation.episodes import Header, Recording
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import Call, Node, WordName, children, parse
from lilgym_mp.programs.tracing import trace
from lilgym_mp.task import Task
from lilgym_mp.web.catalogue import Catalogue
from lilgym_mp.web.errors import refusal
from lilgym_mp.web.played_episodes import ProgramPart
from lilgym_mp.web.run_directory import Recordings, Unreadable
from lilgym_mp.web.scene_body import SceneBody, scene_body

PAGE = 30  # statements in one answer
KEPT_LISTS = 12
MOST_RECORDINGS = 200  # that are looked through
MOST_SCENES = 12  # of a statement that are shown
NAMES = {parts: name for name, parts in CONFIGURATIONS.items()}
"""Configurations by appearance and start."""


class StatementLine(BaseModel):
    """A statement in the list. `id` is that of its first task."""

    id: str
    statement: str
    length: int
    phenomena: list[str]
    scenes: int


class StatementsBody(BaseModel):
    """A page of the statements that pass the filters."""

    total: int
    first: int
    page: int
    statements: list[StatementLine]


class ChoicesBody(BaseModel):
    """What statements of an appearance and split can be filtered by; the numbers are of statements."""

    phenomena: dict[str, int]
    words: dict[str, int]
    longest: int


class ExploredScene(BaseModel):
    """A start, and how it is solved. `optimal_first`: actions that begin a shortest solution, all of them where
    `complete`; `play` is the configuration and task to play it."""

    configuration: str
    task_id: str
    target: bool
    truth: bool
    scene: SceneBody
    steps: int
    optimal_first: int
    complete: bool
    parts: list[ProgramPart]


class RunOutcome(BaseModel):
    """What a recorded run did with one task of the statement."""

    recording: str
    agent: str
    configuration: str
    task_id: str
    outcome: str
    actions: int
    reward: float


class StatementBody(BaseModel):
    """A statement with everything that is known of it."""

    id: str
    statement: str
    form: str
    program: str
    canonical: str
    words: list[str]
    phenomena: list[str]
    syntax: list[str]
    scenes: list[ExploredScene]
    runs: list[RunOutcome]
    unreadable: list[str]


class Explored:
    """A statement with its tasks."""

    def __init__(self, task: Task) -> None:
        self.id = task.id
        self.statement = task.statement
        self.program = task.program
        self.tasks: list[tuple[str, Task]] = []  # start, task
        self.length = len(words(task.statement))
        self.phenomena = sorted(map(str, phenomena(task.program)))
        self.words = frozenset(_words(parse(task.program)))


def _words(node: Node) -> Iterator[str]:
    if isinstance(node, Call | WordName):
        yield node.word.name
    for child in children(node):
        yield from _words(child)


@lru_cache(KEPT_LISTS)
def statements(catalogue: Catalogue, appearance: str, split: str) -> tuple[Explored, ...]:
    """The statements of an appearance and split, in file order. Answers 404 where the corpus has none."""
    found: dict[tuple[str, str], Explored] = {}
    for start in (SCRATCH, FLIPIT):
        try:
            tasks = catalogue.tasks(NAMES[appearance, start], split)
        except NoTasksError:
            continue
        for task in tasks:
            explored = found.setdefault((task.statement, task.program), Explored(task))
            explored.tasks.append((start, task))
    if not found:
        raise refusal(404, f"the corpus has no {appearance} statements in {split}")
    return tuple(found.values())


def choices(catalogue: Catalogue, appearance: str, split: str) -> ChoicesBody:
    found = statements(catalogue, appearance, split)
    used = sorted({word for each in found for word in each.words})
    return ChoicesBody(
        phenomena={str(kind): sum(str(kind) in each.phenomena for each in found) for kind in Phenomenon},
        words={word: sum(word in each.words for each in found) for word in used},
        longest=max(each.length for each in found),
    )


def search(
    catalogue: Catalogue,
    appearance: str,
    split: str,
    *,
    text: str = "",
    phenomenon: str | None = None,
    word: str | None = None,
    least: int = 0,
    most: int = 1_000,
    first: int = 0,
) -> StatementsBody:
    """The statements that hold the text and pass the filters, from place `first` on."""
    wanted = text.lower()
    found = [
        each
        for each in statements(catalogue, appearance, split)
        if wanted in each.statement.lower() or wanted in each.program.lower() or wanted == each.id.lower()
        if phenomenon is None or phenomenon in each.phenomena
        if word is None or word in each.words
        if least <= each.length <= most
    ]
    lines = [
        StatementLine(
            id=each.id,
            statement=each.statement,
            length=each.length,
            phenomena=each.phenomena,
            scenes=sum(start == FLIPIT for start, _ in each.tasks),
        )
        for each in found[first : first + PAGE]
    ]
    return StatementsBody(total=len(found), first=first, page=PAGE, statements=lines)


def find(catalogue: Catalogue, appearance: str, split: str, statement_id: str) -> Explored:
    """The statement that a task of that id has. Answers 404 where there is none."""
    for each in statements(catalogue, appearance, split):
        if each.id == statement_id or any(task.id == statement_id for _, task in each.tasks):
            return each
    raise refusal(404, f"there is no statement {statement_id!r} of {appearance} in {split}")


class Outcomes:
    """What recorded runs did with statements; a file is read once, until it changes."""

    def __init__(self, recordings: Recordings) -> None:
        self._recordings = recordings
        self._indexed: dict[str, tuple[Header, dict[str, list[RunOutcome]]]] = {}

    def of(self, explored: Explored) -> tuple[list[RunOutcome], list[str]]:
        """The outcomes for the statement's tasks, and the recordings that cannot be read."""
        outcomes: list[RunOutcome] = []
        unreadable: list[str] = []
        for found in self._recordings.list()[:MOST_RECORDINGS]:
            if found.header is None:
                unreadable.append(f"{found.name}: {found.fault}")
                continue
            kept = self._indexed.get(found.id)
            if kept is None or kept[0] is not found.header:
                try:
                    recording = self._recordings.read(found.id)
                except Unreadable as fault:
                    unreadable.append(str(fault))
                    continue
                if recording is None:
                    continue
                kept = self._indexed[found.id] = found.header, _by_statement(found.name, recording)
            outcomes.extend(kept[1].get(explored.statement, ()))
        return outcomes, unreadable


def _by_statement(name: str, recording: Recording) -> dict[str, list[RunOutcome]]:
    index: dict[str, list[RunOutcome]] = {}
    for episode in recording.episodes:
        outcome = RunOutcome(
            recording=name,
            agent=recording.header.agent,
            configuration=recording.header.settings.configuration,
            task_id=episode.task,
            outcome=episode.outcome,
            actions=len(episode.actions),
            reward=round(episode.reward, 6),
        )
        index.setdefault(episode.statement, []).append(outcome)
    return index


def statement_body(catalogue: Catalogue, explored: Explored, appearance: str, recordings: Outcomes) -> StatementBody:
    outcomes, unreadable = recordings.of(explored)
    return StatementBody(
        id=explored.id,
        statement=explored.statement,
        form=statement_form(explored.statement),
        program=explored.program,
        canonical=source_of(canonical_form(parse(explored.program))),
        words=sorted(explored.words),
        phenomena=explored.phenomena,
        syntax=sorted(map(str, syntactic_phenomena(explored.statement))),
        scenes=[_scene(catalogue, NAMES[appearance, start], task) for start, task in explored.tasks[:MOST_SCENES]],
        runs=outcomes,
        unreadable=unreadable,
    )


def _scene(catalogue: Catalogue, configuration: str, task: Task) -> ExploredScene:
    solver = catalogue.solver(configuration)
    best = solver.optimal_actions(solver.dynamics.start(task))
    return ExploredScene(
        configuration=configuration,
        task_id=task.id,
        target=task.target,
        truth=task.truth(task.start),
        scene=scene_body(task.start),
        steps=best.steps,
        optimal_first=len(best.actions),
        complete=best.complete,
        parts=[ProgramPart(**part._asdict()) for part in trace(task.program, task.start)],
    )
