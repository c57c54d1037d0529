"""Compositional splits: dev and test statements that combine what train has in a way that train has not.

The lists of a split are JSON, `{"corpus": ..., "by": ..., "statements": {"tower train": [ids], ...}}`, with the ids of
Scratch tasks; the path of a corpus is relative to the file. A file of lists, or "builtin:form" for one that is shipped,
can be named wherever a corpus can.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from itertools import combinations
from pathlib import Path

from lilgym_mp.corpus.faults import CorpusError, NoTasksError
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.locations import BUILTIN, is_path, is_split
from lilgym_mp.corpus.records import SCRATCH, decoded, read_bytes
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.corpus.tokens import words
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.choices import choose, listed

LENGTH_SHARE = 0.7  # of the train statements that are short enough to stay
KNOWN_COUNT = 10  # train statements that have a word, for a pair with it to be new
_PARTS = re.compile(r"\w+|[^\w\s]")
_VALUES = re.compile(
    r"\b(?:(Color|Shape|Size|Side)\.\w+|(is_)(?:black|blue|yellow|circle|square|triangle|small|medium|big)|\d+)\b"
)


@cache
def program_form(program: str) -> tuple[str, ...]:
    """What the program consists of, sorted, with a placeholder for each colour, shape, size, side and number.

    Programs that differ in their order, in names or in other ways to write the same have the same form.
    """
    source = source_of(canonical_form(compile_program(program).tree))
    return tuple(sorted(_PARTS.findall(_VALUES.sub(lambda match: match[1] or match[2] or "N", source))))


def word_pairs(statement: str) -> set[tuple[str, str]]:
    """Every two different words of the statement, in alphabetical order."""
    return set(combinations(sorted(set(words(statement))), 2))


Part = tuple[Sequence[Task], Callable[[Task], bool]]  # train tasks that stay; whether a dev or test task is held out


def _by_form(train: Sequence[Task]) -> Part:
    seen = {program_form(task.program) for task in train}
    return train, lambda task: program_form(task.program) not in seen


def _by_length(train: Sequence[Task]) -> Part:
    lengths = sorted(len(words(task.statement)) for task in train)
    most = lengths[int(LENGTH_SHARE * len(lengths))]
    short = [task for task in train if len(words(task.statement)) <= most]
    return short, lambda task: len(words(task.statement)) > most


def _by_pair(train: Sequence[Task]) -> Part:
    counts = Counter(word for task in train for word in set(words(task.statement)))
    seen = set[tuple[str, str]]().union(*(word_pairs(task.statement) for task in train))

    def is_new(task: Task) -> bool:
        return any(min(counts[word] for word in pair) >= KNOWN_COUNT for pair in word_pairs(task.statement) - seen)

    return train, is_new


RULES: Mapping[str, Callable[[Sequence[Task]], Part]] = {"form": _by_form, "length": _by_length, "pair": _by_pair}


def split_lists(by: str, sets: Sequence[TaskSet]) -> dict[str, list[str]]:
    """The ids of the Scratch tasks of a split, by appearance and split of the corpus.

    `by`: "form", dev and test have programs that no train statement has, whatever the colours, shapes, sizes, sides and
    numbers; "length", they have more words than any train statement, of which the shorter `LENGTH_SHARE` stay; "pair",
    they have two words that no train statement has together, but `KNOWN_COUNT` or more have each.
    """
    lists: dict[str, list[str]] = {}
    for train in (tasks for tasks in sets if tasks.provenance.split == "train"):
        stays, is_held_out = RULES[by](train)
        lists[_key(train)] = [task.id for task in stays]
        for tasks in sets:
            if tasks.provenance.appearance == train.provenance.appearance and tasks is not train:
                lists[_key(tasks)] = [task.id for task in tasks if is_held_out(task)]
    return lists


def _key(tasks: TaskSet) -> str:
    return f"{tasks.provenance.appearance} {tasks.provenance.split}"


def load_listed(corpus: str, appearance: str, start: str, split: str) -> TaskSet:
    """The tasks whose statements a file of lists has.

    Raises CorpusError for a file that cannot be read or is damaged, NoTasksError if no task remains.
    """
    contents = _contents(corpus)
    try:
        lists = json.loads(decoded(contents, corpus))
        base = str(lists["corpus"])
        by = str(lists["by"])
        statements = {key: frozenset(map(str, ids)) for key, ids in lists["statements"].items()}
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise CorpusError(f"{corpus}: not a file of lists as `lilgym-mp data split` writes: {error!r}") from None
    if is_split(base):
        raise CorpusError(f"{corpus}: lists of {base}, which is itself a split; split its corpus instead")
    if is_path(base):
        base = str(Path(corpus).parent / base)
    tasks, scratch = (load_tasks(base, appearance, kind, split) for kind in (start, SCRATCH))
    ids = statements.get(_key(tasks), frozenset())
    if unknown := ids.difference(task.id for task in scratch):
        raise CorpusError(f"{corpus}: has ids that are not in {base} ({_key(tasks)}): {listed(sorted(unknown)[:3])}")
    kept = {task.statement for task in scratch if task.id in ids}
    found = [task for task in tasks if task.statement in kept]
    origin = tasks.provenance
    sha256 = hashlib.sha256(origin.sha256.encode() + contents).hexdigest()
    provenance = replace(origin, corpus=corpus, name=f"{origin.name}, split by {by}", sha256=sha256)
    if not found:
        raise NoTasksError(f"{corpus}: has no tasks for {provenance}; it lists statements of {listed(statements)}")
    return TaskSet(found, provenance)


def _contents(corpus: str) -> bytes:
    if corpus.startswith(f"{BUILTIN}:"):
        by = choose("split", corpus.partition(":")[2], {by: by for by in RULES})
        return (files("lilgym_mp.data") / f"{BUILTIN}-{by}.split.json.gz").read_bytes()
    return read_bytes(Path(corpus))
