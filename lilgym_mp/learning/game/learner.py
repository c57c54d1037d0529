"""Both agents of the proposer-verifier game.

Trains one or both agents of the proposer-verifier game. Ctrl-C saves a checkpoint and exits.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lilgym_mp.envs.proposer_verifier.protocols import AGENTS
from lilgym_mp.envs.proposer_verifier.settings import GameSettings
from lilgym_mp.evaluation.game_partners import GUIDE, SCRIPTED_PROPOSERS, SCRIPTED_VERIFIERS
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import RunOptions, setting
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.arrays import AnyDict, AnyMapping

_RUNS: AnyMapping = {"kind": Path, "nargs": "+", "metavar": "RUN"}


@dataclass(frozen=True, slots=True)
class GameOptions(RunOptions):
    """The options of a game's run besides its recipe."""

    steps: int = setting(2_500_000, "turns of all games together", 1)
    minutes: float | None = setting(None, "end after this CPU time, even if fewer were made", kind=float, metavar="N")
    proposers: tuple[Path, ...] | None = setting(
        None,
        f"train only {AGENTS[1]}, against these runs' trained proposers, or: {', '.join(SCRIPTED_PROPOSERS)}",
        **_RUNS,
    )
    verifiers: tuple[Path, ...] | None = setting(
        None,
        f"train only {AGENTS[0]}, against these runs' trained verifiers, or: {', '.join((*SCRIPTED_VERIFIERS, GUIDE))}",
        **_RUNS,
    )
    start_from: Path | None = setting(
        None, "start with the weights of a run of `ppo` or `game`", kind=Path, metavar="RUN"
    )

    @classmethod
    def remembered(cls, saved: AnyMapping) -> AnyDict:
        partners = {
            f"{role}s": [Path(one.rsplit(": ", 1)[0]) for one in given]
            for role, given in saved.get("partners", {}).items()
        }
        return {**RunOptions.remembered.__func__(cls, saved), **partners}


def _train(*arguments: Any, **options: Any) -> Any:
    from lilgym_mp.learning.game.training import train_game

    return train_game(*arguments, **options)


def _load_agent(path: Path, device: str) -> Any:
    from lilgym_mp.learning.game.agent import GameAgent

    return GameAgent.load(path, device)


def _check(settings: GameSettings, recipe: GameRecipe) -> None:
    """Raises UnsupportedAppearance for an appearance whose actions the networks have no heads for."""
    from lilgym_mp.learning.common.factored_policy import joint_factorisation

    joint_factorisation(make_appearance(settings.appearance, settings.grid))


LEARNER = Learner(GameRecipe, GameOptions, _train, _load_agent, __doc__, config=GameSettings, check=_check)
