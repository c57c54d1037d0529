"""Corpus statements for /explore: search, filters, and everything known about a statement."""

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
from lilgym_mp.solver.solution import ActionSet
from lilgym_mp.solver.solver import UnsupportedAppearance
from lilgym_mp.task import Task
from lilgym_mp.web.catalogue import Catalogue
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.played_episodes import ProgramPart
from lilgym_mp.web.run_directory import RunDirectory, UnreadableRecording
from lilgym_mp.web.scene_body import SceneBody, scene_body

PAGE_SIZE = 30  # statements per response
STATEMENT_CACHE_SIZE = 12  # (appearance, split) pairs
MAX_RECORDINGS = 200  # searched for outcomes
MAX_SCENES = 12  # per statement
CONFIGURATION_NAMES = {parts: name for name, parts in CONFIGURATIONS.items()}
"""Configurations by (appearance, start)."""


class StatementSummary(BaseModel):
    """An entry of the statement list. `id` is that of the statement's first task."""

    id: str
    statement: str
    length: int
    phenomena: list[str]
    scenes: int


class StatementsBody(BaseModel):
    """A page of the matching statements."""

    total: int
    first: int
    page: int
    statements: list[StatementSummary]


class ChoicesBody(BaseModel):
    """Filter values for an appearance and split, each with its number of statements; the length of the longest one."""

    phenomena: dict[str, int]
    words: dict[str, int]
    longest: int


class ExploredScene(BaseModel):
    """A start scene, and how it is solved. `optimal_first`: the number of actions known to begin a shortest solution;
    a lower bound unless `complete`."""

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
    """The outcome of a recorded episode on a task of the statement."""

    recording: str
    recording_id: str
    episode: int  # its index in the recording
    agent: str
    configuration: str
    task_id: str
    outcome: str
    actions: int
    reward: float


class StatementBody(BaseModel):
    """Everything known about a statement."""

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


class CorpusStatement:
    """A statement and program of the corpus, with its tasks."""

    def __init__(self, task: Task) -> None:
        self.id = task.id
        self.statement = task.statement
        self.program = task.program
        self.tasks: list[tuple[str, Task]] = []  # (start, task)
        self.length = len(words(task.statement))
        self.phenomena = sorted(map(str, phenomena(task.program)))
        self.words = frozenset(_program_words(parse(task.program)))


def _program_words(node: Node) -> Iterator[str]:
    if isinstance(node, Call | WordName):
        yield node.word.name
    for child in children(node):
        yield from _program_words(child)


@lru_cache(STATEMENT_CACHE_SIZE)
def list_statements(catalogue: Catalogue, appearance: str, split: str) -> tuple[CorpusStatement, ...]:
    """The statements of an appearance and split, in file order. Responds with 404 if there are none."""
    found: dict[tuple[str, str], CorpusStatement] = {}
    for start in (SCRATCH, FLIPIT):
        try:
            tasks = catalogue.tasks(CONFIGURATION_NAMES[appearance, start], split)
        except NoTasksError:
            continue
        for task in tasks:
            statement = found.setdefault((task.statement, task.program), CorpusStatement(task))
            statement.tasks.append((start, task))
    if not found:
        raise http_error(404, f"the corpus has no {appearance} statements in {split}")
    return tuple(found.values())


def filter_choices(catalogue: Catalogue, appearance: str, split: str) -> ChoicesBody:
    found = list_statements(catalogue, appearance, split)
    used = sorted({word for statement in found for word in statement.words})
    return ChoicesBody(
        phenomena={str(kind): sum(str(kind) in statement.phenomena for statement in found) for kind in Phenomenon},
        words={word: sum(word in statement.words for statement in found) for word in used},
        longest=max(statement.length for statement in found),
    )


def search_statements(
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
    """The statements that contain the text and match the filters: a page starting at index `first`.

    `least` and `most` bound the statement's length in words.
    """
    needle = text.lower()
    found = [
        statement
        for statement in list_statements(catalogue, appearance, split)
        if any(needle in field.lower() for field in (statement.statement, statement.program))
        or needle == statement.id.lower()
        if phenomenon is None or phenomenon in statement.phenomena
        if word is None or word in statement.words
        if least <= statement.length <= most
    ]
    lines = [
        StatementSummary(
            id=statement.id,
            statement=statement.statement,
            length=statement.length,
            phenomena=statement.phenomena,
            scenes=sum(start == FLIPIT for start, _ in statement.tasks),
        )
        for statement in found[first : first + PAGE_SIZE]
    ]
    return StatementsBody(total=len(found), first=first, page=PAGE_SIZE, statements=lines)


def find_statement(catalogue: Catalogue, appearance: str, split: str, statement_id: str) -> CorpusStatement:
    """The statement of the task with that id. Responds with 404 if there is none."""
    for statement in list_statements(catalogue, appearance, split):
        if statement.id == statement_id or any(task.id == statement_id for _, task in statement.tasks):
            return statement
    raise http_error(404, f"there is no statement {statement_id!r} of {appearance} in {split}")


class RecordedOutcomes:
    """Outcomes of recorded episodes, indexed by statement; a recording is indexed again when its file changes."""

    def __init__(self, run_directory: RunDirectory) -> None:
        self._run_directory = run_directory
        self._index: dict[str, tuple[Header, dict[str, list[RunOutcome]]]] = {}  # by recording id

    def for_statement(self, statement: str) -> tuple[list[RunOutcome], list[str]]:
        """The statement's outcomes, and error messages for unreadable recordings."""
        outcomes: list[RunOutcome] = []
        unreadable: list[str] = []
        for file in self._run_directory.recordings()[:MAX_RECORDINGS]:
            if file.header is None:
                unreadable.append(f"{file.name}: {file.fault}")
                continue
            indexed = self._index.get(file.id)
            if indexed is None or indexed[0] is not file.header:
                try:
                    recording = self._run_directory.read(file.id)
                except UnreadableRecording as fault:
                    unreadable.append(str(fault))
                    continue
                if recording is None:
                    continue
                indexed = self._index[file.id] = file.header, _by_statement(file.id, file.name, recording)
            outcomes.extend(indexed[1].get(statement, ()))
        return outcomes, unreadable


def _by_statement(recording_id: str, name: str, recording: Recording) -> dict[str, list[RunOutcome]]:
    index: dict[str, list[RunOutcome]] = {}
    for number, episode in enumerate(recording.episodes):
        outcome = RunOutcome(
            recording=name,
            recording_id=recording_id,
            episode=number,
            agent=recording.header.agent,
            configuration=recording.header.settings.configuration,
            task_id=episode.task,
            outcome=episode.outcome,
            actions=len(episode.actions),
            reward=round(episode.reward, 6),
        )
        index.setdefault(episode.statement, []).append(outcome)
    return index


def statement_body(
    catalogue: Catalogue, statement: CorpusStatement, appearance: str, recorded_outcomes: RecordedOutcomes
) -> StatementBody:
    outcomes, unreadable = recorded_outcomes.for_statement(statement.statement)
    return StatementBody(
        id=statement.id,
        statement=statement.statement,
        form=statement_form(statement.statement),
        program=statement.program,
        canonical=source_of(canonical_form(parse(statement.program))),
        words=sorted(statement.words),
        phenomena=statement.phenomena,
        syntax=sorted(map(str, syntactic_phenomena(statement.statement))),
        scenes=[
            _scene(catalogue, CONFIGURATION_NAMES[appearance, start], task)
            for start, task in statement.tasks[:MAX_SCENES]
        ],
        runs=outcomes,
        unreadable=unreadable,
    )


def _scene(catalogue: Catalogue, configuration: str, task: Task) -> ExploredScene:
    try:
        best = catalogue.solver(configuration).optimal_actions(catalogue.dynamics(configuration).start(task))
    except UnsupportedAppearance:
        best = ActionSet((), complete=False, steps=0)
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
