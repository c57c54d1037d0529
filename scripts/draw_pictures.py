"""Draws the pictures and films of README and docs into docs/pictures: `python scripts/draw_pictures.py [NAME ...]`.

Without names it draws those that take a minute or two: films of the agent parse-and-plan (needs the extra `sb3`), games
(`pettingzoo`), and the architecture. `--list` prints the commands for the others, which need a training run or the
official data.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
from PIL import Image

import lilgym_mp
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.envs.proposer_verifier import (
    AGENTS,
    HELPFUL_PROPOSER,
    PROTOCOLS,
    SNEAKY_PROPOSER,
    OracleVerifier,
    Partner,
    PartnerTurn,
    Role,
    parallel_env,
)
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation import Episode, Settings, evaluate
from lilgym_mp.evaluation.film import episode_frames, film_frames, save_gif
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.solver import Solver

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
AGENT, SPLIT = "parse-and-plan", "dev"
# numbers of actions, and of characters in the statement, that suit a film
ACTIONS, CHARACTERS = range(3, 7), range(30, 75)
PROPOSERS = {"critique": SNEAKY_PROPOSER}  # HELPFUL_PROPOSER in the other protocols
GAME_SEED = 2

ELSEWHERE = {  # pictures made by other commands
    "demo_imitation.gif": "lilgym-mp demo --out OUT; cp OUT/imitation.gif docs/pictures/demo_imitation.gif",
    "proposer_verifier_curve.svg": "python examples/proposer_verifier_audit.py; its chart",
    "benchmark_scaling.png": "lilgym-mp bench --write-docs docs/benchmarks.md",
    "official_phenomena.svg": "lilgym-mp data stats lilgym --charts OUT; its phenomena.svg",
    "reliability.png": "the chart of a report on the runs in docs/agents.md",
    "report.png": "lilgym-mp report RESULTS --out OUT; a screenshot of its page",
    "results-*.png": "lilgym-mp report RESULTS --out OUT --document docs/results.md",
    "web/*.png": "python scripts/web_screenshots.py",
}


def shown_episode(configuration: str) -> Episode:
    """The most colourful of the dev episodes of suitable length that end in success without a needless action."""
    settings = Settings(configuration)
    policy = lilgym_mp.load_agent(AGENT, "cpu").policy(settings)
    dynamics, tasks = settings.dynamics(), settings.make(SPLIT).tasks
    solver = Solver(dynamics)

    def item_types(episode: Episode) -> int:
        """Number of colours and shapes in the last scene, each counted with the other."""
        state = dynamics.start(tasks.by_id(episode.task_id))
        for action in episode.actions:
            state = dynamics.step(state, dynamics.appearance.decode(action)).state
        return len({(item.colour, item.shape) for box in state.scene.boxes for item in box.items})

    fitting = [
        episode
        for episode in evaluate(policy, settings, SPLIT)
        if episode.is_success and len(episode.actions) in ACTIONS and len(episode.statement) in CHARACTERS
    ]
    return next(
        episode
        for episode in sorted(fitting, key=item_types, reverse=True)
        if solver.solve(tasks.by_id(episode.task_id)).steps == len(episode.actions)
    )


def frames_of(configuration: str, episode: Episode) -> list[UInt8Array]:
    """The episode as rendered by mode "rgb_array", with the grid drawn in."""
    env = gym.make(Settings(configuration).id, split=SPLIT, render_mode="rgb_array", render_cells=True).unwrapped
    assert isinstance(env, LilGymEnv)
    env.reset(options={"task": episode.task_id})
    frames = [np.asarray(env.render(), np.uint8)]
    for action in episode.actions:
        env.step(action)
        frames.append(np.asarray(env.render(), np.uint8))
    return frames


def draw_films() -> None:
    """A film and a first frame for each configuration, and one film of all four."""
    films = []
    for configuration in CONFIGURATIONS:
        episode = shown_episode(configuration)
        frames = frames_of(configuration, episode)
        save_gif(PICTURES / f"{configuration}.gif", frames)
        Image.fromarray(frames[0]).save(PICTURES / f"{configuration}.png", optimize=True)
        films.append(list(episode_frames(Settings(configuration).make(SPLIT), episode)))
    film_frames(PICTURES / "agent.gif", films, columns=2)


def draw_games() -> None:
    """A film of one game per protocol, between a scripted proposer and a verifier that knows the truth."""
    for protocol in PROTOCOLS:
        frames = game_frames(protocol, seed=GAME_SEED)
        save_gif(PICTURES / f"game_{protocol}.gif", frames)


def game_frames(protocol: str, seed: int) -> list[UInt8Array]:
    """A game as rendered by mode "rgb_array"."""
    game = parallel_env(protocol=protocol, split=SPLIT, render_mode="rgb_array")
    rng = np.random.default_rng(seed)
    game.reset(seed=seed)
    players: dict[str, Partner] = dict(
        zip(AGENTS, (PROPOSERS.get(protocol, HELPFUL_PROPOSER), OracleVerifier()), strict=True)
    )
    frames = [np.asarray(game.render(), np.uint8)]
    while game.agents:
        seats = {agent: PartnerTurn(game.engine, role, rng) for agent, role in zip(AGENTS, Role, strict=True)}
        game.step({agent: _choice(players[agent], turn) for agent, turn in seats.items()})
        frames.append(np.asarray(game.render(), np.uint8))
    return frames


def _choice(partner: Partner, turn: PartnerTurn) -> int:
    """The only legal action if there is just one, such as waiting, otherwise the partner's choice."""
    legal = np.flatnonzero(turn.action_mask)
    return int(legal[0]) if len(legal) == 1 else int(partner(turn))


def draw_episode() -> None:
    _run("examples/first_steps.py", "--seed", "40", "--output", str(PICTURES / "episode.png"))


def draw_architecture() -> None:
    _run("scripts/draw_architecture.py", str(PICTURES / "architecture.svg"))


def _run(*command: str) -> None:
    subprocess.run([sys.executable, *command], cwd=ROOT, check=True)


DRAWN: dict[str, Callable[[], None]] = {
    "films": draw_films,
    "games": draw_games,
    "episode": draw_episode,
    "architecture": draw_architecture,
}
FILES = [  # made by DRAWN
    *(f"{configuration}.{ending}" for configuration in CONFIGURATIONS for ending in ("gif", "png")),
    *(f"game_{protocol}.gif" for protocol in PROTOCOLS),
    "agent.gif",
    "episode.png",
    "architecture.svg",
]


def main() -> None:
    parser = argparse.ArgumentParser(description="Draws the pictures of README and docs.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(DRAWN)} (default: all)")
    parser.add_argument("--list", action="store_true", help="print the commands that make the other pictures")
    args = parser.parse_args()
    if unknown := sorted(set(args.names) - set(DRAWN)):
        parser.error(f"unknown pictures {unknown}; choose from {', '.join(DRAWN)}")
    if args.list:
        print(*(f"{name}: {command}" for name, command in ELSEWHERE.items()), sep="\n")
        return
    for name in args.names or DRAWN:
        DRAWN[name]()


if __name__ == "__main__":
    main()
