"""Corpus statistics: task counts (with the paper's), words, forms, phenomena, program words, and overlap of splits."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from lilgym_mp.contrib.report.phenomena import (
    Phenomenon,
    SyntacticPhenomenon,
    phenomena,
    syntactic_phenomena,
    word_names,
)
from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.official import FILE_FACTS, FileFacts
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.corpus.released import NAME as OFFICIAL_NAME
from lilgym_mp.corpus.released import file_name
from lilgym_mp.corpus.tasks import TaskSet, contexts
from lilgym_mp.corpus.tokens import normalised, statement_form, words
from lilgym_mp.programs.syntax import parse
from lilgym_mp.scene.appearances import APPEARANCES


class SetCount(NamedTuple):
    """Counts of one configuration and split, with those of the paper for the official corpus."""

    appearance: str
    start: str
    split: str
    tasks: int
    contexts: int
    true_at_start: int  # tasks whose statement is true of the start scene
    paper: FileFacts | None


@dataclass(frozen=True)
class StatementStatistics:
    """The distinct statements of one appearance and split, each with one program."""

    appearance: str
    split: str
    programs: Mapping[str, str]  # keyed by statement, as written

    @cached_property
    def word_counts(self) -> list[int]:
        """The number of words in each statement."""
        return [len(words(statement)) for statement in self.programs]

    @cached_property
    def vocabulary(self) -> frozenset[str]:
        return frozenset(word for statement in self.programs for word in words(statement))

    @cached_property
    def forms(self) -> frozenset[str]:
        return frozenset(map(statement_form, self.programs))

    @cached_property
    def normalised(self) -> frozenset[str]:
        return frozenset(map(normalised, self.programs))

    @cached_property
    def phenomena(self) -> Counter[Phenomenon | SyntacticPhenomenon]:
        """The number of statements that show each phenomenon."""
        return Counter(
            found
            for statement, program in self.programs.items()
            for found in (*phenomena(program), *syntactic_phenomena(statement))
        )

    @cached_property
    def program_words(self) -> Counter[str]:
        """The number of programs that use each word of the program language."""
        return Counter(name for program in self.programs.values() for name in word_names(parse(program)))


class Overlap(NamedTuple):
    """Statements of a split that also occur in train: up to case and punctuation (`seen`), and by form."""

    statements: int
    seen: int
    seen_forms: int
    unseen_words: int  # distinct words not in train


@dataclass(frozen=True)
class CorpusStatistics:
    corpus: str
    path: str
    counts: tuple[SetCount, ...]
    statements: tuple[StatementStatistics, ...]  # one entry per appearance and split

    @property
    def statement_count(self) -> int:
        """Distinct statements, as written, of all appearances and splits."""
        return len({statement for group in self.statements for statement in group.programs})

    @property
    def word_count(self) -> int:
        """Distinct words of all statements."""
        return len({word for group in self.statements for word in group.vocabulary})

    @property
    def program_count(self) -> int:
        """Distinct programs of all statements."""
        return len({program for group in self.statements for program in group.programs.values()})

    def overlap(self, group: StatementStatistics) -> Overlap | None:
        """The overlap of `group` with the train split of its appearance; None without a train split."""
        train = next((g for g in self.statements if (g.appearance, g.split) == (group.appearance, "train")), None)
        if train is None:
            return None
        return Overlap(
            statements=len(group.programs),
            seen=sum(normalised(statement) in train.normalised for statement in group.programs),
            seen_forms=sum(statement_form(statement) in train.forms for statement in group.programs),
            unseen_words=len(group.vocabulary - train.vocabulary),
        )


def corpus_statistics(corpus: str | os.PathLike[str]) -> CorpusStatistics:
    """The statistics of a corpus; `corpus` and errors as for `load_tasks`."""
    counts: list[SetCount] = []
    programs: dict[tuple[str, str], dict[str, str]] = {}
    path = ""
    for tasks in load_all_tasks(corpus):
        origin = tasks.provenance
        path = path or (os.path.dirname(origin.path) if origin.name == OFFICIAL_NAME else origin.path)
        counts.append(_count(tasks))
        group = programs.setdefault((origin.appearance, origin.split), {})
        for task in tasks:
            group.setdefault(task.statement, task.program)
    statements = [StatementStatistics(appearance, split, group) for (appearance, split), group in programs.items()]
    statements.sort(key=lambda group: (list(APPEARANCES).index(group.appearance), list(SPLITS).index(group.split)))
    return CorpusStatistics(os.fspath(corpus), path, tuple(counts), tuple(statements))


def _count(tasks: TaskSet) -> SetCount:
    origin = tasks.provenance
    is_official = origin.name == OFFICIAL_NAME
    return SetCount(
        origin.appearance,
        origin.start,
        origin.split,
        len(tasks),
        contexts(tasks),
        true_at_start=sum(task.truth(task.start) for task in tasks),
        paper=FILE_FACTS[file_name(origin.appearance, origin.start, origin.split)] if is_official else None,
    )
