"""A person's play of the two-agent game, as text in and text out."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np

from lilgym_mp.cli.play import SIDES, input_lines
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.proposer_verifier import (
    SCRIPTED,
    Partner,
    PartnerTurn,
    ProposerVerifierParallel,
    Role,
    parallel_env,
)
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS
from lilgym_mp.evaluation.options import given_settings, split_of
from lilgym_mp.evaluation.terminal import shows_colours
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render.characters import text

PARTNERS = {"proposer": "oracle", "verifier": "helpful", "both": "random"}  # default partner by the person's side
MOST_LISTED = 40  # legal actions shown


def play_game(args: argparse.Namespace) -> int:
    settings, side = EnvConfig(**given_settings(args)), args.side or "proposer"
    partner = choose("partner", args.partner or PARTNERS[side], SCRIPTED)
    split = split_of(settings, args.split, args.task)
    game = parallel_env(settings.id, protocol=args.protocol or "veto", **settings.arguments(split))
    game.reset(seed=args.seed, options={} if args.task is None else {"task": args.task})
    try:
        _play(game, side, partner, np.random.default_rng(args.seed))
    except (EOFError, KeyboardInterrupt):
        print("quit before the end of the game")
    return 0


def _play(game: ProposerVerifierParallel, side: str, partner: Partner, rng: np.random.Generator) -> None:
    """Plays one game to its end. Raises EOFError if the person quits."""
    engine, lines, rewards = game.engine, input_lines(), np.zeros(len(Role))
    print(f'"{game.task.statement}"\nMake this {str(game.task.target).lower()}. You are {" and ".join(SIDES[side])}.')
    info: dict[str, Any] = {}
    while engine.movers:
        print(text(game.scene, [], coloured=shows_colours()))
        actions: list[int | None] = [None, None]
        for role in engine.movers:
            turn, agent = PartnerTurn(engine.games, role, rng), AGENTS[role]
            is_person = agent in SIDES[side]
            chosen = actions[role] = _read_action(game, turn, lines) if is_person else int(partner(turn))
            if not is_person:
                print(f"{agent}: {game.describe_action(agent, chosen)}")
        earned, _, _, (info, _) = engine.step(*actions)
        rewards += earned
    print(text(game.scene, [], coloured=shows_colours()))
    totals = ", ".join(f"{agent} {reward:+.1f}" for agent, reward in zip(AGENTS, rewards, strict=True))
    print(f"{info['outcome'].replace('_', ' ')}; {totals}")


def _read_action(game: ProposerVerifierParallel, turn: PartnerTurn, lines: Iterator[str]) -> int:
    """The index of the person's action. Raises EOFError if they quit or the input ends."""
    agent, legal = AGENTS[turn.role], np.flatnonzero(turn.action_mask).tolist()
    names = [game.describe_action(agent, index) for index in legal]
    shown = ", ".join(names[:MOST_LISTED]) + (", ..." if len(names) > MOST_LISTED else "")
    is_short = len(names) <= MOST_LISTED
    print(f"{agent}, one of: {shown}" if is_short else f"{agent}, such as {names[1]}; type legal to see more")
    for command in map(str.strip, lines):
        if command == "quit":
            break
        if command == "legal":
            print(shown)
            continue
        try:
            action = game.read_action(agent, command)
        except ActionError as error:
            print(error)
            continue
        if action in legal:
            return action
        print(f"{command} is not legal now")
    raise EOFError
