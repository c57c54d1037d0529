"""Accuracy of a parser: its most probable programs against those of a corpus, by appearance, form and level."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import suppress
from typing import NamedTuple

from lilgym_mp.corpus import CorpusError, load_all_tasks
from lilgym_mp.corpus.generator.pairs import LEVELS, level_of
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.learning.parsing.parser import Parser, truths
from lilgym_mp.programs import syntax
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.printing import source_of

TRAIN = "train"
GROUPS = ("all", "seen forms", "unseen forms", *(f"level {level}" for level in LEVELS), "above all levels")


class ParseScore(NamedTuple):
    """Results for a group of statements, each counted once for each of its programs."""

    appearance: str
    group: str  # one of GROUPS
    statements: int
    exact_form: float  # share whose most probable program has the canonical form of the corpus's
    equal_truth: float  # share where the two have equal truth values on all probe scenes
    among_candidates: float  # share with such a program among the candidates


class ParseItem(NamedTuple):
    """A statement's program in the corpus beside the parser's most probable one."""

    appearance: str
    statement: str
    program: str  # of the corpus
    predicted: str | None  # None if no program was found
    probability: float
    form_seen: bool
    level: int | None  # None above all levels
    exact_form: bool
    equal_truth: bool
    among_candidates: bool
    uncertain: Sequence[str]


def parse_scores(
    parser: Parser,
    corpus: str,
    split: str,
    on_item: Callable[[ParseItem], object] = lambda item: None,
    trained_on: str | None = None,
) -> Iterator[ParseScore]:
    """The scores of each appearance and non-empty group. Raises NoTasksError if the split has no Scratch tasks.

    A form is a statement with colours, shapes, sizes and numbers blanked; it is seen if it occurs in the train split of
    the corpus that the parser was trained on, by default this one. The level of a program is the lowest of the
    statement generator's that admits it.
    """
    forms = set[str]()
    with suppress(CorpusError):  # it is not here, or has no train split
        for tasks in load_all_tasks(trained_on or corpus, starts=[SCRATCH], splits=[TRAIN]):
            forms |= {statement_form(task.statement) for task in tasks}
    for tasks in load_all_tasks(corpus, starts=[SCRATCH], splits=[split]):
        appearance = tasks.provenance.appearance
        groups = defaultdict[str, list[ParseItem]](list)
        for statement, program in dict.fromkeys((task.statement, task.program) for task in tasks):
            item = _item(parser, statement, program, appearance, forms)
            for group in ("all", GROUPS[2 - item.form_seen], f"level {item.level}" if item.level else GROUPS[-1]):
                groups[group].append(item)
            on_item(item)
        for group in GROUPS:
            if items := groups[group]:
                rights = ((item.exact_form, item.equal_truth, item.among_candidates) for item in items)
                shares = (sum(column) / len(items) for column in zip(*rights, strict=True))
                yield ParseScore(appearance, group, len(items), *shares)


def _item(parser: Parser, statement: str, program: str, appearance: str, forms: Set[str]) -> ParseItem:
    parse = parser.parse(statement, appearance)
    candidates = [candidate.program for candidate in parse.candidates]
    right = truths(program, appearance)
    equal = [truths(candidate, appearance) == right for candidate in candidates]
    return ParseItem(
        appearance,
        statement,
        program,
        *(parse.candidates[0] if candidates else (None, 0.0)),
        form_seen=statement_form(statement) in forms,
        level=level_of(program),
        exact_form=bool(candidates) and _form(candidates[0]) == _form(program),
        equal_truth=equal[:1] == [True],
        among_candidates=any(equal),
        uncertain=parse.uncertain,
    )


def _form(program: str) -> str:
    return source_of(canonical_form(syntax.parse(program)))
