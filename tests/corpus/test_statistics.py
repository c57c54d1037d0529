"""Corpus statistics and their charts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.contrib.report.corpus_statistics import CorpusStatistics, corpus_statistics
from lilgym_mp.corpus import CorpusError
from lilgym_mp.corpus.faults import NoTasksError
from lilgym_mp.corpus.loading import load_all_tasks

Entries = list[dict[str, Any]]
Writer = Callable[..., Path]
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def statistics(entries: Entries, written: Writer) -> CorpusStatistics:
    """Statistics of two Tower train statements, and of three dev statements that share one statement and one form."""
    program = "count(filter_color(all_items, Color.BLACK)) == 3"
    dev = [("again", "blue is HERE"), ("form", "Black is here."), ("new", "Nothing alike at all.")]
    entries += [
        {**entries[0], "id": name, "split": "dev", "statement": statement, "program": program, "starts": []}
        for name, statement in dev
    ]
    return corpus_statistics(written(entries))


def test_load_all_tasks__omits_empty_sets(entries: Entries, written: Writer):
    found = [
        (s.provenance.appearance, s.provenance.start, s.provenance.split) for s in load_all_tasks(written(entries))
    ]
    assert found == [
        ("tower", "scratch", "train"),
        ("tower", "flipit", "train"),
        ("scatter", "scratch", "dev"),
        ("scatter", "flipit", "dev"),
    ]


def test_load_all_tasks__a_corpus_without_tasks_is_an_error(written: Writer, tmp_path: Path):
    with pytest.raises(NoTasksError, match="has no tasks"):
        list(load_all_tasks(written([])))
    with pytest.raises(NoTasksError, match="has no tasks"):
        list(load_all_tasks(tmp_path))


def test_load_all_tasks__a_faulty_corpus_is_an_error(entries: Entries, written: Writer):
    entries[0]["program"] = "exist("
    with pytest.raises(CorpusError, match="never closed"):
        corpus_statistics(written(entries))


def test_statistics__tasks_and_contexts_are_counted(statistics: CorpusStatistics):
    counts = {(c.appearance, c.start, c.split): (c.tasks, c.contexts, c.true_at_start) for c in statistics.counts}
    assert counts["tower", "flipit", "train"] == (3, 3, 1)
    assert counts["tower", "scratch", "dev"] == (3, 3, 0)
    assert all(count.paper is None for count in statistics.counts)


def test_statistics__statements_words_and_forms_are_counted(statistics: CorpusStatistics):
    train, dev, _ = statistics.statements
    assert (train.appearance, train.split, len(train.programs)) == ("tower", "train", 2)
    assert train.vocabulary == {"blue", "is", "here", "two", "blocks", "it's", "all"}
    assert dev.word_counts == [3, 3, 4]
    assert dev.forms == {"COLOUR is here", "nothing alike at all"}
    assert statistics.statement_count == 6


def test_statistics__phenomena_and_program_words_are_counted_by_statement(statistics: CorpusStatistics):
    train, dev, _ = statistics.statements
    assert train.phenomena == {"existence": 1, "exact cardinality": 1}
    assert dev.program_words == {"count": 3, "filter_color": 3}


def test_statistics__syntactic_phenomena_come_from_the_statement(entries: Entries, written: Writer):
    entries[0]["statement"] = "We see a box with a circle and a square."
    train = corpus_statistics(written(entries)).statements[0]
    assert train.phenomena["syntax: coordination"] == 1
    assert train.phenomena["syntax: prepositional attachment"] == 0


def test_statistics__seen_in_train_ignores_case(statistics: CorpusStatistics):
    _, dev, scatter = statistics.statements
    assert statistics.overlap(dev) == (1, 2, 4)
    assert statistics.overlap(scatter) is None


def test_statistics__include_the_papers_counts_for_released_files(released: Path):
    paper = {count.start: count.paper for count in corpus_statistics(released).counts}
    assert paper["flipit"] is not None
    assert (paper["flipit"].tasks, paper["flipit"].contexts) == (1_383, 619)


def test_statistics__of_the_official_dev_split(official_data: Path, tmp_path: Path):
    for name in ("tower_scratch_train", "tower_scratch_dev"):
        (tmp_path / f"{name}.json").symlink_to(official_data / f"{name}.json")
    statistics = corpus_statistics(tmp_path)
    assert [count.true_at_start for count in statistics.counts] == [25, 4]  # as the paper's authors found
    assert statistics.overlap(statistics.statements[1]) == (70, 104, 4)
