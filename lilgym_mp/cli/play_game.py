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
    except (_Quit, KeyboardInterrupt):
        print("quit before the end of the game")
    return 0


def _play(game: ProposerVerifierParallel, side: str, partner: Partner, rng: np.random.Generator) -> None:
    """Plays one game to its end."""
    lines = input_lines()
    print(f'"{game.task.statement}"\nMake this {str(game.task.target).lower()}. You are {" and ".join(SIDES[side])}.')
    infos: dict[str, Any] = {}
    rewards = dict.fromkeys(AGENTS, 0.0)
    while game.agents:
        print(text(game.scene, [], coloured=shows_colours()))
        actions: dict[str, int] = {}
        for agent, role in zip(AGENTS, Role, strict=True):
            turn = PartnerTurn(game.engine.games, role, rng)
            legal = np.flatnonzero(turn.action_mask).tolist()
            if len(legal) == 1:  # it is the other agent's turn
                actions[agent] = legal[0]
                continue
            actions[agent] = _read_action(game, agent, legal, lines) if agent in SIDES[side] else int(partner(turn))
            if agent not in SIDES[side]:
                print(f"{agent}: {game.describe_action(agent, actions[agent])}")
        _, step_rewards, _, _, infos = game.step(actions)
        rewards = {agent: rewards[agent] + step_rewards[agent] for agent in AGENTS}
    outcome = infos[AGENTS[0]]["outcome"].replace("_", " ")
    print(text(game.scene, [], coloured=shows_colours()))
    print(f"{outcome}; " + ", ".join(f"{agent} {reward:+.1f}" for agent, reward in rewards.items()))


def _read_action(game: ProposerVerifierParallel, agent: str, legal: list[int], lines: Iterator[str]) -> int:
    """The index of the person's action. Raises _Quit."""
    names = [game.describe_action(agent, index) for index in legal]
    shown = ", ".join(names[:MOST_LISTED]) + (", ..." if len(names) > MOST_LISTED else "")
    if len(names) <= MOST_LISTED:
        print(f"{agent}, one of: {shown}")
    else:
        print(f"{agent}, such as {names[1]}; type legal to see more")
    for line in lines:
        command = line.strip()
        if command == "quit":
            raise _Quit
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
    raise _Quit


class _Quit(Exception):
    """The person quits, or the input ends."""
