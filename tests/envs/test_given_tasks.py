"""Tasks from callers: `Task`s in reset options, samplers, and snapshots of batches."""

import pickle
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.observation import row_of
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.testing import assert_same, check_vector_env
from lilgym_mp.wrappers import (
    potential_shaping_v0,
    statement_embedding_v0,
    structured_observation_v0,
    tokenized_statement_v0,
)

TOWER, SCATTER = "lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterFlipIt-v0"
KINDS = {
    "scalar batch": lambda id, **settings: gym.make_vec(id, num_envs=4, **settings),
    "compiled batch": lambda id, **settings: gym.make_vec(id, num_envs=9, **settings),
    "workers": lambda id, **settings: WorkerVectorEnv(id, 18, num_workers=2, **settings),
}
MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]
WORDS = ("There is a blue item.", "exist(filter_color(all_items, Color.BLUE))")


def new_task(id, appearance="tower", **fields):
    """A task that no corpus has, with the start scene of the appearance's first FlipIt task."""
    start = load_tasks("builtin", appearance, "flipit", "train")[0].start
    return replace(Task(f"mine {id}", *WORDS, True, start), **fields)


def sample_new(generator, env_id):
    """A new task, the id of a corpus's, or None; depends on the generator alone."""
    choice = int(generator.integers(3))
    statement = f"Number {generator.integers(99)}."
    tasks = load_tasks("builtin", "tower", "flipit", "train")
    return [new_task("sampled", statement=statement, target=bool(choice)), tasks[7].id, None][choice]


@pytest.fixture(params=KINDS)
def make(request):
    with ExitStack() as made:
        yield lambda id, **settings: made.enter_context(closing(KINDS[request.param](id, **settings)))


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_reset__plays_a_task_of_the_caller_like_a_single_environment(make, appearance):
    id = {"tower": TOWER, "scatter": SCATTER}[appearance]
    envs, single = make(id), gym.make(id)
    empty = new_task("empty", appearance, start=Scene.empty(), program="count(all_items) == 0")
    for task in (new_task("first", appearance), empty, new_task("third", appearance, target=False)):
        tasks = [None, *[task] * (envs.num_envs - 1)]
        observations, infos = envs.reset(seed=1, options={"task": tasks})
        observation, _ = single.reset(options={"task": task})
        assert_same(row_of(observations, -1), observation)
        assert infos["task"][-1] == task.id
        assert envs.states()[-1] == single.unwrapped.state
        assert envs.task_indices[0] < len(envs.tasks) <= envs.task_indices[-1]
        rewards = envs.step(np.zeros(envs.num_envs, np.int64))[1]
        assert rewards[-1] == single.step(0)[1]


def test_reset__accepts_one_task_of_the_corpus_for_all_environments_or_one_each(make):
    envs = make(TOWER)
    for task in (envs.tasks[3], envs.tasks.ids[3]):
        envs.reset(options={"task": task})
        assert set(envs.task_indices) == {3}
    indices = [*range(envs.num_envs)][::-1]
    envs.reset(options={"task": [envs.tasks.ids[index] for index in indices]})
    assert envs.task_indices.tolist() == indices
    assert [state.task for state in envs.states()] == [envs.tasks[index] for index in indices]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"program": "nonsense("}, "'mine x' cannot be played here: line 1"),
        ({"statement": "x" * 300}, "its statement is not in Text"),
        ({"start": load_tasks("builtin", "scatter", "flipit", "train")[0].start}, "cannot be played here"),
    ],
)
def test_reset__says_why_a_task_cannot_be_played(fields, message):
    for env in (gym.make(TOWER), gym.make_vec(TOWER, num_envs=2)):
        with pytest.raises(ValueError, match=message):
            env.reset(options={"task": new_task("x", **fields)})


def test_wrappers__encode_statements_of_new_tasks():
    for env in (gym.make(TOWER), gym.make_vec(TOWER, num_envs=2)):
        encoder = lambda statement: [len(statement), 1]  # noqa: E731
        tokens = tokenized_statement_v0(structured_observation_v0(env))
        task = new_task("long", statement="A blue blue blue item.")
        row = np.atleast_2d(tokens.reset(seed=0, options={"task": task})[0]["statement"])[-1]
        assert (row[1:4] == row[1]).all()
        assert row[1] != row[4]
        vectors = statement_embedding_v0(env, encoder).reset(seed=0, options={"task": task})[0]["statement"]
        assert np.atleast_2d(vectors)[-1].tolist() == [len(task.statement), 1]


@pytest.mark.parametrize("make_envs", [gym.make_vec, partial(WorkerVectorEnv, num_workers=2)])
@pytest.mark.long
def test_sampler__chooses_the_tasks_of_automatic_resets_too(make_envs):
    make, single = partial(make_envs, TOWER, sampler=sample_new), lambda: gym.make(TOWER, sampler=sample_new)
    check_vector_env(make, single, num_envs=4, modes=MODES, steps=15)


def test_sampler__is_told_which_environment_it_chooses_for():
    ids = load_tasks("builtin", "tower", "flipit", "train").ids
    envs = gym.make_vec(TOWER, num_envs=3, sampler=lambda generator, env_id: ids[env_id])
    assert envs.reset(seed=0)[1]["task"].tolist() == list(ids[:3])
    assert envs.reset(options={"task": ids[5]})[1]["task"].tolist() == [ids[5]] * 3


def test_sampler__must_be_a_function_and_does_not_mix_with_evaluation():
    for make in (gym.make, lambda id, **settings: gym.make_vec(id, num_envs=2, **settings)):
        with pytest.raises(ValueError, match="sampler must be a function"):
            make(TOWER, sampler="hard")
    with pytest.raises(ValueError, match="leave out sampler"):
        gym.make_vec(TOWER, num_envs=2, sampler=sample_new, evaluation=True)


def play(envs, seed, steps):
    envs.action_space.seed(seed)
    return [envs.step(envs.action_space.sample(tuple(envs.action_masks().astype(np.int8)))) for _ in range(steps)]


@pytest.mark.parametrize(
    ("id", "rules", "mode"),
    [(TOWER, "paper", AutoresetMode.NEXT_STEP), (SCATTER, "release", AutoresetMode.SAME_STEP)],
)
def test_restored_state__continues_as_before(make, id, rules, mode):
    envs = make(id, rules=rules, autoreset_mode=mode)
    envs.reset(seed=2)
    play(envs, 0, 7)
    state = envs.save_state()
    first = play(envs, 1, 15)
    envs.restore_state(state)
    assert_same(play(envs, 1, 15), first)
    other = make(id, rules=rules, autoreset_mode=mode)
    other.restore_state(pickle.loads(pickle.dumps(state)))
    assert_same(play(other, 1, 15), first)


def test_restored_state__can_be_that_of_one_environment_everywhere(make):
    envs = make(SCATTER)
    envs.reset(seed=2, options={"task": new_task("one", "scatter")})
    play(envs, 0, 3)
    states, state = envs.states(), envs.save_state()
    envs.restore_state([state[1]] * envs.num_envs)
    assert envs.states() == [states[1]] * envs.num_envs
    other = gym.make_vec(TOWER, num_envs=envs.num_envs)
    other.reset(seed=0)
    with pytest.raises(ValueError, match="cannot be played here"):
        other.restore_state(envs.save_state())
    assert other.np_random_seed == tuple(range(envs.num_envs))
    with pytest.raises(ValueError, match=r"one for each environment, not 1"):
        envs.restore_state(state[:1])


def test_restored_state__keeps_the_count_of_an_evaluation():
    envs = gym.make_vec(TOWER, num_envs=40, evaluation=True, split="dev")
    envs.reset(seed=0)
    state = envs.save_state()
    steps = 0
    while not envs.evaluation_finished:
        envs.step(np.zeros(40, np.int64))
        steps += 1
    envs.restore_state(state)
    for _ in range(steps):
        assert not envs.evaluation_finished
        envs.step(np.zeros(40, np.int64))
    assert envs.evaluation_finished


@pytest.mark.parametrize("mode", MODES)
def test_restored_state__is_seen_by_shaped_rewards(mode):
    def make():
        return potential_shaping_v0(gym.make_vec("lilgym_mp/TowerScratch-v0", num_envs=3, autoreset_mode=mode))

    envs = make()
    envs.reset(seed=0)
    envs.step(np.array([1, 0, 2]))
    state = envs.unwrapped.save_state()
    expected = [envs.step(np.full(3, action))[1] for action in (3, 0, 2)]
    envs.unwrapped.restore_state(state)
    assert_same([envs.step(np.full(3, action))[1] for action in (3, 0, 2)], expected)


def test_programs__of_many_new_tasks_are_forgotten():
    envs = gym.make_vec(TOWER, num_envs=8)
    evaluator = envs._engine.core._evaluator
    for count in range(2):
        for number in range(2 * len(evaluator._tasks) if count == 0 else 2):
            evaluator._by_source[f"{count} {number}"] = 0
        envs.reset(options={"task": new_task("x", program=f"count(all_items) == {count}")})
        assert envs.goal_reached().tolist() == [state.task.solved_by(state.scene) for state in envs.states()]
    assert len(evaluator._by_source) < 9
