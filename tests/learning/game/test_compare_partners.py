from lilgym_mp.envs.proposer_verifier import SCRIPTED, GameSettings, play_games, summarise
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from tests.scripts import load_script


def test_written_games__give_rates_of_runs_and_success_with_an_interval(own, monkeypatch):
    script = load_script("compare_partners")
    env = BaseGameEnv(**vars(GameSettings("TowerFlipIt", corpus=own, protocol="audit", split="dev")))
    monkeypatch.setattr(script, "tasks", lambda configuration: env.engine.game.tasks)
    runs = []
    for judge in ("oracle", "always_accept", "always_reject"):
        proposers = (SCRIPTED[name] for name in ("helpful", "deceptive"))
        games = [game for proposer in proposers for game in play_games(env, proposer, SCRIPTED[judge])]
        runs.append(script.pair("audit", "both", judge, "TowerFlipIt", games).records())
        assert [(game.task, game.outcome) for game in runs[-1]] == [(game.task, game.outcome) for game in games]
    assert script.rates(runs[:2]) == ("100 / 100", "50 / 50", "100, 0")
    assert script.rates(runs[2:]) == ("0 / 0", "100 / 100", "0")
    everywhere, seen_and_unseen = script.success(script.recordings(runs[:1]), set())
    rate = f"{100 * summarise(runs[0]).success_rate:.1f}"
    assert everywhere.startswith(f"{rate} [")
    assert seen_and_unseen == f"- / {rate}"
