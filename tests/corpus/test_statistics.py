"""Corpus statistics."""

import pytest

from lilgym_mp.cli.data_report import programs_of, statement_row, statistics_text, task_row
from lilgym_mp.corpus.faults import NoTasksError
from lilgym_mp.corpus.loading import load_all_tasks


@pytest.fixture
def sets(entries, written):
    """Two Tower train statements, and three dev statements that share one statement and one form."""
    program = "count(filter_color(all_items, Color.BLACK)) == 3"
    dev = [("again", "blue is HERE"), ("form", "Black is here."), ("new", "Nothing alike at all.")]
    entries += [
        {**entries[0], "id": name, "split": "dev", "statement": statement, "program": program, "starts": []}
        for name, statement in dev
    ]
    return list(load_all_tasks(written(entries)))


def test_load_all_tasks__omits_empty_sets(entries, written):
    found = [tasks.provenance for tasks in load_all_tasks(written(entries))]
    assert [f"{each.appearance} {each.start} {each.split}" for each in found] == [
        "tower scratch train",
        "tower flipit train",
        "scatter scratch dev",
        "scatter flipit dev",
    ]


def test_load_all_tasks__a_corpus_without_tasks_is_an_error(written, tmp_path):
    with pytest.raises(NoTasksError, match="has no tasks"):
        list(load_all_tasks(written([])))
    with pytest.raises(NoTasksError, match="has no tasks"):
        list(load_all_tasks(tmp_path))


def test_statistics__count_tasks_contexts_and_distinct_statements(sets):
    rows = list(map(task_row, sets))
    assert ["TowerFlipIt", "train", 3, 3, 1] in rows
    assert ["TowerScratch", "dev", 3, 3, 0] in rows
    assert "6 statements with" in statistics_text("own", sets)


def test_statement_row__counts_statements_forms_and_words_and_seen_in_train_ignores_case(sets):
    programs = programs_of(sets)
    assert statement_row(programs, "tower", "train")[:4] == ["tower train", 2, 2, 7]
    assert statement_row(programs, "tower", "dev") == ["tower dev", 3, 2, 8, 10 / 3, 4, 1, 2, 4]
    assert statement_row(programs, "scatter", "dev")[-3:] == [None] * 3


def test_statistics__include_the_papers_counts_for_released_files(released):
    rows = {row[0]: row for row in map(task_row, load_all_tasks(released))}
    assert rows["TowerFlipIt"][-2:] == [1_383, 619]


def test_statistics__of_the_official_dev_split(official_data, tmp_path):
    for name in ("tower_scratch_train", "tower_scratch_dev"):
        (tmp_path / f"{name}.json").symlink_to(official_data / f"{name}.json")
    sets = list(load_all_tasks(tmp_path))
    assert [task_row(tasks)[4] for tasks in sets] == [25, 4]  # as the paper's authors found
    assert statement_row(programs_of(sets), "tower", "dev")[-3:] == [70, 104, 4]
