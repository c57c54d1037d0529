"""The policy, the buffer, the sampler and the recipe for Stable-Baselines3."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("sb3_contrib")

import torch
from sb3_contrib import MaskablePPO
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.utils import obs_as_tensor
from stable_baselines3.common.vec_env import VecNormalize

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.workers import WorkerVectorEnv
from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.model_file import save_model
from lilgym_mp.learning.common.statement_sampler import StatementSampler
from lilgym_mp.sb3 import EntropySchedule, StatementRolloutBuffer, agent_of, make_vec_env, recipe
from lilgym_mp.testing import assert_same
from tests.command_line import error_of, output_of

SCRATCH, FLIPIT = "lilgym_mp/TowerScratch-v0", "lilgym_mp/TowerFlipIt-v0"
COUNT = 8
STOP = 0


def small_model(algorithm=MaskablePPO, configuration="TowerScratch", **changes):
    """An untrained model over COUNT environments with the recipe, but tiny rollouts."""
    settings = recipe(configuration)
    grouped = {} if changes.get("backend", "batched") in ("dummy", "subproc") else {"same_statement": 4}
    env = make_vec_env(**settings.env | {"n_envs": COUNT, "same_statement": 1} | grouped | changes, seed=0)
    return algorithm(env=env, seed=0, **settings.model | {"n_steps": 4, "batch_size": 16})


@pytest.fixture(scope="module")
def trained():
    model = small_model().learn(64, EntropySchedule(0.5, 0.1))
    yield model
    model.env.close()


def test_training__changes_the_weights_and_the_entropy_coefficient(trained):
    before, after = small_model().policy.state_dict(), trained.policy.state_dict()
    assert not torch.equal(before["network.value.weight"], after["network.value.weight"])
    assert trained.ent_coef == pytest.approx(0.3)  # at the start of the second of two rollouts


@pytest.mark.long
@pytest.mark.parametrize(
    ("algorithm", "configuration", "changes"),
    [
        (MaskablePPO, "TowerFlipIt", {"wrap": None}),
        (PPO, "ScatterFlipIt", {"recolour": False}),
        (PPO, "TowerFlipIt", {"stop_forcing": False, "backend": "dummy"}),
        (MaskablePPO, "TowerFlipIt", {"stop_forcing": False, "backend": "workers"}),
        (MaskablePPO, "TowerFlipIt", {"wrap": None, "backend": "subproc", "n_envs": 4}),
    ],
)
def test_training__works_with_every_backend_from_images_and_items(algorithm, configuration, changes):
    model = small_model(algorithm, configuration, **changes)
    model.learn(32)
    assert model.num_timesteps == 32
    model.env.close()


def test_evaluation_callback_and_reward_normalisation__work(tmp_path):
    settings = recipe("TowerScratch")
    options = {"n_envs": 4, "vocabulary": settings.env["vocabulary"], "wrap": settings.env["wrap"]}
    env = VecNormalize(make_vec_env(**settings.env | options | {"same_statement": 2}, seed=0), norm_obs=False)
    dev = VecNormalize(make_vec_env(SCRATCH, split="dev", **options), norm_obs=False, norm_reward=False, training=False)
    model = PPO(env=env, **settings.model | {"n_steps": 4, "batch_size": 16})
    callback = EvalCallback(dev, n_eval_episodes=4, eval_freq=4, best_model_save_path=str(tmp_path), verbose=0)
    model.learn(16, callback)
    PPO.load(tmp_path / "best_model.zip")


def test_saved_model__chooses_the_same_actions_from_items_images_and_text(trained, tmp_path):
    trained.save(tmp_path / "model.zip")
    loaded = MaskablePPO.load(tmp_path / "model.zip")
    env = make_vec_env(SCRATCH, 4, vocabulary=recipe("TowerScratch").env["vocabulary"], seed=1)
    texts = gym.make_vec(SCRATCH, num_envs=4)
    arrays, (texts_now, _) = env.reset(), texts.reset(seed=1)
    expected, _ = trained.predict(arrays, deterministic=True)
    for model in (trained, loaded):
        assert_same(model.predict(texts_now, deterministic=True)[0], expected)
        one = {name: values[2] for name, values in texts_now.items()}
        assert model.predict(one, deterministic=True)[0] == expected[2]
    masks = np.zeros((4, 13), np.bool_)
    masks[:, 5] = True
    assert_same(loaded.predict(arrays, action_masks=masks)[0], np.full(4, 5))


def test_forced_stops__have_the_log_probability_of_the_unforced_policy(trained):
    assert trained.env is not None
    inputs = obs_as_tensor(trained.env.reset(), trained.device)
    inputs["forced"] = torch.ones_like(inputs["forced"])
    actions, _, log_probs = trained.policy(inputs)
    assert actions.tolist() == [STOP] * COUNT
    del inputs["forced"]
    _, unforced, _ = trained.policy.evaluate_actions(inputs, actions)
    assert torch.allclose(log_probs, unforced, atol=1e-5)
    assert (log_probs < 0).all()


def test_buffer__groups_statements_scales_advantages_and_keeps_the_return_of_forced_stops():
    model = small_model()
    buffer = StatementRolloutBuffer(4, model.observation_space, model.action_space, n_envs=COUNT)
    rng, observations = np.random.default_rng(0), model.env.reset()
    values, log_probs = torch.full((COUNT,), 0.5), torch.zeros(COUNT)
    for step in range(4):
        observations["statement"][:] = (np.arange(COUNT)[:, None] + step) % 4 + 2  # four statements
        observations["forced"][:] = step == 2
        actions = np.arange(COUNT) + COUNT * step
        buffer.add(observations, actions, rng.random(COUNT), np.zeros(COUNT), values, log_probs)
    buffer.compute_returns_and_advantage(torch.zeros(COUNT), np.zeros(COUNT))
    assert buffer.advantages.std() == pytest.approx(1)
    spreads = np.ptp(buffer.advantages / buffer.returns, axis=1)
    assert spreads[2] == pytest.approx(0, abs=1e-5)
    assert spreads[1] > 0.01
    batches = list(buffer.get(8))
    assert [len(torch.unique(batch.observations["statement"][:, 0])) for batch in batches] == [1] * 4
    assert {int(action) for batch in batches for action in batch.actions} == set(range(4 * COUNT))
    model.env.close()


def test_policy__names_both_sizes_if_the_environment_has_another_vocabulary():
    settings = recipe("TowerScratch")
    env = make_vec_env(SCRATCH, 2, vocabulary=settings.env["vocabulary"], wrap=None)
    changes = {"batch_size": 16, "policy_kwargs": settings.model["policy_kwargs"] | {"words": ("a", "box")}}
    with pytest.raises(ValueError, match=r"have \(13, 4\) actions and token ids, the environment \(13, "):
        PPO(env=env, **settings.model | changes)


# Agents


def test_agent__plays_as_the_model_and_as_its_model_file(trained, tmp_path):
    agent = agent_of(trained)
    assert agent.description.details["mask"]
    save_model(tmp_path / "agent.safetensors", agent.description, agent.network.state_dict())
    settings = Settings("TowerScratch")
    played, again = (
        evaluate(one.policy(settings), settings, "dev") for one in (agent, open_agent(tmp_path / "agent.safetensors"))
    )
    assert played == again
    env = settings.make("dev")
    for episode in played[:5]:
        observation, _ = env.reset(options={"task": episode.task})
        chosen, _ = trained.predict(observation, deterministic=True, action_masks=env.action_masks())
        assert env.dynamics.appearance.decode(int(chosen)) == episode.actions[0]


def test_agent__needs_our_policy():
    model = PPO("MlpPolicy", "CartPole-v1")
    with pytest.raises(AgentError, match="not those with a ActorCriticPolicy"):
        agent_of(model)


def test_evaluate__plays_a_trusted_model(trained, tmp_path, capsys):
    path = tmp_path / "model.zip"
    trained.save(path)
    command = f"evaluate {path} --alone"
    assert f"{path} contains pickles: loading it can run any code" in error_of(capsys, command)
    assert "by Stable-Baselines3" in output_of(capsys, f"{command} --trust --actions greedy")
    path.write_text("no model")
    assert f"{path}: cannot be loaded as a model with a LilGymPolicy" in error_of(capsys, f"{command} --trust")


# Tasks


def statements_of(id, workers, times, **options):
    """By time: the statement that each of two groups' environments plays, when each STOPs at once."""
    sampler = StatementSampler(id, same_statement=4, **options)
    envs = WorkerVectorEnv(id, COUNT, workers, sampler=sampler, autoreset_mode="SameStep")
    stops = [np.zeros(COUNT, np.int64)] * (times - 1)
    observations = [envs.reset(seed=0)[0], *(envs.step(stop)[0] for stop in stops)]
    envs.close()
    return [list(observation["statement"]) for observation in observations]


@pytest.mark.parametrize(("workers", "episodes"), [(1, 3), (2, 2)])
def test_sampler__a_group_plays_one_statement_for_some_episodes_of_each(workers, episodes):
    rows = statements_of(SCRATCH, workers, 3 * episodes, statement_episodes=episodes)
    assert all(row == [row[0]] * 4 + [row[4]] * 4 for row in rows)
    firsts = [row[0] for row in rows]
    assert firsts == [statement for statement in dict.fromkeys(firsts) for _ in range(episodes)]
    assert len(firsts) == 3 * episodes


@pytest.mark.long
def test_sampler__is_the_same_in_a_batch_and_in_workers():
    one, other = (statements_of(FLIPIT, workers, 7, recolour=True, empty_starts=0.5) for workers in (1, 2))
    assert one == other


@pytest.mark.long
def test_sampler__draws_recoloured_and_empty_starts():
    sampler = StatementSampler("TowerFlipIt", recolour=True, empty_starts=0.25)
    original = {task.statement for task in load_tasks("builtin", "tower", "flipit", "train")}
    rng = np.random.default_rng(0)
    tasks = [sampler.tasks.by_id(sampler(rng, 0)) for _ in range(1_000)]
    assert 0.2 < np.mean([not any(task.start.items()) for task in tasks]) < 0.3
    assert 0.3 < np.mean([task.statement not in original for task in tasks]) < 0.9
    words = {word for task in tasks for word in task.statement.lower().split() if word.isalpha()}
    assert words <= {*sampler.vocabulary.words}
