"""Synthesized start scenes, and the random scenes they are based on."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.corpus import check_corpus, load_tasks, write_corpus
from lilgym_mp.corpus.scene_sampling import sampler_of
from lilgym_mp.corpus.synthesis import start_scenes, synthesize
from lilgym_mp.corpus.writing import flipit_entries
from lilgym_mp.programs import compile_program
from lilgym_mp.scene.appearances import APPEARANCES, make_appearance
from tests.scenes import items_apart

THREE_BLUE = "count(filter_color(all_items, Color.BLUE)) == 3"


@given(seed=st.integers(0, 10_000), appearance=st.sampled_from(sorted(APPEARANCES)))
def test_sampled_scenes__are_legal_and_not_empty_and_change_by_one_item(seed, appearance):
    rng = random.Random(seed)
    scene = sampler_of(appearance).scene(rng)
    changed = sampler_of(appearance).changed(rng, scene)
    for one in (scene, changed):
        make_appearance(appearance).check_scene(one)
        assert any(one.items())
    assert items_apart(scene, changed) == 1


def test_start_scenes__are_pairs_that_differ_by_one_item_and_truth_value(appearance):
    starts = start_scenes(THREE_BLUE, appearance, random.Random(1), count=6)
    assert [start.label for start in starts] == [True, False] * 3
    assert [start.label for start in starts] == [compile_program(THREE_BLUE)(start.scene) for start in starts]
    for true, false in zip(starts[::2], starts[1::2], strict=True):
        assert items_apart(true.scene, false.scene) == 1
    assert len({start.scene for start in starts}) == 6


@pytest.mark.parametrize(("program", "value"), [("exist(all_items)", True), ("count(all_items) > 900", False)])
def test_start_scenes__may_have_a_single_truth_value(program, value):
    starts = start_scenes(program, "tower", random.Random(1), count=4, walks=20)
    assert [start.label for start in starts] == [value] * 4


def test_start_scenes__scenes_without_a_truth_value_are_skipped():
    starts = start_scenes("is_blue(unique(filter_obj(all_items, is_top)))", "tower", random.Random(1), count=6)
    assert [sum(bool(box.items) for box in start.scene.boxes) for start in starts] == [1] * 6
    assert {start.label for start in starts} == {True, False}


def test_synthesize__yields_a_valid_corpus(entries, written, tmp_path):
    found = synthesize(written(entries), starts=2)
    path = tmp_path / "new.jsonl"
    write_corpus(path, "new", "MIT", found)
    assert check_corpus(path).ok
    tasks = load_tasks(path, "tower", "flipit", "train")
    assert tasks.ids == ("blue:1", "blue:2", "pair:1", "pair:2")
    assert [task.target for task in tasks] == [False, True, False, True]


def test_synthesize__keeps_tags(entries, written, tmp_path):
    entries[0]["tags"] = ["negation"]
    write_corpus(tmp_path / "new.jsonl", "new", "MIT", synthesize(written(entries), starts=2))
    tasks = load_tasks(tmp_path / "new.jsonl", "tower", "flipit", "train")
    assert [task.tags for task in tasks] == [("negation",)] * 2 + [()] * 2
    assert [entry.get("tags") for entry in flipit_entries(tasks)] == [["negation"], None]


def test_synthesize__scenes_depend_on_seed_and_statement_only(entries, written):
    both = list(synthesize(written(entries), ["tower"], seed=3))
    alone = list(synthesize(written(entries[1:2]), ["tower"], seed=3))
    assert alone == both[1:]
    assert alone != list(synthesize(written(entries[1:2]), ["tower"], seed=4))


def test_synthesize__duplicate_ids_are_made_unique(released):
    (released / "tower_scratch_dev.json").write_bytes((released / "tower_scratch_test.json").read_bytes())
    assert [entry["id"] for entry in synthesize(released)] == ["tower-dev-7", "tower-test-7"]
