"""Box permutation and the NLVR reward."""

from collections import Counter
from contextlib import closing
from functools import partial

import gymnasium as gym
import pytest

from lilgym_mp.corpus import CorpusError, load_tasks, write_corpus
from lilgym_mp.corpus.matching import matching_corpus, with_permuted_boxes
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.wrappers import (
    ActionMask,
    BoxPermutation,
    NLVRReward,
    StepsLeft,
    StopForcing,
    WrongEnvironment,
    box_permutation_v0,
)
from tests.corpora import BLACK_BLOCK, entry

STOP, ADD_LEFT_BLACK, ADD_LEFT_BLUE, ADD_MIDDLE_BLUE, ADD_RIGHT_BLUE = 0, 2, 3, 6, 9

PROGRAM = "count(all_boxes[0]) > 0"
NAMES_A_BOX = entry("left", "tower", "train", "The left box holds something.", PROGRAM, yes=[[BLACK_BLOCK], [], []])


def test_permuted__has_six_tasks_one_per_order_of_the_boxes(corpus):
    tasks = load_tasks(str(corpus), "tower", "flipit", "train")
    permuted = with_permuted_boxes(tasks)
    assert len(permuted) == 6 * len(tasks)
    start = tasks.by_id("blue-yes").start
    assert permuted.by_id("blue-yes").start == start
    assert permuted.by_id("blue-yes@201").start == start.permuted((2, 0, 1))


def test_permuted__distinct_omits_equal_scenes(corpus):
    """One filled box has three positions; two different filled boxes have six orders."""
    tasks = load_tasks(str(corpus), "tower", "flipit", "train")
    distinct = with_permuted_boxes(tasks, distinct=True)
    assert Counter(name.split("@")[0] for name in distinct.ids) == {"blue-yes": 6, "blue-no": 3, "pair-no": 3}


def test_permuted__omits_orders_that_change_the_truth(tmp_path):
    write_corpus(tmp_path / "left.jsonl", "left", "MIT", [NAMES_A_BOX])
    permuted = with_permuted_boxes(load_tasks(tmp_path / "left.jsonl", "tower", "flipit", "train"))
    assert permuted.ids == ("left-yes", "left-yes@021")


def test_changed_tasks__keep_their_tags():
    for start, change in (("flipit", with_permuted_boxes), ("scratch", matching_corpus)):
        tasks = load_tasks("builtin", "tower", start, "dev")
        changed = change(tasks)
        assert any(task.tags for task in tasks)
        assert all(task.tags == tasks.by_id(task.id.split("@")[0]).tags for task in changed)


@pytest.mark.usefixtures("official_data")
def test_permuted__official_statements_never_name_a_box():
    tasks = load_tasks("lilgym", "scatter", "flipit", "dev")
    assert len(with_permuted_boxes(tasks)) == 6 * len(tasks)
    assert len(with_permuted_boxes(tasks, distinct=True)) == 1878


def test_box_permutation__starts_in_every_order(make):
    env = BoxPermutation(make("TowerFlipIt"))
    starts = set()
    env.reset(seed=0)
    for _ in range(300):
        env.reset()
        starts.add(env.unwrapped.scene)
    assert len(starts) == 12  # six orders of "blue-yes", three of the black block alone, three of the blue one alone
    env.reset(options={"task": "pair-no@120"})
    assert [len(box.items) for box in env.unwrapped.scene.boxes] == [0, 0, 1]


@pytest.mark.parametrize(
    ("task", "actions", "is_success"),
    [
        ("blue", [ADD_LEFT_BLUE], False),
        ("blue", [ADD_LEFT_BLACK, ADD_MIDDLE_BLUE], True),
        ("blue", [ADD_MIDDLE_BLUE, ADD_LEFT_BLACK], True),
        ("blue", [ADD_LEFT_BLACK, ADD_RIGHT_BLUE], False),
        ("pair", [ADD_LEFT_BLUE, ADD_MIDDLE_BLUE], False),  # the corpus has no scene of it labelled true
    ],
)
def test_nlvr_reward__and_stop_forcing_know_scenes_of_the_corpus_alone(make, task, actions, is_success):
    """The corpus's scene labelled true for "blue": black to the left, blue in the middle."""
    env = StopForcing(NLVRReward(make("TowerScratch")))
    env.reset(options={"task": task})
    for action in actions:
        env.step(action)
    assert (env.action_masks().sum() == 1) == is_success
    _, reward, _, _, info = env.step(STOP)
    assert (reward, info["is_success"]) == (1.0 if is_success else -1.0, is_success)


def test_nlvr_reward__refuses_flipit(make):
    with pytest.raises(CorpusError, match=r"flipit.*scene matching requires Scratch tasks"):
        NLVRReward(make("TowerFlipIt"))


@pytest.mark.parametrize("wrapper", [BoxPermutation, NLVRReward])
def test_task_change__must_be_applied_before_wrappers_that_read_tasks(make, wrapper):
    with pytest.raises(WrongEnvironment, match=f"{wrapper.__name__} changes the tasks, so it must be applied before"):
        wrapper(StepsLeft(ActionMask(make("TowerScratch"))))


def test_task_change__refuses_a_sampler():
    for env in (gym.make, gym.make_vec):
        with pytest.raises(WrongEnvironment, match="which a sampler chooses"):
            box_permutation_v0(env("lilgym_mp/TowerFlipIt-v0", sampler=lambda generator, env_id: None))


def test_task_change__applies_to_batches_and_workers(corpus):
    for make in (gym.make_vec, partial(WorkerVectorEnv, num_workers=2)):
        env = box_permutation_v0(make("lilgym_mp/TowerFlipIt-v0", num_envs=6, corpus=str(corpus)))
        with closing(env):
            assert len(env.unwrapped.tasks) == 18
            tasks = env.reset(seed=1)[1]["task"]
            assert any("@" in task for task in tasks)
            starts = [env.unwrapped.tasks.by_id(task).start for task in tasks]
            assert [state.scene for state in env.unwrapped.states()] == starts
