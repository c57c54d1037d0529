"""Evaluation plays every task exactly once per pass, deterministically."""

from dataclasses import replace

import numpy as np
import pytest

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.evaluation import (
    Policy,
    Settings,
    evaluate,
    random_legal,
    random_unmasked,
)
from lilgym_mp.evaluation.runs import play_tasks
from lilgym_mp.scene import Colour
from lilgym_mp.scene.actions import ActionError, AddBlock, Stop
from lilgym_mp.scene.appearances import InvalidReason

TOWER = Settings("TowerScratch")
STOP, ADD_BLUE_LEFT = 0, 3  # indices of Tower's actions


def always(action):
    """A policy that always takes the same action."""
    return lambda observations, legal, rng: np.full(len(legal), action)


def test_settings__is_another_name_of_env_config():
    assert Settings is EnvConfig


@pytest.mark.parametrize(
    ("configuration", "passes", "batch_size"),
    [("TowerScratch", 1, 7), ("ScatterFlipIt", 2, 64), ("TowerFlipIt", 1, 1000)],
)
def test_evaluate__plays_every_task_once_per_pass_in_file_order(configuration, passes, batch_size):
    settings = Settings(configuration)
    episodes = evaluate(random_unmasked, settings, "dev", passes=passes, batch_size=batch_size)
    assert [episode.task for episode in episodes] == [*settings.make("dev").evaluation_tasks()] * passes


def test_evaluate__episodes_depend_on_the_seed():
    one, same, other = (evaluate(random_legal, TOWER, "dev", seed=seed) for seed in (3, 3, 4))
    assert one == same != other


def test_evaluate__episode_has_outcome_reward_and_actions():
    episode = evaluate(always(ADD_BLUE_LEFT), TOWER, "dev")[0]  # the fifth block exceeds the box
    task = TOWER.make("dev").tasks[0]
    assert (episode.task, episode.statement, episode.target) == (task.id, task.statement, True)
    assert (episode.outcome, episode.invalid_reason) == (Outcome.INVALID_ACTION, InvalidReason.FULL_TOWER)
    assert episode.actions == (AddBlock(0, Colour.BLUE),) * 5
    assert episode.reward == pytest.approx(-1.4)


def test_evaluate__policies_get_the_environments_observations():
    seen = []

    def store(observations, legal, rng):
        seen.append(observations)
        return np.zeros(len(legal), np.int64)

    env = TOWER.make("dev")
    evaluate(store, TOWER, "dev", batch_size=10)
    first, _ = env.reset(options={"task": env.evaluation_tasks()[0]})
    sizes = [len(observations.statements) for observations in seen]
    assert sizes == [len(observations.images) for observations in seen]
    assert (sum(sizes), max(sizes)) == (len(env.evaluation_tasks()), 10)
    assert np.array_equal(seen[0].images[0], first["image"])
    assert (seen[0].statements[0], seen[0].targets[0]) == (first["statement"], first["target"])


@pytest.mark.parametrize("numbers", [{"passes": 0}, {"batch_size": 0}])
def test_evaluate__rejects_zero_passes_and_environments(numbers):
    with pytest.raises(ValueError, match="at least 1, not"):
        evaluate(random_legal, TOWER, "dev", **numbers)


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        (3, r"actions must be 2 whole numbers, one for each environment, not int64 of shape \(\)"),
        (np.array([3.9, 3.9]), r"not float64 of shape \(2,\)"),
        ([[3, 3]], r"not int64 of shape \(1, 2\)"),
        (np.array([3, 99]), "action 99 of environment 1 is out of range"),
    ],
)
def test_evaluate__rejects_actions_that_step_rejects(actions, said):
    with pytest.raises(ActionError, match=said):
        evaluate(lambda observations, legal, rng: actions, TOWER, "dev", batch_size=2)


def test_evaluate__policies_get_step_and_episode_index():
    steps = {}

    def stopping_at_the_third(observations, legal, rng):
        for step, episode in zip(observations.steps.tolist(), observations.episodes.tolist(), strict=True):
            steps.setdefault(episode, []).append(step)
        return np.where(observations.steps == 2, STOP, ADD_BLUE_LEFT)

    episodes = evaluate(stopping_at_the_third, TOWER, "dev", passes=2, batch_size=9)
    assert steps == {index: [0, 1, 2] for index in range(len(episodes))}
    assert {episode.actions for episode in episodes} == {(*[AddBlock(0, Colour.BLUE)] * 2, Stop())}


def test_evaluate__a_policy_that_needs_no_masks_gets_none():
    class Stopping(Policy):
        needs_masks = False

        def __call__(self, observations, legal, rng):
            assert legal.shape == (len(observations.statements), 0)
            return np.zeros(len(legal), np.int64)

    assert evaluate(Stopping(), TOWER, "dev") == evaluate(always(STOP), TOWER, "dev")


def test_random_legal__is_uniform_over_legal_actions():
    legal = np.tile([True, False, True, True, False], (6000, 1))
    drawn = np.bincount(random_legal(None, legal, np.random.default_rng(0)), minlength=5)
    assert drawn[[1, 4]].sum() == 0
    assert drawn[[0, 2, 3]] == pytest.approx([2000] * 3, abs=200)


def test_play_tasks__plays_tasks_that_are_not_of_the_split_in_more_environments_than_tasks():
    settings = Settings("TowerFlipIt")
    envs = settings.make_batch("dev", 3)
    own = replace(envs.tasks[0], id="my own", target=not envs.tasks[0].target)
    played = play_tasks(random_legal, envs, [own, envs.tasks[1].id], np.random.default_rng(0))
    found = [(episode.task, episode.target) for episode in played]
    assert found == [(task.id, task.target) for task in (own, envs.tasks[1])]
