"""Rewards shaped by the expert."""

import pytest

from lilgym_mp.solver import Expert
from lilgym_mp.wrappers import PotentialShaping

STOP, ADD_LEFT_YELLOW = 0, 1  # of tower's actions


@pytest.mark.parametrize("configuration", ["TowerFlipIt", "ScatterScratch"])
@pytest.mark.long
def test_shaping__gives_zero_reward_along_shortest_solutions(make, configuration):
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
def test_shaping__shifts_every_return_by_the_starts_potential(make, discount):
    def shift(actions):
        """The difference of the shaped return of one episode to the plain one."""
        env = PotentialShaping(make("TowerScratch"), discount)
        env.reset(seed=4)
        results = [env.step(action) for action in actions]
        return sum(discount**step * (result[1] - result[4]["unshaped_reward"]) for step, result in enumerate(results))

    one, *others = map(shift, ([STOP], [ADD_LEFT_YELLOW, STOP], [ADD_LEFT_YELLOW] * 5))
    assert others == pytest.approx([one, one])


@pytest.mark.parametrize("discount", [-0.1, 1.1])
def test_shaping__needs_a_discount(make, discount):
    with pytest.raises(ValueError, match="discount must be between 0 and 1"):
        PotentialShaping(make("TowerFlipIt"), discount)
