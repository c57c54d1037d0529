"""A policy of one's own behind wrappers is evaluated on every task once, and recorded."""

import pkgutil

import pytest
from gymnasium.wrappers.vector import DictInfoToList

from lilgym_mp.evaluation import Settings, evaluate, evaluate_wrapped
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.wrappers import flat_observation_v0, stop_forcing_v0, structured_observation_v0
from tests.command_line import error_of

SETTINGS = Settings("TowerFlipIt")


def last_legal(_, legal):
    return legal.shape[1] - 1 - legal[:, ::-1].argmax(1)


@pytest.mark.parametrize("num_envs", [7, 1000])
@pytest.mark.long
def test_own_policy__plays_every_task_once_as_evaluate_does(num_envs):
    wrap = lambda envs: flat_observation_v0(structured_observation_v0(envs))  # noqa: E731
    result = evaluate_wrapped(last_legal, SETTINGS, wrap=wrap, num_envs=num_envs, observation="arrays")
    episodes = evaluate(lambda seen, legal, rng: last_legal(seen, legal), SETTINGS, "dev")
    assert result.episodes == episodes
    assert result.summary.outcomes["horizon"] > 0.5


def test_own_policy__is_recorded_as_it_played_inside_its_wrappers(tmp_path):
    forcing = lambda envs: DictInfoToList(stop_forcing_v0(envs, "replace", allow_evaluation=True))  # noqa: E731
    result = evaluate_wrapped(last_legal, SETTINGS, wrap=forcing, name="mine", record=tmp_path)
    (file,) = tmp_path.glob("*.jsonl.gz")
    recording = read_episodes(file)
    assert recording.header.agent == "mine"
    assert [episode.actions for episode in recording.episodes] == [episode.actions for episode in result.episodes]
    assert result.summary.outcomes["success"] > 0
    assert {str(episode.actions[-1]) for episode in result.episodes if episode.is_success} == {"Stop()"}


@pytest.mark.parametrize("algorithm", ["stable_baselines3.PPO", "sb3_contrib.MaskablePPO"])
def test_evaluate__of_a_model_with_another_policy_names_the_function(algorithm, tmp_path, capsys):
    pytest.importorskip("sb3_contrib")
    from lilgym_mp.sb3 import make_vec_env

    chosen = pkgutil.resolve_name(algorithm)
    env = make_vec_env(SETTINGS.id, wrap=lambda envs: flat_observation_v0(structured_observation_v0(envs)))
    chosen("MlpPolicy", env, n_steps=2, batch_size=2, policy_kwargs={"net_arch": [4]}).save(tmp_path / "own.zip")
    (line,) = error_of(capsys, f"evaluate {tmp_path / 'own.zip'} --trust").splitlines()
    assert "lilgym_mp.evaluation.evaluate_wrapped" in line
