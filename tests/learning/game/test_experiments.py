"""benchmarks/game_experiments.py: its tables and pictures, from small runs."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lilgym_mp.envs.proposer_verifier import SCRIPTED, GameSettings, Role, parallel_env
from lilgym_mp.envs.proposer_verifier.metrics import play_games
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.training import train_game

SCRIPT = Path(__file__).parents[3] / "benchmarks" / "game_experiments.py"
SMALL = GameRecipe(envs=8, same_statement=2, rollout=128, batch_size=64, epochs=1, recolour=False, width=16)


@pytest.fixture(scope="module")
def script() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(SCRIPT.parent)
        return importlib.import_module(SCRIPT.stem)


def test_random_refusal__refuses_its_share_of_claims_and_no_edits(script: Any, own: str):
    env = parallel_env(protocol="audit", corpus=own, split="dev")
    games = play_games(env, SCRIPTED["helpful"], script.RandomRefusal(0.3), tasks=list(env.tasks.ids) * 100)
    assert script.refusal_share(games) == pytest.approx(0.3, abs=0.05)
    always, never = ([play_games(env, SCRIPTED["helpful"], SCRIPTED[name])] for name in ("always_accept", "random"))
    assert script.interval(always) == "100.0 [100.0, 100.0]"
    assert script.compare(always, never) == "+0.0 [+0.0, +0.0] points"  # in audit, success does not depend on verdicts


@pytest.mark.long
def test_sections__print_tables_and_draw_pictures(
    script: Any, own: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    settings = {"joint": "joint", "audit": "audit", "veto-both": "veto", "veto-alone": "veto"}
    for name, protocol in settings.items():
        for seed in (0, 1):
            game = GameSettings.of(protocol=protocol, start="flipit", corpus=own)
            partners = {Role.VERIFIER: [Path("always-accept")]} if name == "veto-alone" else {}
            out = tmp_path / "runs" / f"{name}-TowerFlipIt-{seed}"
            train_game(game, SMALL, out, steps=256, partners=partners, device="cpu")
    monkeypatch.setattr(script, "SAMPLES", 2)
    found = script.Experiments(tmp_path, own, "dev", tmp_path, None)
    found.joint()
    found.filters()
    found.samples()
    found.curves()
    found.matrix("audit", "audit", "j", "judged")
    said = capsys.readouterr().out
    for row in (
        "| flipit | an oracle |",
        "| alone | none |",
        "| random like its own |",
        "| expert, honest",
    ):
        assert row in said
    assert {"game_curves.svg", "judged.svg"} <= {path.name for path in tmp_path.glob("*.svg")}
    assert not np.isnan(script.curve(tmp_path / "runs" / "joint-TowerFlipIt-0", "success")).any()
