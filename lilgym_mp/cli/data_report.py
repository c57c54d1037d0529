"""Corpora, their statistics and tasks as text, for `lilgym-mp data`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lilgym_mp.contrib.report.corpus_statistics import CorpusStatistics, SetCount, StatementStatistics
from lilgym_mp.contrib.report.phenomena import PHENOMENA, phenomena, syntactic_phenomena
from lilgym_mp.corpus.official import STATEMENT_COUNT
from lilgym_mp.corpus.tasks import TaskSet, contexts
from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.envs.registration import configuration_name
from lilgym_mp.evaluation.terminal import table
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.render.characters import text

SHOWN_WORDS = 20  # most frequent program words in the table


def listing(corpora: Sequence[tuple[str, str, Sequence[TaskSet]]]) -> str:
    """A table of corpora, each given as name, remark if it has no task sets, and task sets."""
    rows: list[tuple[object, ...]] = []
    for name, remark, sets in corpora:
        for tasks in sets:
            configuration = configuration_name(tasks.provenance.appearance, tasks.provenance.start)
            rows.append((name, configuration, tasks.provenance.split, len(tasks), contexts(tasks)))
        if not sets:
            rows.append((name, remark, "", None, None))
    return table(["corpus", "configuration", "split", "tasks", "contexts"], rows)


def statistics_text(statistics: CorpusStatistics) -> str:
    """Every table of a corpus's statistics."""
    is_official = any(count.paper is not None for count in statistics.counts)
    published = f" (the paper counts {STATEMENT_COUNT:,} statements in all three splits)" if is_official else ""
    groups = statistics.statements
    phenomena = {kind: [group.phenomena[kind] for group in groups] for kind in PHENOMENA}
    words = {name: [group.program_words[name] for group in groups] for group in groups for name in group.program_words}
    commonest = sorted(words, key=lambda name: (-sum(words[name]), name))[:SHOWN_WORDS]
    return "\n\n".join(
        [
            f"corpus {statistics.corpus}: {statistics.path}\n"
            f"{statistics.statement_count:,} statements with {statistics.program_count:,} programs, "
            f"{statistics.word_count:,} words{published}",
            _counts_table(statistics.counts, is_official),
            _statements_table(statistics),
            _shares_table("phenomenon, % of statements", groups, phenomena),
            _shares_table("program word, % of programs", groups, {name: words[name] for name in commonest}),
        ]
    )


def _counts_table(counts: Sequence[SetCount], is_official: bool) -> str:
    rows: list[list[object]] = []
    for count in counts:
        own = [count.split, count.tasks, count.contexts, count.true_at_start]
        paper = [count.paper.tasks, count.paper.contexts] if count.paper else [None, None]
        rows.append([configuration_name(count.appearance, count.start), *own, *paper * is_official])
    header = ["configuration", "split", "tasks", "contexts", "true at start"]
    return table(header + ["tasks (paper)", "contexts (paper)"] * is_official, rows)


def _statements_table(statistics: CorpusStatistics) -> str:
    own = ("statements", "number", "forms", "words", "mean words", "longest")
    rows: list[list[object]] = []
    for group in statistics.statements:
        overlap = None if group.split == "train" else statistics.overlap(group)
        sizes = map(len, (group.programs, group.forms, group.vocabulary))
        lengths = sum(group.word_counts) / len(group.word_counts), max(group.word_counts)
        rows.append([f"{group.appearance} {group.split}", *sizes, *lengths, *(overlap or [None] * 3)])
    return table((*own, "in train", "form in train", "new words"), rows)


def _shares_table(title: str, groups: Sequence[StatementStatistics], counts: Mapping[Any, Sequence[int]]) -> str:
    """Percentages of each group's statements; `counts`: by name of the row, one for each group."""
    sizes = [len(group.programs) for group in groups]
    rows = [
        [str(name), *(100 * count / size for count, size in zip(row, sizes, strict=True))]
        for name, row in counts.items()
    ]
    return table([title, *_heads(groups)], rows)


def _heads(groups: Sequence[StatementStatistics]) -> list[str]:
    """The names of the groups; an appearance is named once, so that all columns fit a terminal."""
    before = [None, *(group.appearance for group in groups)]
    return [
        group.split if group.appearance == last else f"{group.appearance} {group.split}"
        for group, last in zip(groups, before, strict=False)
    ]


def task_lines(task: Task, tasks: TaskSet) -> list[str]:
    """Everything about a task except its picture."""
    shown = sorted((*phenomena(task.program), *syntactic_phenomena(task.statement)), key=PHENOMENA.index)
    truth, target = task.truth(task.start), str(task.target).lower()
    return [
        f"task {task.id!r} of {tasks.provenance}",
        f"statement  {task.statement}",
        f"program    {task.program.strip()}",
        f"target     {target}: make the statement {target}",
        f"truth      {str(truth).lower()} in this scene{' already' if truth == task.target else ''}",
        f"phenomena  {', '.join(shown) or 'none'}",
        f"form       {statement_form(task.statement)}",
    ]


def task_text(task: Task, tasks: TaskSet, *, coloured: bool) -> str:
    """The task and its start scene, drawn with characters."""
    return text(task.start, task_lines(task, tasks), coloured=coloured)
