"""Rewards shaped by the expert, and starts near the goal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import pytest

from lilgym_mp.envs.proposer_verifier import AGENTS
from lilgym_mp.solver import Expert
from lilgym_mp.wrappers import (
    PotentialShaping,
    ReverseCurriculum,
    WrongEnvironment,
    potential_shaping_v0,
    reverse_curriculum_v0,
)

STOP, ADD_LEFT_YELLOW = 0, 1  # of tower's actions


Make = Callable[..., gym.Env[Any, Any]]


@pytest.fixture
def make(corpus: str) -> Make:
    """`make("TowerScratch", horizon=3)`: an environment over the small corpus."""

    def make_env(configuration: str, **settings: Any) -> gym.Env[Any, Any]:
        return gym.make(f"lilgym_mp/{configuration}-v0", corpus=corpus, **settings)

    return make_env


@pytest.fixture
def make_batch(corpus: str) -> Callable[[str], Any]:
    return lambda configuration: gym.make_vec(f"lilgym_mp/{configuration}-v0", num_envs=2, corpus=corpus)


@pytest.mark.parametrize("configuration", ["TowerFlipIt", "ScatterScratch"])
def test_shaping__gives_zero_reward_along_shortest_solutions(make: Make, configuration: str):
    env = PotentialShaping(make(configuration))
    expert = Expert(env)
    for seed in range(5):
        env.reset(seed=seed)
        ended = False
        while not ended:
            _, reward, terminated, truncated, info = env.step(expert.act())
            ended = terminated or truncated
            assert reward == pytest.approx(0)
        assert info["unshaped_reward"] == 1


@pytest.mark.parametrize("discount", [1.0, 0.9])
def test_shaping__shifts_every_return_by_the_starts_potential(make: Make, discount: float):
    def discounted_return(actions: list[int]) -> tuple[float, float]:
        """The returns of one episode, shaped and not."""
        env = PotentialShaping(make("TowerScratch"), discount)
        env.reset(seed=4)
        shaped = plain = 0.0
        for step, action in enumerate(actions):
            _, reward, terminated, truncated, info = env.step(action)
            shaped += discount**step * float(reward)
            plain += discount**step * info["unshaped_reward"]
        assert terminated or truncated
        return shaped, plain

    differences = [
        shaped - plain
        for shaped, plain in map(discounted_return, ([STOP], [ADD_LEFT_YELLOW, STOP], [ADD_LEFT_YELLOW] * 5))
    ]
    assert differences == pytest.approx([differences[0]] * 3)


@pytest.mark.parametrize("discount", [-0.1, 1.1])
def test_shaping__needs_a_discount(make: Make, discount: float):
    with pytest.raises(ValueError, match="discount must be between 0 and 1"):
        PotentialShaping(make("TowerFlipIt"), discount)


def added_by_shaping(form: str, actions: Sequence[int], **settings: Any) -> list[float]:
    """Plays a game whose proposer takes `actions`, then STOP; returns what shaping adds to each agent's return."""
    from lilgym_mp.envs.proposer_verifier import env, parallel_env

    to_come = iter(actions)
    game = potential_shaping_v0((env if form == "turns" else parallel_env)(**settings))
    game.reset(options={"task": "train-0"})
    agents = list(game.agents)
    added = dict.fromkeys(agents, 0.0)

    def chosen(agent: str) -> int:
        """The proposer's next action, or the verifier's 1; the last index is "wait"."""
        turn = AGENTS.index(agent) in game.unwrapped.engine.movers
        waits = game.action_space(agent).n - 1
        return waits if not turn else 1 if agent == agents[1] else next(to_come, STOP)

    while game.agents:
        if form == "turns":
            agent = game.agent_selection
            _, reward, terminated, truncated, _ = game.last()
            added[agent] += reward
            if terminated or truncated:
                game.step(None)
                continue
            game.step(chosen(agent))
            for one in agents:
                added[one] -= game.infos[one]["unshaped_reward"]
        else:
            _, rewards, _, _, infos = game.step({agent: chosen(agent) for agent in agents})
            for agent in agents:
                added[agent] += rewards[agent] - infos[agent]["unshaped_reward"]
    return list(added.values())


@pytest.mark.parametrize("form", ["turns", "together"])
@pytest.mark.parametrize("protocol", ["veto", "joint", "critique"])
def test_shaping__of_a_game_shifts_returns_by_the_starts_potential(corpus: str, protocol: str, form: str):
    pytest.importorskip("pettingzoo", reason="pettingzoo is not installed: it comes with the extra `pettingzoo`")
    settings = {"appearance": "tower", "start": "scratch", "corpus": corpus, "protocol": protocol, "horizon": 3}
    potential = PotentialShaping(gym.make("lilgym_mp/TowerScratch-v0", corpus=corpus, horizon=3))
    potential.reset(options={"task": "train-0"})
    _, reward, _, _, info = potential.step(STOP)
    for actions in ([], [ADD_LEFT_YELLOW], [ADD_LEFT_YELLOW, 3, 3]):
        added = added_by_shaping(form, actions, **settings)
        assert added == pytest.approx([float(reward) - info["unshaped_reward"]] * 2)
    assert added != pytest.approx([0] * 2)


@pytest.mark.parametrize("edits", [0, 1, 2])
@pytest.mark.parametrize("configuration", ["TowerScratch", "ScatterFlipIt"])
def test_reverse_curriculum__starts_that_many_edits_from_success(make: Make, configuration: str, edits: int):
    plain = make(configuration)
    env = ReverseCurriculum(make(configuration), edits)
    for task_id in env.unwrapped.evaluation_tasks():
        plain.reset(options={"task": task_id})
        env.reset(options={"task": task_id})
        assert Expert(env).plan().steps == min(edits + 1, Expert(plain).plan().steps)


def test_reverse_curriculum__keeps_the_starts_of_unsolved_tasks(make: Make):
    env = ReverseCurriculum(make("TowerFlipIt", horizon=1), 0)
    plain = make("TowerFlipIt", horizon=1)
    assert [task.start for task in env.unwrapped.tasks] == [task.start for task in plain.unwrapped.tasks]


def test_reverse_curriculum__is_rebuilt_from_its_spec(make: Make):
    spec = ReverseCurriculum(make("TowerScratch"), 0).spec
    assert spec is not None
    env = gym.make(spec)
    env.reset(seed=0)
    assert env.unwrapped.goal_reached()


def test_reverse_curriculum__wraps_batches_of_towers(make_batch: Callable[[str], Any]):
    env = reverse_curriculum_v0(make_batch("TowerFlipIt"), 0)
    env.reset(seed=0)
    assert env.goal_reached().all()


def test_reverse_curriculum__refuses_batches_of_scatter(make_batch: Callable[[str], Any]):
    with pytest.raises(WrongEnvironment, match="for Scatter, wrap each environment"):
        reverse_curriculum_v0(make_batch("ScatterFlipIt"), 0)


@pytest.mark.parametrize("edits", [-1, True, 0.5])
def test_reverse_curriculum__needs_a_whole_number_of_edits(make: Make, edits: int):
    with pytest.raises(ValueError, match="edits must be a whole number of at least 0"):
        ReverseCurriculum(make("TowerScratch"), edits)
