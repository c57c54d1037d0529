"""Agents as partners of the two-agent game: the roles they are asked for."""

import pytest

from lilgym_mp.envs.proposer_verifier import GameSettings, Role
from lilgym_mp.learning.common.agents import open_agent
from lilgym_mp.learning.game.agent import GameAgent

GAME = GameSettings("TowerFlipIt")
AGENTS = {
    "game": lambda: GameAgent(None, GAME, None, {}),
    "ppo": lambda: open_agent("ppo-tower"),
    "reward-model": lambda: open_agent("reward-model-tower"),
}


@pytest.mark.parametrize("kind", AGENTS)
@pytest.mark.parametrize("role", ["prover", "PROPOSER", None, 2, True])
def test_partner__of_an_unknown_role_is_refused_with_the_choices(kind, role):
    with pytest.raises(ValueError, match=f"unknown role {role!r}; choose from proposer, verifier"):
        AGENTS[kind]().partner(role, GAME)


@pytest.mark.parametrize("role", ["proposer", "verifier_0", Role.PROPOSER])
def test_partner__takes_roles_and_their_names(role):
    assert AGENTS["ppo"]().partner(role, GAME) is not None
    assert AGENTS["game"]().partner(role) is None, "it did not learn"
    with pytest.raises(ValueError, match="learned without a game: name one"):
        AGENTS["ppo"]().partner(role)
