"""Generated corpora: `corpus="generated:LEVEL"`."""

import hashlib
import json
import random
from concurrent.futures import ThreadPoolExecutor

import pytest

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.corpus import CorpusError, contexts, load_tasks
from lilgym_mp.corpus.generator import generated_entries, load_generated, split_of
from lilgym_mp.corpus.generator.generated_corpus import MAX_TRIVIAL_SHARE, MAX_WORDINGS, SPLIT_SIZES
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.corpus.tokens import normalised
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.appearances import make_appearance
from tests.scenes import items_apart


@pytest.mark.long
def test_load_scratch__has_the_documented_number_of_distinct_statements(appearance):
    tasks = load_tasks("generated:2", appearance, "scratch", "dev")
    assert len({normalised(task.statement) for task in tasks}) == len(tasks) == SPLIT_SIZES["dev"]
    assert all(task.target and not any(task.start.items()) for task in tasks)
    wordings = [sum(other.program == task.program for other in tasks) for task in tasks]
    assert max(wordings) <= MAX_WORDINGS
    assert sum(task.solved_by(task.start) for task in tasks) <= MAX_TRIVIAL_SHARE * len(tasks) + 1


@pytest.mark.long
def test_load_flipit__has_two_pairs_of_a_true_and_a_false_start_scene_one_item_apart_per_statement(appearance):
    tasks = load_tasks("generated:2", appearance, "flipit", "dev")
    assert len(tasks) == 4 * SPLIT_SIZES["dev"]
    assert contexts(tasks) == 2 * SPLIT_SIZES["dev"]
    assert not any(task.solved_by(task.start) for task in tasks)
    assert len({task.statement for task in tasks[::4]}) == SPLIT_SIZES["dev"]
    for one, other in zip(tasks[::2], tasks[1::2], strict=True):
        assert (one.statement, one.target, other.target) == (other.statement, False, True)
        assert items_apart(one.start, other.start) == 1


@pytest.mark.long
def test_load__is_deterministic_in_the_name_built_once_for_all_threads_and_varies_with_the_seed():
    first = load_tasks("generated:2", "tower", "flipit", "dev")
    generated_entries.cache_clear()
    load_generated.cache_clear()
    with ThreadPoolExecutor(8) as threads:  # which build the task set once
        again, *same = threads.map(lambda _: load_tasks("generated:2:0", "tower", "flipit", "dev"), range(8))
    assert all(tasks is again for tasks in same)
    assert generated_entries.cache_info().misses == 1
    other = load_tasks("generated:2:1", "tower", "flipit", "dev")
    assert tuple(first) == tuple(again)
    assert first.provenance.sha256 == again.provenance.sha256 != other.provenance.sha256
    assert {task.statement for task in first} != {task.statement for task in other}


@pytest.mark.long
def test_load__tasks_stay_the_same():
    tasks = [
        (task.statement, task.program, task.start.to_json())
        for task in load_tasks("generated:2", "tower", "flipit", "dev")
    ]
    digest = hashlib.sha256(json.dumps(tasks).encode()).hexdigest()
    assert digest == "a6509bf35e20d4172c4c5497a9fef1ed09187093ff048c63bc25badde0d9ebd8", (
        "users name generated corpora by level and seed"
    )


@pytest.mark.long
def test_splits__share_no_meaning():
    for split in ("dev", "test"):
        tasks = load_tasks("generated:2", "tower", "scratch", split)
        assert {split_of(task.program, "tower") for task in tasks} == {split}


def test_split_of__equivalent_programs_share_a_split():
    blue = [f"count(filter_color(all_items, Color.{colour})) == 2" for colour in ("BLUE", "BLACK", "YELLOW")]
    same = [program.replace("== 2", "> 1") + " and " + program.replace("== 2", "< 3") for program in blue]
    assert list(map(split_of, blue, ["tower"] * 3)) == list(map(split_of, same, ["tower"] * 3))
    assert split_of("count(all_items) > 900", "tower") == "train"


@pytest.mark.parametrize(
    ("corpus", "message"),
    {
        "generated": '"generated:LEVEL" or "generated:LEVEL:SEED"',
        "generated:2:1:4": '"generated:LEVEL"',
        "generated:2:-1": '"generated:LEVEL"',
        "generated:6": "6; choose from 1, 2, 3, 4, 5",
    }.items(),
)
def test_load__rejects_malformed_names(corpus, message):
    with pytest.raises(CorpusError, match=message):
        load_tasks(corpus, "tower", "scratch", "train")


def test_scene_pool__successors_are_one_legal_edit_apart(appearance):
    pool = ScenePool.sample(appearance, random.Random(4), 4)
    dynamics = make_dynamics(make_appearance(appearance))
    for expansion in (expansion for walk in pool.walks for expansion in walk[:2]):
        task = Task("", "", "exist(all_items)", True, expansion.scene)
        state = dynamics.start(task)
        legal = dynamics.legal_mask(state).nonzero()[0][1:]
        reached = {dynamics.step(state, dynamics.appearance.decode(int(index))).state.scene for index in legal}
        assert set(expansion.successors) <= reached


def test_scene_pool__scenes_from_empty_are_in_reach_of_the_horizon(appearance):
    pool = ScenePool.sample(appearance, random.Random(4), 12)
    counts = {sum(1 for _ in scene.items()) for scene in pool.from_empty()}
    assert {0, 1, 2} < counts
    assert max(counts) < make_dynamics(make_appearance(appearance)).horizon
