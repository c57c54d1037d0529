"""Accuracy of a parser: its most probable programs against those of a corpus, by appearance, form and level."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import NamedTuple

from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.corpus.generator.pairs import LEVELS, level_of
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.learning.parsing.parser import Parser, truths
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import parse

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


def parse_scores(
    parser: Parser, corpus: str, split: str, on_parse: Callable[[], object] = lambda: None
) -> Iterator[ParseScore]:
    """The scores of each appearance and non-empty group. Raises NoTasksError if the split has no Scratch tasks.

    A form is a statement with colours, shapes, sizes and numbers blanked; it is seen if it occurs in the corpus's train
    split. The level of a program is the lowest of the statement generator's that admits it.
    """
    forms = {
        statement_form(task.statement)
        for tasks in load_all_tasks(corpus, starts=[SCRATCH])
        if tasks.provenance.split == TRAIN
        for task in tasks
    }
    for tasks in load_all_tasks(corpus, starts=[SCRATCH], splits=[split]):
        appearance = tasks.provenance.appearance
        groups = defaultdict[str, list[tuple[bool, bool, bool]]](list)
        for statement, program in dict.fromkeys((task.statement, task.program) for task in tasks):
            result = _result(parser, statement, program, appearance)
            level = level_of(program)
            form = "seen forms" if statement_form(statement) in forms else "unseen forms"
            for group in ("all", form, f"level {level}" if level else GROUPS[-1]):
                groups[group].append(result)
            on_parse()
        for group in GROUPS:
            if results := groups[group]:
                shares = (sum(column) / len(results) for column in zip(*results, strict=True))
                yield ParseScore(appearance, group, len(results), *shares)


def _result(parser: Parser, statement: str, program: str, appearance: str) -> tuple[bool, bool, bool]:
    """Whether the best candidate has the program's form, and its truth values, and whether any candidate has them."""
    candidates = [candidate.program for candidate in parser.parse(statement, appearance).candidates]
    right = truths(program, appearance)
    equal = [truths(candidate, appearance) == right for candidate in candidates]
    return bool(candidates) and _form(candidates[0]) == _form(program), equal[:1] == [True], any(equal)


def _form(program: str) -> str:
    return source_of(canonical_form(parse(program)))
