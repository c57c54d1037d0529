"""Statistics of a corpus as tables, for `lilgym-mp data stats`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence

from lilgym_mp.corpus.official import FILE_FACTS, STATEMENT_COUNT, released_name
from lilgym_mp.corpus.official import RELEASE_NAME as OFFICIAL_NAME
from lilgym_mp.corpus.tasks import TaskSet, contexts
from lilgym_mp.corpus.tokens import normalised, statement_form, words
from lilgym_mp.envs.registration import configuration_name
from lilgym_mp.evaluation.terminal import table

TASK_COLUMNS = ("configuration", "split", "tasks", "contexts", "true at start")
PAPER_COLUMNS = ("tasks (paper)", "contexts (paper)")
STATEMENT_COLUMNS = (
    "statements",
    "number",
    "forms",
    "words",
    "mean words",
    "longest",
    "in train",
    "form in train",
    "new words",
)
Programs = Mapping[tuple[str, str], Mapping[str, str]]  # by appearance and split, and by statement as written


def statistics_text(corpus: str, sets: Sequence[TaskSet]) -> str:
    """All tables of the corpus with these task sets, at least one."""
    origin = sets[0].provenance
    is_official = origin.name == OFFICIAL_NAME
    path = os.path.dirname(origin.path) if is_official else origin.path
    programs = programs_of(sets)
    statements = {statement for group in programs.values() for statement in group}
    distinct = {program for group in programs.values() for program in group.values()}
    columns = (*TASK_COLUMNS, *PAPER_COLUMNS) if is_official else TASK_COLUMNS
    published = f" (the paper counts {STATEMENT_COUNT:,} statements in all three splits)" if is_official else ""
    return "\n\n".join(
        [
            f"corpus {corpus}: {path}\n{len(statements):,} statements with {len(distinct):,} programs,"
            f" {len(_vocabulary(statements)):,} words{published}",
            table(columns, map(task_row, sets), keys=2),
            table(STATEMENT_COLUMNS, [statement_row(programs, *key) for key in programs]),
        ]
    )


def programs_of(sets: Iterable[TaskSet]) -> Programs:
    """The programs of the distinct statements."""
    programs: dict[tuple[str, str], dict[str, str]] = {}
    for tasks in sets:
        group = programs.setdefault((tasks.provenance.appearance, tasks.provenance.split), {})
        for task in tasks:
            group.setdefault(task.statement, task.program)
    return programs


def task_row(tasks: TaskSet) -> list[object]:
    """A task set's TASK_COLUMNS, and of the official corpus PAPER_COLUMNS."""
    origin = tasks.provenance
    row = [configuration_name(origin.appearance, origin.start), origin.split, len(tasks), contexts(tasks)]
    row.append(sum(task.truth(task.start) for task in tasks))
    if origin.name != OFFICIAL_NAME:
        return row
    paper = FILE_FACTS[released_name(origin.appearance, origin.start, origin.split)]
    return [*row, paper.tasks, paper.contexts]


def statement_row(programs: Programs, appearance: str, split: str) -> list[object]:
    """STATEMENT_COLUMNS of an appearance and split; the last three are None in train and without it.

    "In train" ignores case and punctuation.
    """
    statements = programs[appearance, split]
    train = programs.get((appearance, "train"))
    forms = set(map(statement_form, statements))
    vocabulary = _vocabulary(statements)
    lengths = [len(words(statement)) for statement in statements]
    row = [f"{appearance} {split}", len(statements), len(forms), len(vocabulary), sum(lengths) / len(lengths)]
    if train is None or split == "train":
        return [*row, max(lengths), None, None, None]
    known = set(map(normalised, train))
    known_forms = set(map(statement_form, train))
    seen = sum(normalised(statement) in known for statement in statements)
    seen_forms = sum(statement_form(statement) in known_forms for statement in statements)
    return [*row, max(lengths), seen, seen_forms, len(vocabulary - _vocabulary(train))]


def _vocabulary(statements: Iterable[str]) -> set[str]:
    return {word for statement in statements for word in words(statement)}
