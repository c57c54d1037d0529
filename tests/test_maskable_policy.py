"""The Stable-Baselines3 policy and its agent for evaluations."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium as gym
import numpy as np
import pytest
import torch
from actor_critic import ActorCritic
from maskable_policy import Agent, MaskedActorCritic

from lilgym_mp.appearances import Tower
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Observations
from lilgym_mp.render import draw
from lilgym_mp.wrappers import TokenizedStatement
from tests.scenes import scene

ACTIONS = 13
STOP = 0
FORCED = np.eye(1, ACTIONS, STOP, dtype=bool)  # only STOP is left
UNFORCED = np.ones((1, ACTIONS), bool)


@pytest.fixture
def policy() -> MaskedActorCritic:
    torch.manual_seed(0)
    env = TokenizedStatement(gym.make("lilgym_mp/TowerScratch-v0"))
    make_network: Callable[[], ActorCritic] = lambda: ActorCritic(Tower(), len(env.vocabulary))  # noqa: E731
    return MaskedActorCritic(
        env.observation_space, env.action_space, lambda left: 0.05 * left, make_network=make_network
    )


@pytest.fixture
def seen() -> dict[str, torch.Tensor]:
    """An observation in Stable-Baselines3's format."""
    image = torch.from_numpy(draw(scene(), "half")).permute(2, 0, 1)[None]
    return {"image": image, "statement": torch.tensor([[2, 3, 4]]), "target": torch.tensor([[1]])}


def test_policy__samples_all_and_only_legal_actions(policy: MaskedActorCritic, seen: dict[str, torch.Tensor]):
    mask = np.zeros((1, ACTIONS), bool)
    mask[0, [2, 7]] = True
    torch.manual_seed(0)
    assert {int(policy(seen, action_masks=mask)[0]) for _ in range(50)} == {2, 7}


def test_policy__renormalises_over_legal_actions(policy: MaskedActorCritic, seen: dict[str, torch.Tensor]):
    mask = np.zeros((1, ACTIONS), bool)
    mask[0, [2, 7]] = True
    _, log_probability, entropy = policy.evaluate_actions(seen, torch.tensor([2]), mask)
    assert log_probability.exp().item() == pytest.approx(0.5, abs=0.05)
    assert entropy.item() == pytest.approx(np.log(2), abs=0.01)


def test_policy__forced_stop_has_its_unmasked_log_probability(policy: MaskedActorCritic, seen: dict[str, torch.Tensor]):
    action, _, log_probability = policy(seen, action_masks=FORCED)
    assert action.item() == STOP
    assert log_probability.item() == pytest.approx(-np.log(ACTIONS), abs=0.1)
    assert log_probability.item() == pytest.approx(policy.evaluate_actions(seen, action, UNFORCED)[1].item(), abs=1e-5)


def test_policy__forced_stop_has_a_gradient(policy: MaskedActorCritic, seen: dict[str, torch.Tensor]):
    before = policy.evaluate_actions(seen, torch.tensor([STOP]), UNFORCED)[1].item()
    for _ in range(5):
        policy.optimizer.zero_grad()
        (-policy.evaluate_actions(seen, torch.tensor([STOP]), FORCED)[1].sum()).backward()
        policy.optimizer.step()
    assert policy.evaluate_actions(seen, torch.tensor([STOP]), UNFORCED)[1].item() > before + 0.5


VOCABULARY = Vocabulary.from_statements(["blue block here"])


def agent(*, greedy: bool) -> Agent:
    torch.manual_seed(1)
    return Agent(ActorCritic(Tower(), len(VOCABULARY)).eval(), VOCABULARY, 4, greedy)


def observations(count: int) -> Observations:
    image = draw(scene(), "half")
    statements = ("A blue block, unheard of, is here",) * count
    return Observations(
        np.stack([image] * count), statements, np.ones(count, int), np.zeros(count, int), np.arange(count)
    )


def test_agent__greedy_takes_the_most_probable_legal_action():
    legal = np.ones((1, ACTIONS), bool)
    rng = np.random.default_rng(0)
    order = []
    for _ in range(ACTIONS):
        best = int(agent(greedy=True)(observations(1), legal, rng)[0])
        order.append(best)
        legal[0, best] = False
    assert sorted(order) == list(range(ACTIONS))


def test_agent__sample_frequencies_match_the_network():
    legal = np.zeros((3000, ACTIONS), bool)
    legal[:, [2, 7, 9]] = True
    drawn = agent(greedy=False)(observations(3000), legal, np.random.default_rng(0))
    assert np.bincount(drawn, minlength=ACTIONS)[[2, 7, 9]] == pytest.approx([1000] * 3, abs=150)


def test_agent__is_reproducible_by_seed():
    legal = np.ones((50, ACTIONS), bool)
    drawn = [agent(greedy=False)(observations(50), legal, np.random.default_rng(7)).tolist() for _ in range(2)]
    assert drawn[0] == drawn[1]
