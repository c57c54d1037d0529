"""Population rounds: a verifier learns against all earlier proposers, then a deceptive best response to it joins them.

What a best response earns is the verifier's exploitability: the share of games that end in an accepted false claim.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lilgym_mp.envs.proposer_verifier import AGENTS, GameSettings, Partner, Role
from lilgym_mp.learning.common.agents import AgentError, agent_file
from lilgym_mp.learning.common.run_directory import AGENT_FILE, RUN_FILE
from lilgym_mp.learning.game.agent import load_agent
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.training import train_game

DECEPTIVE, FAIR = "deceptive", "correctness"


def best_response(
    frozen: Path | Partner,
    role: Role,
    settings: GameSettings,
    *,
    seed: int = 0,
    out: Path | None = None,
    recipe: GameRecipe | None = None,
    **options: Any,
) -> Partner:
    """The agent `role` trained for a budget against `frozen`, the other agent's run directory or a partner.

    A proposer is rewarded for accepted false claims alone, a verifier for correct judgements. `out`: the run directory,
    by default a temporary one. `options`, such as the budget, as for `train_game`, with its errors.
    Raises KeyboardInterrupt if it is stopped early.
    """
    rewards = {AGENTS[role]: DECEPTIVE if role is Role.PROPOSER else FAIR, AGENTS[role.other]: "mdp"}
    with TemporaryDirectory() as temporary:
        agent = train_game(
            replace(settings, rewards=rewards),
            replace(recipe or GameRecipe.of(settings.configuration), seed=seed),
            out or Path(temporary) / "run",
            partners={role.other: [frozen]},
            **options,
        )
    found = agent.partner(role)
    assert found is not None
    return found


def train_rounds(
    settings: GameSettings,
    recipe: GameRecipe,
    out: Path,
    first: Sequence[Path],
    *,
    rounds: int,
    on_round: Callable[[int, Path], object] = lambda index, path: None,
    **options: Any,
) -> list[Path]:
    """The proposers' run directories after `rounds` rounds: `first`, then each round's deceptive best response.

    Each round trains `out`/verifier-N against all proposers so far, anew or, with a `warm` recipe, from the last
    round's, then `out`/deceptive-N against it; each with the budget and other `options` of `train_game`, whose errors
    it raises. Runs that are finished are kept, and interrupted ones resumed.
    """
    proposers = list(first)
    for path in proposers:
        if load_agent(agent_file(path)).partner(Role.PROPOSER) is None:
            raise AgentError(f"{path}: it has no trained proposer to begin with")
    fair = replace(settings, rewards={AGENTS[Role.PROPOSER]: DECEPTIVE, AGENTS[Role.VERIFIER]: FAIR})
    for index in range(rounds):
        verifier, deceptive = out / f"verifier-{index}", out / f"deceptive-{index}"
        earlier = out / f"verifier-{index - 1}" if recipe.warm and index else None
        seeded = replace(recipe, seed=recipe.seed + index)
        against = {Role.PROPOSER: proposers}
        _learn(fair, seeded, verifier, partners=against, start_from=earlier, **options)
        _learn(fair, seeded, deceptive, partners={Role.VERIFIER: [verifier]}, **options)
        proposers = [*proposers, deceptive]
        on_round(index, verifier)
    return proposers


def _learn(settings: GameSettings, recipe: GameRecipe, out: Path, **options: Any) -> None:
    """Trains a run unless it is finished, resuming an interrupted one."""
    if not (out / AGENT_FILE).exists() or load_agent(out / AGENT_FILE).description.details["interrupted"]:
        train_game(settings, recipe, out, resume=(out / RUN_FILE).exists(), **options)


def train(
    settings: GameSettings,
    recipe: GameRecipe,
    out: Path,
    *,
    proposers: Sequence[Path] | None = None,
    verifiers: Sequence[Path] | None = None,
    rounds: int | None = None,
    **options: Any,
) -> None:
    """Trains as the command does: against these partners, or in population rounds.

    The last round's verifier becomes the agent of `out`. `options` as for `train_game`, with its errors.
    """
    if rounds is None:
        partners = {Role.PROPOSER: proposers or (), Role.VERIFIER: verifiers or ()}
        train_game(settings, recipe, out, partners=partners, **options)
        return
    if not proposers or verifiers:
        raise ValueError("--rounds begins with trained proposers: name their runs with --proposers")

    def report(index: int, verifier: Path) -> None:
        options["say"](f"round {index}: {verifier} and its deceptive best response are trained")
        shutil.copyfile(verifier / AGENT_FILE, out / AGENT_FILE)

    shared = {name: options[name] for name in ("steps", "minutes", "device", "threads", "say")}
    train_rounds(settings, recipe, out, proposers, rounds=rounds, on_round=report, **shared)
