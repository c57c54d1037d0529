"""Steps per second of the proposer-verifier game's environments, by protocol.

All environments play the same recorded games of legal actions without early stops, so a game lasts its twelve rounds;
resets are timed too. A *parallel* step is one call of `step` with both agents' actions, which gives both agents'
observations and masks. An *AEC* step is one call of `step` and one of `last`, which gives the observation and mask of
the next agent. A *batched* step is one game's part of a call: a call with N games counts as N. The image is drawn and
copied once per step. Shows the fastest of several repetitions, as the machine is rarely idle.
Run: python benchmarks/proposer_verifier.py
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import numpy as np

from lilgym_mp.envs.proposer_verifier import AGENTS, PROTOCOLS, BatchedGames, Role, env, parallel_env, raw_env
from lilgym_mp.envs.proposer_verifier.protocols import ACCEPT, STOP_ACTION

PROPOSER, VERIFIER = AGENTS

BATCHED_STEPS = 8_192  # per repetition, over all games
CLOCKS = {"wall": perf_counter, "cpu": process_time}

Recorded = tuple[str, list[dict[str, int]]]  # a task's id, and the actions of the parallel environment


def record(settings: dict[str, Any], games: int, seed: int) -> list[Recorded]:
    """Games of random legal actions, without claims, stops and accepted claims."""
    game_env: Any = parallel_env(**settings)
    engine, rng = game_env.engine, np.random.default_rng(seed)
    recorded: list[Recorded] = []
    for number in range(games):
        game_env.reset(seed=seed + number)
        actions: list[dict[str, int]] = []
        while game_env.agents:
            actions.append({agent: choice(engine, Role(role), rng) for role, agent in enumerate(AGENTS)})
            game_env.step(actions[-1])
        recorded.append((game_env.unwrapped.task.id, actions))
    return recorded


def choice(engine: Any, role: Role, rng: np.random.Generator) -> int:
    mask = engine.game.legal_mask(engine.state, role)
    if role is Role.PROPOSER:
        mask[engine.game.encode_action(role, STOP_ACTION)] = 0
    elif not engine.game.turn_based:
        mask[engine.game.encode_action(role, ACCEPT)] = 0
    return int(rng.choice(np.flatnonzero(mask)))


def play_parallel(settings: dict[str, Any], recorded: list[Recorded]) -> Callable[[], int]:
    game_env: Any = parallel_env(**settings)

    def run() -> int:
        for task, actions in recorded:
            game_env.reset(options={"task": task})
            for pair in actions:
                game_env.step(pair)
        return sum(len(actions) for _, actions in recorded)

    return run


def play_turns(make: Callable[..., Any], settings: dict[str, Any], recorded: list[Recorded]) -> Callable[[], int]:
    game_env = make(**settings)
    simultaneous = not game_env.unwrapped.engine.game.turn_based
    games = [(task, turns(settings, task, actions, simultaneous=simultaneous)) for task, actions in recorded]

    def run() -> int:
        for task, actions in games:
            game_env.reset(options={"task": task})
            game_env.last()
            for action in actions:
                game_env.step(action)
                game_env.last()
        return sum(len(actions) for _, actions in games)

    return run


def turns(settings: dict[str, Any], task: str, actions: list[dict[str, int]], *, simultaneous: bool) -> list[int]:
    """The actions of a parallel game as AEC turns."""
    if simultaneous:
        return [pair[agent] for pair in actions for agent in AGENTS]
    game_env = raw_env(**settings)
    game_env.reset(options={"task": task})
    taken: list[int] = []
    for pair in actions:
        taken.append(pair[game_env.agent_selection])
        game_env.step(taken[-1])
    return taken


def play_batched(settings: dict[str, Any], recorded: list[Recorded], games: int, *, copy: bool) -> Callable[[], int]:
    """Game i plays all recorded games, beginning with the i-th, on any task, as all start scenes are empty."""
    batch = BatchedGames(games, copy=copy, **settings)
    columns = [[pair for _, actions in recorded[i:] + recorded[:i] for pair in actions] for i in range(games)]
    rows = list(zip(*columns, strict=True))[: max(1, BATCHED_STEPS // games)]
    calls = [{agent: np.array([pair[agent] for pair in row]) for agent in AGENTS} for row in rows]

    def run() -> int:
        batch.reset()
        for call in calls:
            batch.step(call)
        return len(calls) * games

    return run


def fastest(run: Callable[[], int], repetitions: int, clock: Callable[[], float]) -> float:
    """Steps per second of the fastest repetition."""
    best = 0.0
    for _ in range(repetitions):
        start = clock()
        steps = run()
        best = max(best, steps / (clock() - start))
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--appearance", choices=["tower", "scatter"], default="tower")
    parser.add_argument("--views", choices=["image", "structured"], default="image")
    parser.add_argument("--games", type=int, default=64)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--clock", choices=CLOCKS, default="wall", help="cpu: approximately the speed of an idle core")
    parser.add_argument("--repetitions", type=int, default=40)
    given = parser.parse_args()
    print(f"{given.appearance}, {given.views}; steps per second of {given.clock} time")
    print(f"{'protocol':10} {'parallel':>9} {'raw_env':>9} {'env':>9} {f'batched {given.batch}':>12} {'no copy':>9}")
    for protocol in PROTOCOLS:
        settings = {"appearance": given.appearance, "views": given.views, "protocol": protocol}
        recorded = record(settings, given.games, seed=0)
        runs = [
            play_parallel(settings, recorded),
            play_turns(raw_env, settings, recorded),
            play_turns(env, settings, recorded),
            play_batched(settings, recorded, given.batch, copy=True),
            play_batched(settings, recorded, given.batch, copy=False),
        ]
        speeds = [f"{fastest(run, given.repetitions, CLOCKS[given.clock]):,.0f}" for run in runs]
        print(f"{protocol:10} {speeds[0]:>9} {speeds[1]:>9} {speeds[2]:>9} {speeds[3]:>12} {speeds[4]:>9}", flush=True)


if __name__ == "__main__":
    main()
