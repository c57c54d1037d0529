"""Loading tasks: contents, order, locations and caching."""

import copy
import os
import pickle
import time

import pytest

from lilgym_mp.corpus import CorpusError, NoTasksError, check_corpus, contexts, load_tasks, official_directory
from lilgym_mp.corpus.notes import note_after
from lilgym_mp.corpus.writing import task_rows
from lilgym_mp.scene import Colour, Scene


@pytest.fixture
def tower_starts(entries, written):
    return load_tasks(written(entries), "tower", "flipit", "train")


def test_load_scratch__every_entry_is_a_task_from_the_empty_scene(entries, written):
    tasks = load_tasks(written(entries), "tower", "scratch", "train")
    assert tasks.ids == ("blue", "pair")
    assert all(task.target is True and task.start == Scene.empty() for task in tasks)
    assert tasks[0].statement == "Blue is here."


def test_load_flipit__every_start_is_a_task_with_the_opposite_target(tower_starts):
    assert [(task.id, task.target) for task in tower_starts] == [
        ("blue-yes", False),
        ("blue-no", True),
        ("pair-no", True),
    ]
    assert [item.colour for item in tower_starts[1].start.items()] == [Colour.BLACK]
    assert not any(task.solved_by(task.start) for task in tower_starts)


def test_load__plain_and_gzip_files_give_the_same_tasks(entries, written):
    plain, zipped = written(entries, "a.jsonl"), written(entries, "a.jsonl.gz")
    assert zipped.read_bytes()[:2] == b"\x1f\x8b"
    assert tuple(load_tasks(plain, "tower", "flipit", "train")) == tuple(load_tasks(zipped, "tower", "flipit", "train"))


def test_load__equal_start_scenes_are_one_object(entries, written):
    entries[1]["starts"][0]["scene"] = copy.deepcopy(entries[0]["starts"][1]["scene"])
    tasks = load_tasks(written(entries), "tower", "flipit", "train")
    assert tasks.by_id("pair-no").start is tasks.by_id("blue-no").start


def test_load__caches_a_file_until_it_is_changed(entries, written):
    path = written(entries)
    before = load_tasks(path, "tower", "scratch", "train")
    assert load_tasks(path, "tower", "scratch", "train") is before
    written(entries[:1])
    os.utime(path, ns=(1, 1))
    assert load_tasks(path, "tower", "scratch", "train").ids == ("blue",)
    assert before.ids == ("blue", "pair")


def test_provenance__has_the_file_and_its_sha256(entries, written):
    path = written(entries)
    provenance = load_tasks(path, "scatter", "flipit", "dev").provenance
    assert (provenance.name, provenance.path, provenance.split) == ("own", str(path), "dev")
    assert len(provenance.sha256) == 64
    written(entries[2:])
    assert load_tasks(path, "scatter", "flipit", "dev").provenance.sha256 != provenance.sha256


def test_by_id__unknown_id_error_names_the_task_set_and_similar_ids(tower_starts):
    with pytest.raises(ValueError, match=r"no task 'blue-yess' in .* tower flipit, split 'train'.*blue-yes"):
        tower_starts.by_id("blue-yess")


def test_task_set__is_a_sequence_that_survives_pickling(tower_starts):
    assert len(tower_starts) == 3
    assert tower_starts[-1].id == "pair-no"
    assert [task.id for task in tower_starts[:2]] == ["blue-yes", "blue-no"]
    copied = pickle.loads(pickle.dumps(tower_starts))
    assert tuple(copied) == tuple(tower_starts)
    assert copied.by_id("blue-no") == tower_starts.by_id("blue-no")


def test_tags__apply_to_all_tasks_of_the_entry(entries, written):
    entries[0]["tags"] = ["easy", "level 1"]
    path = written(entries)
    assert load_tasks(path, "tower", "scratch", "train").by_id("blue").tags == ("easy", "level 1")
    flipit = load_tasks(path, "tower", "flipit", "train")
    assert flipit.by_id("blue-no").tags == ("easy", "level 1")
    assert flipit.by_id("pair-no").tags == ()


def test_contexts__starts_of_one_statement_and_target_count_once(entries, written):
    entries[0]["starts"].append({**entries[0]["starts"][0], "id": "blue-again"})
    assert contexts(load_tasks(written(entries), "tower", "flipit", "train")) == 3


def test_released_directory__test_split_loads(released):
    scratch = load_tasks(released, "tower", "scratch", "test")
    flipit = load_tasks(str(released), "tower", "flipit", "test")
    assert scratch.ids == ("7",)
    assert [(task.id, task.target) for task in flipit] == [("blue-yes", False), ("blue-no", True), ("pair-no", True)]
    assert flipit.provenance.path == str(released / "tower_flipit_test.json")


def test_released_directory__a_missing_file_is_named(released):
    with pytest.raises(CorpusError, match=r"lacks scatter_flipit_dev\.json; .* it has tower_flipit_test\.json, tower_"):
        load_tasks(released, "scatter", "flipit", "dev")


def test_official_corpus__is_found_through_the_environment_variable(released, monkeypatch):
    monkeypatch.setenv("LILGYM_DATA", str(released))
    assert load_tasks("lilgym", "tower", "scratch", "test").provenance.corpus == "lilgym"


def test_official_corpus__is_looked_for_in_the_user_cache(tmp_path, monkeypatch):
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert official_directory() == tmp_path / "lilgym_mp" / "lilgym"


def test_official_corpus__missing_corpus_error_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("LILGYM_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(
        CorpusError, match=r"official corpus was not found: .*nowhere is not .*LILGYM_DATA.*lilgym-mp data download"
    ):
        load_tasks("lilgym", "tower", "scratch", "train")


def test_load__says_what_it_waits_for(entries, written, monkeypatch, capsys):
    monkeypatch.setattr("lilgym_mp.corpus.loading.note_after", lambda note: note_after(note, seconds=0.0))
    path = written(entries)
    monkeypatch.setattr("lilgym_mp.corpus.loading.read_corpus_file", lambda *args: time.sleep(0.2))
    with pytest.raises(AttributeError):
        load_tasks(path, "tower", "scratch", "train")
    assert capsys.readouterr().err == f"loading corpus {path} ...\n"


@pytest.mark.parametrize("is_left_out", [False, True])
def test_entry_without_a_program__is_read_and_exported_but_not_played(entries, written, capsys, is_left_out):
    open_entry = {**entries[0], "program": None}
    if is_left_out:
        del open_entry["program"]
    path = written([open_entry, *entries[1:]])
    tasks = load_tasks(path, "tower", "flipit", "train")
    assert tasks.ids == ("pair-no",)
    assert [(task.id, task.program, task.target) for task in tasks.without_program] == [
        ("blue-yes", "", False),
        ("blue-no", "", True),
    ]
    with pytest.raises(ValueError, match="'blue-yes' has no program: it can be shown and annotated, but not played"):
        tasks.by_id("blue-yes")
    said = f"{path}: 1 statements of tower train have no program: they are neither played nor scored\n"
    assert capsys.readouterr().err == said
    report = check_corpus(path)
    assert report.ok
    assert "tower flipit train: 1 tasks, 1 contexts; 2 without a program, not played" in str(report)
    rows = list(task_rows([tasks]))
    assert [(row["id"], row["program"]) for row in rows[1:]] == [("blue-yes", None), ("blue-no", None)]
    path = written([open_entry])
    with pytest.raises(NoTasksError, match="has no tasks for"):
        load_tasks(path, "tower", "flipit", "train")
    assert len(load_tasks(path, "tower", "flipit", "train", needs_tasks=False).without_program) == 2
