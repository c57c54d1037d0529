"""Corpus statistics: task counts (with the paper's), words, forms, phenomena, program words, and overlap of splits."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from lilgym_mp.contrib.report.phenomena import phenomena, syntactic_phenomena, word_names
from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.official import FILE_FACTS, FileFacts
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.corpus.released import NAME as OFFICIAL_NAME
from lilgym_mp.corpus.released import file_name
from lilgym_mp.corpus.tasks import contexts
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
    def phenomena(self) -> Counter[str]:
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

    def overlap(self, group: StatementStatistics) -> tuple[int, int, int] | None:
        """Overlap of `group` with the train split of its appearance; None without one.

        The number of its statements that occur there up to case and punctuation, of those whose form does, and of its
        words that do not.
        """
        train = next((g for g in self.statements if (g.appearance, g.split) == (group.appearance, "train")), None)
        if train is None:
            return None
        known = {normalised(statement) for statement in train.programs}
        seen = sum(normalised(statement) in known for statement in group.programs)
        seen_forms = sum(statement_form(statement) in train.forms for statement in group.programs)
        return seen, seen_forms, len(group.vocabulary - train.vocabulary)


def corpus_statistics(corpus: str | os.PathLike[str]) -> CorpusStatistics:
    """The statistics of a corpus; `corpus` and errors as for `load_tasks`."""
    counts: list[SetCount] = []
    programs: dict[tuple[str, str], dict[str, str]] = {}
    path = ""
    for tasks in load_all_tasks(corpus):
        origin, is_official = tasks.provenance, tasks.provenance.name == OFFICIAL_NAME
        path = path or (os.path.dirname(origin.path) if is_official else origin.path)
        key = origin.appearance, origin.start, origin.split
        true_at_start = sum(task.truth(task.start) for task in tasks)
        paper = FILE_FACTS[file_name(*key)] if is_official else None
        counts.append(SetCount(*key, len(tasks), contexts(tasks), true_at_start, paper))
        group = programs.setdefault((origin.appearance, origin.split), {})
        for task in tasks:
            group.setdefault(task.statement, task.program)
    statements = [StatementStatistics(appearance, split, group) for (appearance, split), group in programs.items()]
    statements.sort(key=lambda group: (list(APPEARANCES).index(group.appearance), list(SPLITS).index(group.split)))
    return CorpusStatistics(os.fspath(corpus), path, tuple(counts), tuple(statements))
