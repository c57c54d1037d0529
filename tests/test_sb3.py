import multiprocessing
import os
from dataclasses import replace
from multiprocessing import forkserver
from types import SimpleNamespace
from unittest import mock

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as vector_wrappers

pytest.importorskip("stable_baselines3")
pytest.importorskip("sb3_contrib")

from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.utils import get_action_masks
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecFrameStack,
    VecMonitor,
)

from lilgym_mp.corpus import Vocabulary, write_corpus
from lilgym_mp.envs.preload import VARIABLE
from lilgym_mp.sb3 import BACKENDS, BatchVecEnv, LilGymPolicy, make_vec_env, recipe
from lilgym_mp.testing import assert_same
from lilgym_mp.wrappers import (
    ActionMask,
    StopForcing,
    action_mask_v0,
    box_permutation_v0,
    flat_observation_v0,
    image_observation_v0,
    stop_forcing_v0,
    structured_observation_v0,
    text_observation_v0,
    tokenized_statement_v0,
)
from lilgym_mp.wrappers.transformation import WrongEnvironment
from tests.command_line import python
from tests.corpora import BLUE

TOWER, SCATTER = "lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterFlipIt-v0"
COUNT = 4

SMALL = {"net_arch": [8], "features_extractor_kwargs": {"cnn_output_dim": 8}}

pytestmark = pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")


@pytest.fixture
def made():
    envs = []

    def make(id, backend, **settings):
        if backend == "workers":
            settings = {"num_workers": 2, **settings}
        if backend == "subproc":
            settings = {"start_method": "fork", **settings}
        envs.append(make_vec_env(id, COUNT, backend, **settings))
        return envs[-1]

    yield make
    for env in envs:
        env.close()


def test_masks__of_a_batch_cost_one_call(made):
    env = made(SCATTER, "batched", monitor=False)
    env.reset()
    with mock.patch.object(env.venv, "action_masks", side_effect=env.venv.action_masks) as masks:
        assert get_action_masks(env).shape == (COUNT, 2661)
    masks.assert_called_once()


ATTRIBUTES = ("steps", "state", "scene", "task", "tasks", "horizon", "dynamics", "render_mode", "spec")
SPACES = ("action_space", "observation_space")


@pytest.mark.parametrize(
    ("backend", "wrap"), [("batched", None), ("batched", vector_wrappers.NormalizeReward), ("workers", stop_forcing_v0)]
)
def test_attributes__are_those_of_single_environments(made, backend, wrap):
    ours, theirs = made(SCATTER, backend, seed=1, wrap=wrap), made(SCATTER, "dummy", seed=1)
    for env in (ours, theirs):
        env.reset()
        env.step(np.array([0, 1, 2, 3]))
    for name in (*ATTRIBUTES, *SPACES):
        for indices in (None, [1, 3], 2):
            values = ours.get_attr(name, indices)
            expected = theirs.get_attr(name, indices)
            assert (values, list(map(type, values))) == (expected, list(map(type, expected)))
    assert ours.get_attr("np_random_seed", indices=2) == theirs.get_attr("np_random_seed", indices=2)
    for name, arguments in {"encode_action": ([0] * 6,), "decode_action": (7,), "evaluation_tasks": ()}.items():
        assert ours.env_method(name, *arguments) == theirs.env_method(name, *arguments)
    for name in ("goal_reached", "action_masks"):
        assert_same(list(ours.env_method(name, indices=[2, 0])), theirs.env_method(name, indices=[2, 0]))
    assert ours.has_attr("steps")
    assert not any(map(ours.has_attr, ("nothing", "num_envs", "np_random", "states")))
    with pytest.raises(AttributeError, match="'explode'; choose from action_masks, goal_reached, render"):
        ours.env_method("explode")


def test_attributes__of_wrappers_can_be_read_and_set(made):
    wrap = lambda envs: vector_wrappers.RecordEpisodeStatistics(vector_wrappers.NormalizeReward(envs))  # noqa: E731
    env = made(TOWER, "batched", seed=0, wrap=wrap)
    env.reset()
    env.step(np.ones(COUNT, np.int64))
    assert env.get_attr("gamma") == [0.99] * COUNT
    assert env.get_attr("episode_lengths", indices=[1]) == [1]
    env.set_attr("gamma", 0.5)
    assert env.get_attr("gamma") == [0.5] * COUNT
    for name, indices in (("gamma", [0]), ("copy", None), ("tasks", None)):
        with pytest.raises(AttributeError, match=f"cannot set '{name}' of .* a batch"):
            env.set_attr(name, False, indices)


def test_wrapping__is_told_alike_by_all_backends(made):
    for backend in ("batched", "dummy"):
        env = made(TOWER, backend, wrap=stop_forcing_v0)
        assert env.env_is_wrapped(StopForcing) == [True] * COUNT
        assert env.env_is_wrapped(ActionMask, indices=[0]) == [False]


@pytest.mark.parametrize("mode", ["ansi", "rgb_array"])
def test_render__works_in_every_mode(made, mode):
    ours, theirs = (made(TOWER, backend, seed=1, render_mode=mode) for backend in ("batched", "dummy"))
    for env in (ours, theirs):
        env.reset()
    assert_same(ours.render(), theirs.render())
    assert_same(list(ours.env_method("render")), theirs.env_method("render"))
    described = [ours.unwrapped.metadata, *ours.get_attr("metadata"), *theirs.get_attr("metadata")]
    assert len({each["render_fps"] for each in described}) == 1


def darker(observations):
    return {**observations, "image": observations["image"] // 2}


VECTOR_WRAPPERS = {
    "rewards": vector_wrappers.NormalizeReward,
    "own key": lambda envs: vector_wrappers.RecordEpisodeStatistics(action_mask_v0(envs), stats_key="mine"),
    "lists": vector_wrappers.DictInfoToList,
    "inside": lambda envs: stop_forcing_v0(vector_wrappers.RecordEpisodeStatistics(envs)),
    "observations": lambda envs: vector_wrappers.TransformObservation(envs, darker),
}


@pytest.mark.parametrize(
    ("backend", "name"), [*(("batched", name) for name in VECTOR_WRAPPERS), ("workers", "own key")]
)
def test_gymnasiums_vector_wrappers__keep_masks_and_infos(made, backend, name):
    env, plain = made(TOWER, backend, seed=1, wrap=VECTOR_WRAPPERS[name]), made(TOWER, backend, seed=1)
    change = darker if name == "observations" else lambda observations: observations
    assert_same(env.reset(), change(plain.reset()))
    assert_same(get_action_masks(env), get_action_masks(plain))
    for action in (1, 0):
        *_, infos = env.step(np.full(COUNT, action))
        *_, expected = plain.step(np.full(COUNT, action))
    for info, other in zip(infos, expected, strict=True):
        for key in ("outcome", "is_success", "TimeLimit.truncated"):
            assert info[key] == other[key]
        assert_same(info["terminal_observation"], change(other["terminal_observation"]))
        assert info.get("mine", info["episode"])["l"] == 2
    assert env.unwrapped.reset_infos[0]["task"] == plain.unwrapped.reset_infos[0]["task"]


@pytest.mark.parametrize("backend", ["batched", "workers", "dummy"])
def test_options__are_alike_in_all_backends(made, backend, own_ids):
    env = made(TOWER, backend, corpus=own_ids)
    env.set_options({"task": 0})
    env.reset()
    assert [info["task"] for info in env.unwrapped.reset_infos] == ["0"] * COUNT
    env.set_options({"tsk": "0"})
    with pytest.raises(ValueError, match=r"\['tsk'\]; choose from task"):
        env.reset()
    task = replace(env.get_attr("tasks")[0][0], id="mine", statement="It is mine.")
    env.set_options([{"task": task}, {}, {}, {"task": "1"}])
    env.reset()
    assert [env.unwrapped.reset_infos[env_id]["task"] for env_id in (0, 3)] == ["mine", "1"]


@pytest.fixture
def own_ids(tmp_path):
    """A corpus whose tasks have the ids "0" and "1"."""
    path = tmp_path / "own.jsonl"
    starts = [start | {"id": str(number)} for number, start in enumerate(BLUE["starts"])]
    write_corpus(path, "own", "MIT", [BLUE | {"starts": starts}])
    return str(path)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_envs": 2}, "'num_envs'; use .*n_envs"),
        ({"backend": "dummy", "vec_env_kwargs": {}}, "use backend=... and its keywords"),
        ({"max_episode_steps": 5}, "use horizon=N"),
        ({"env_kwargs": {"split": "dev"}}, "use its entries as keywords"),
        ({"wrapper_class": StopForcing}, "wrap=WRAPPER"),
        ({"vec_env_cls": DummyVecEnv}, 'backend="subproc"'),
        ({"monitor_dir": "logs"}, "monitor=False"),
        ({"num_workers": 2}, 'WorkerVectorEnv.id, N, num_workers=.*, or backend="workers" for SB3'),
        ({"backend": "dummy", "evaluation": True}, "as it belongs to batches"),
        ({"backend": "subproc", "evaluation": True}, 'evaluation=True needs backend="batched"'),
        ({"nonsense": 1}, "choose from corpus, .* sampler, .*, render_mode, copy"),
        ({"backend": "threads"}, f"'threads'; choose from {', '.join(sorted(BACKENDS))}"),
        ({"n_envs": 2.0}, "not 2.0"),
        ({"observation": "text"}, "Stable-Baselines3 has no Text spaces; use observation="),
        ({"wrap": text_observation_v0}, "Stable-Baselines3 has no Text spaces; use observation="),
        ({"same_statement": 2, "backend": "dummy"}, 'same_statement=2 needs backend="batched" or backend="workers"'),
        ({"recolour": True, "split": "dev"}, "of split 'train', not 'dev'"),
        ({"empty_starts": 1.5}, "at least 0 and at most 0.9, not 1.5"),
        (
            {"evaluation": True, "same_statement": 16, "recolour": True},
            r'backend="batched".*leave out same_statement=16, recolour=True$',
        ),
    ],
)
def test_make__names_the_choices_or_what_replaces_keywords_of_others(settings, message):
    with pytest.raises((TypeError, ValueError), match=message):
        make_vec_env(**{"id": TOWER, "n_envs": 2, **settings})
    assert not multiprocessing.active_children()


def test_batch__must_leave_resets_to_the_adapter():
    with pytest.raises(ValueError, match=r"BatchVecEnv needs autoreset_mode=.*DISABLED.*, not .*NEXT_STEP"):
        BatchVecEnv(gym.make_vec(TOWER, num_envs=2, autoreset_mode=AutoresetMode.NEXT_STEP))


@pytest.mark.parametrize("backend", ["batched", "workers"])
def test_results__may_be_modified_by_the_caller(made, backend):
    changed, kept = (made(TOWER, backend, seed=1, monitor=False) for _ in range(2))  # which would add times
    observations, infos, expected = changed.reset(), [], kept.reset()
    for action in (1, 0, 2, 0, 0):
        assert_same(observations, expected)
        for observation in (observations, *(info["terminal_observation"] for info in infos if info)):
            observation["image"][...] = observation["statement"][...] = 77
        for info in infos:
            info["mine"] = True
        observations, *_, infos = changed.step(np.full(COUNT, action))
        expected, *_, same_infos = kept.step(np.full(COUNT, action))
        assert_same(list(infos), list(same_infos))


@pytest.mark.parametrize(("backend", "unmonitored"), [("batched", BatchVecEnv), ("dummy", DummyVecEnv)])
def test_monitor__can_be_switched_off(made, backend, unmonitored):
    assert isinstance(made(TOWER, backend), VecMonitor)
    assert isinstance(made(TOWER, backend, monitor=False), unmonitored)


@pytest.mark.parametrize("backend", BACKENDS)
def test_failing_wrapper__is_reported_and_leaves_no_process(made, backend):
    with pytest.raises(ValueError, match="/no/such/file"):
        made(TOWER, backend, vocabulary="/no/such/file")
    assert not multiprocessing.active_children()


def test_model__loads_across_backends_and_names_both_spaces_otherwise(made, tmp_path):
    model = MaskablePPO("MultiInputPolicy", made(TOWER, "batched"), n_steps=2, batch_size=2, policy_kwargs=SMALL)
    model.save(tmp_path / "model.zip")
    MaskablePPO.load(tmp_path / "model.zip", env=gym.make(TOWER, observation="arrays"))
    with pytest.raises(ValueError, match=r"Observation spaces do not match: .*\(44,\).*\(40,\)"):
        MaskablePPO.load(tmp_path / "model.zip", env=made(TOWER, "batched", length=40))


@pytest.mark.parametrize("count", [8, 151])
def test_evaluation__counts_every_task_once(count):
    env = make_vec_env(TOWER, count, split="dev", evaluation=True)
    playing = []  # by environment
    counted = []

    def stop(observations, **_):
        playing[:] = [info["task"] for info in env.unwrapped.reset_infos]
        return np.zeros(count, np.int64), None

    def note(variables, _):
        counted.append(playing[variables["i"]])

    model, tasks = SimpleNamespace(predict=stop), env.get_attr("tasks")[0]
    rewards, _ = evaluate_policy(model, env, len(tasks), callback=note, return_episode_rewards=True)
    expected = {task.id: 1 if task.solved_by(task.start) else -1 for task in tasks}
    assert len(counted) == len(tasks)
    assert dict(zip(counted, rewards, strict=True)) == expected
    env.close()


def test_wrap__a_gymnasium_wrapper_needs_a_backend_of_single_environments(made):
    wrap = lambda env: gym.wrappers.TransformReward(env, lambda reward: 2 * reward)  # noqa: E731
    with pytest.raises(ValueError, match=r'use a factory of lilgym_mp.wrappers, or backend="subproc" or "dummy"'):
        made(TOWER, "batched", wrap=wrap)
    env = made("lilgym_mp/TowerScratch-v0", "dummy", wrap=wrap)  # where a first block can always be added
    env.reset()
    assert env.step(np.ones(COUNT, np.int64))[1][0] == pytest.approx(-0.2)


@pytest.mark.long
@pytest.mark.parametrize("backend", ["batched", "dummy"])
def test_stop_forcing__is_added_outside_of_other_wrappers(made, backend):
    wrap = lambda env: structured_observation_v0(box_permutation_v0(env))  # noqa: E731
    assert "forced" in made(TOWER, backend, wrap=wrap, stop_forcing=True).observation_space.spaces
    for wrap in (image_observation_v0, lambda env: flat_observation_v0(structured_observation_v0(env))):
        with pytest.raises(WrongEnvironment, match="StopForcing needs Dict observations"):
            made(TOWER, backend, wrap=wrap, stop_forcing=True)


def test_make__other_keywords_name_the_choices_or_what_replaces_those_of_the_release():
    for make in (gym.make, gym.make_vec):
        for name, advice in (("data", "use corpus=PATH"), ("splt", "choose from corpus, split")):
            with pytest.raises(TypeError, match=f"'{name}'; {advice}"):
                make(TOWER, **{name: "data"})


@pytest.mark.long
def test_subproc__processes_of_a_fork_server_start_with_torch_and_corpus(made):
    env = made(TOWER, "subproc", start_method="forkserver")
    assert VARIABLE not in os.environ
    assert forkserver._forkserver._preload_modules == ["__main__"]
    assert env.reset()["image"].shape[0] == COUNT


ALREADY_FORKING = """
import multiprocessing
if __name__ == "__main__":
    process = multiprocessing.get_context("forkserver").Process(target=print)
    process.start()
    process.join()
    from lilgym_mp.sb3 import make_vec_env
    env = make_vec_env("lilgym_mp/TowerScratch-v0", 1, "subproc", start_method="forkserver")
    print(sorted(env.reset()))
    env.close()
"""


@pytest.mark.long
def test_subproc__starts_from_a_fork_server_that_has_not_imported_the_package(tmp_path):
    (tmp_path / "script.py").write_text(ALREADY_FORKING)
    done = python("script.py", cwd=tmp_path)
    assert "'image'" in done.stdout, done.stderr


def test_same_statement__over_workers_that_split_the_groups_warns():
    with pytest.warns(UserWarning, match="same_statement=8: 2 workers split groups"):
        make_vec_env(TOWER, 24, "workers", num_workers=2, same_statement=8).close()


def test_policy__refuses_scaled_images():
    settings, seen = recipe("TowerFlipIt"), make_vec_env(TOWER).observation_space
    space = spaces.Dict({**seen.spaces, "image": spaces.Box(0, 1, (50, 190, 3), np.float32)})
    with pytest.raises(ValueError, match="leave it out of VecNormalize"):
        LilGymPolicy(space, spaces.Discrete(13), lambda _: 1e-3, **settings.model["policy_kwargs"])


def test_policy__refuses_token_ids_of_as_many_other_words(tmp_path):
    training = recipe("TowerFlipIt")
    words = training.model["policy_kwargs"]["words"]
    others = Vocabulary((*words[1:], "zebra"))
    env, other = (make_vec_env(TOWER, vocabulary=chosen) for chosen in (Vocabulary(words), others))
    with pytest.raises(ValueError, match=r"other words .* make the environment with vocabulary="):
        LilGymPolicy(other.observation_space, env.action_space, lambda _: 1e-3, **training.model["policy_kwargs"])
    model = MaskablePPO(env=env, **training.model)
    model.save(tmp_path / "own.zip")
    assert MaskablePPO.load(tmp_path / "own.zip", env=env).observation_space["statement"].vocabulary.words == words
    with pytest.raises(ValueError, match="Observation spaces do not match"):
        MaskablePPO.load(tmp_path / "own.zip", env=other)


@pytest.mark.parametrize("wrap", [None, tokenized_statement_v0])
@pytest.mark.parametrize("backend", BACKENDS)
def test_vocabulary__can_be_read_in_every_backend(made, backend, wrap):
    env = made(TOWER, backend, wrap=wrap, observation="text" if wrap else "arrays")
    (words,) = {vocabulary.words for vocabulary in env.get_attr("vocabulary")}
    assert words == env.observation_space["statement"].vocabulary.words


def test_policy__sees_every_change_of_its_weights():
    settings, env = recipe("TowerFlipIt"), make_vec_env(TOWER, seed=0)
    policies = [
        LilGymPolicy(env.observation_space, env.action_space, lambda _: 1e-3, **settings.model["policy_kwargs"])
        for _ in range(2)
    ]
    observations = {name: torch.as_tensor(part) for name, part in env.reset().items()}
    ours, fresh = (policy.eval() for policy in policies)

    @torch.no_grad()
    def assert_equal_values():
        fresh.network.clear_cache()
        values = [policy.predict_values(observations) for policy in policies]
        assert torch.allclose(*values, atol=1e-5)

    ours.predict_values(observations)
    ours.load_from_vector(fresh.parameters_to_vector())
    assert_equal_values()
    with torch.no_grad():
        for one, other in zip(ours.parameters(), fresh.parameters(), strict=True):
            one.mul_(1.5)
            other.copy_(one)
    assert_equal_values()
    part = {name: value / 2 for name, value in ours.state_dict().items() if "boxes" in name}
    for policy in policies:
        policy.load_state_dict(part, strict=False)
    assert_equal_values()


def test_vec_frame_stack__accepts_a_batch(made):
    stacked = VecFrameStack(made(TOWER, "batched", seed=0), 2)
    assert stacked.reset()["statement"].shape == (COUNT, 2 * stacked.venv.observation_space["statement"].shape[0])
