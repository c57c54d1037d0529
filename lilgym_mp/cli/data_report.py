"""Corpora, their statistics and tasks as text and JSON, for `lilgym-mp data`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from lilgym_mp import render
from lilgym_mp.analysis.phenomena import PHENOMENA, phenomena, syntactic_phenomena
from lilgym_mp.analysis.statistics import CorpusStatistics, StatementStatistics
from lilgym_mp.corpus.forms import statement_form
from lilgym_mp.corpus.official.release import STATEMENT_COUNT
from lilgym_mp.corpus.tasks import TaskSet, contexts
from lilgym_mp.envs.registration import configuration_name
from lilgym_mp.task import Task
from lilgym_mp.terminal import table

SHOWN_WORDS = 20  # most frequent program words in the table


def listing(corpora: Sequence[tuple[str, str, Sequence[TaskSet]]]) -> str:
    """A table of corpora, each given as name, remark if it has no task sets, and task sets."""
    rows: list[tuple[object, ...]] = []
    for name, remark, sets in corpora:
        for tasks in sets:
            origin = tasks.provenance
            rows.append(
                (name, configuration_name(origin.appearance, origin.start), origin.split, len(tasks), contexts(tasks))
            )
        if not sets:
            rows.append((name, remark, "", None, None))
    return table(["corpus", "configuration", "split", "tasks", "contexts"], rows)


def statistics_text(statistics: CorpusStatistics) -> str:
    """Every table of a corpus's statistics."""
    return "\n\n".join(
        [
            f"corpus {statistics.corpus}: {statistics.path}\n"
            f"{statistics.statement_count:,} statements with {statistics.program_count:,} programs, "
            f"{statistics.word_count:,} words{_paper_statements(statistics)}",
            _counts_table(statistics),
            _statements_table(statistics),
            _shares_table(
                "phenomenon, % of statements",
                statistics.statements,
                [
                    (phenomenon, [group.phenomena[phenomenon] for group in statistics.statements])
                    for phenomenon in PHENOMENA
                ],
            ),
            _shares_table("program word, % of programs", statistics.statements, list(_commonest_words(statistics))),
        ]
    )


def _paper_statements(statistics: CorpusStatistics) -> str:
    if all(count.paper is None for count in statistics.counts):
        return ""
    return f" (the paper counts {STATEMENT_COUNT:,} statements in all three splits)"


def _counts_table(statistics: CorpusStatistics) -> str:
    official = any(count.paper is not None for count in statistics.counts)
    header = ["configuration", "split", "tasks", "contexts", "true at start"]
    rows: list[list[object]] = []
    for count in statistics.counts:
        row: list[object] = [
            configuration_name(count.appearance, count.start),
            count.split,
            count.tasks,
            count.contexts,
            count.true_at_start,
        ]
        if official:
            row += [count.paper.tasks, count.paper.contexts] if count.paper else [None, None]
        rows.append(row)
    return table(header + ["tasks (paper)", "contexts (paper)"] * official, rows)


def _statements_table(statistics: CorpusStatistics) -> str:
    header = [
        "statements",
        "number",
        "forms",
        "words",
        "mean words",
        "longest",
        "in train",
        "form in train",
        "new words",
    ]
    rows: list[list[object]] = []
    for group in statistics.statements:
        overlap = None if group.split == "train" else statistics.overlap(group)
        rows.append(
            [
                f"{group.appearance} {group.split}",
                len(group.programs),
                len(group.forms),
                len(group.vocabulary),
                sum(group.word_counts) / len(group.word_counts),
                max(group.word_counts),
                *((overlap.seen, overlap.seen_forms, overlap.unseen_words) if overlap else (None, None, None)),
            ]
        )
    return table(header, rows)


def _shares_table(title: str, groups: Sequence[StatementStatistics], rows: Sequence[tuple[str, Sequence[int]]]) -> str:
    """Percentages of each group; each row is a name and its counts by group."""
    header = [title, *(f"{group.appearance} {group.split}" for group in groups)]
    return table(
        header,
        [
            [str(name), *(100 * count / len(group.programs) for count, group in zip(counts, groups, strict=True))]
            for name, counts in rows
        ],
    )


def _commonest_words(statistics: CorpusStatistics) -> Iterator[tuple[str, Sequence[int]]]:
    uses = {
        name: [group.program_words[name] for group in statistics.statements]
        for group in statistics.statements
        for name in group.program_words
    }
    for name in sorted(uses, key=lambda name: (-sum(uses[name]), name))[:SHOWN_WORDS]:
        yield name, uses[name]


def statistics_json(statistics: CorpusStatistics) -> dict[str, Any]:
    """The statistics as JSON: counts only, without statements."""
    return {
        "corpus": statistics.corpus,
        "statements": statistics.statement_count,
        "programs": statistics.program_count,
        "words": statistics.word_count,
        "sets": [
            {**count._asdict(), "paper": count.paper and {"tasks": count.paper.tasks, "contexts": count.paper.contexts}}
            for count in statistics.counts
        ],
        "splits": [
            {
                "appearance": group.appearance,
                "split": group.split,
                "statements": len(group.programs),
                "forms": len(group.forms),
                "words": len(group.vocabulary),
                "lengths": sorted(group.word_counts),
                "phenomena": {phenomenon.value: group.phenomena[phenomenon] for phenomenon in PHENOMENA},
                "program_words": dict(group.program_words.most_common()),
                "overlap_with_train": overlap._asdict() if (overlap := statistics.overlap(group)) else None,
            }
            for group in statistics.statements
        ],
    }


def task_lines(task: Task, tasks: TaskSet) -> list[str]:
    """Everything about a task except its picture."""
    shown = sorted((*phenomena(task.program), *syntactic_phenomena(task.statement)), key=PHENOMENA.index)
    truth = task.truth(task.start)
    return [
        f"task {task.id!r} of {tasks.provenance}",
        f"statement  {task.statement}",
        f"program    {task.program.strip()}",
        f"target     {_word(task.target)}: make the statement {_word(task.target)}",
        f"truth      {_word(truth)} in this scene{' already' if truth == task.target else ''}",
        f"phenomena  {', '.join(shown) or 'none'}",
        f"form       {statement_form(task.statement)}",
    ]


def task_text(task: Task, tasks: TaskSet, *, coloured: bool) -> str:
    """The task and its start scene, drawn with characters."""
    return render.text(task.start, task_lines(task, tasks), coloured=coloured)


def _word(truth: bool) -> str:
    return "true" if truth else "false"
