"""TorchRL's PettingZoo wrapper accepts the game in all its forms."""

import importlib.util

import pytest

from lilgym_mp.envs.proposer_verifier import env, parallel_env

if importlib.util.find_spec("torchrl") is None:
    pytest.skip("torchrl is not installed: it comes with the extra `torchrl`", allow_module_level=True)

from torchrl.envs.libs.pettingzoo import PettingZooWrapper
from torchrl.envs.utils import check_env_specs

pytestmark = pytest.mark.filterwarnings("default")


@pytest.mark.parametrize(
    ("make", "protocol", "observations", "homogeneous"),
    [
        (env, "veto", "nested", False),
        (env, "joint", "vector", True),
        (parallel_env, "audit", "nested", True),
        (parallel_env, "critique", "vector", False),
    ],
)
def test_pettingzoo_wrapper__takes_the_game_with_its_masks(make, protocol, observations, homogeneous):
    game = make(protocol=protocol, views="structured", observations=observations, homogeneous=homogeneous)
    wrapped = PettingZooWrapper(game, return_state=False, use_mask=make is env, done_on_any=True)
    check_env_specs(wrapped)
    played = wrapped.rollout(20, break_when_any_done=False)
    assert played.batch_size[0] == 20
    for group in wrapped.group_map:
        chosen, legal = played[group, "action"], played[group, "action_mask"]
        moved = played[group, "mask"] if make is env else legal.any(-1)
        assert legal.gather(-1, chosen[..., None]).squeeze(-1)[moved].all()
