from types import SimpleNamespace

import numpy as np

from lilgym_mp.envs.proposer_verifier import SCRIPTED, GameSettings, play_games, summarise
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from tests.scripts import load_script


def test_messages__are_silenced_or_permuted_and_answers_stay():
    script, sent = load_script("compare_partners"), np.arange(10)  # two answers with messages 0 (none) to 4
    verifier, turn = SimpleNamespace(batch=lambda turn: sent), None
    assert script.Messages(verifier, 4, silent=True).batch(turn).tolist() == [0] * 5 + [5] * 5
    assert script.Messages(verifier, 4, silent=False).batch(turn).tolist() == [0, 2, 3, 4, 1, 5, 7, 8, 9, 6]


def test_rates__are_means_of_runs_and_success_has_an_interval(own):
    script = load_script("compare_partners")
    env = BaseGameEnv(**vars(GameSettings("TowerFlipIt", corpus=own, protocol="audit", split="dev")))
    runs = [
        [game for proposer in ("helpful", "deceptive") for game in play_games(env, SCRIPTED[proposer], SCRIPTED[judge])]
        for judge in ("oracle", "always_accept", "always_reject")
    ]
    assert script.rates(runs[:2]) == ["100 / 100", "50 / 50", "100, 0"]
    assert script.rates(runs[2:]) == ["0 / 0", "100 / 100", "0"]
    assert script.success(runs[:1]).startswith(f"{100 * summarise(runs[0]).success_rate:.1f} [")
