"""Draws the pictures and films of README and docs into docs/pictures: `python scripts/draw_pictures.py [NAME ...]`.

Without names it draws those that take minutes: films of included agents (needs the extra `train`), games
(`pettingzoo`), charts of docs/results and a report (`report` and Chromium), and the architecture. `--list` prints the
commands for the others, which need a training run or the official data.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from contextlib import chdir
from html import escape
from pathlib import Path

import draw_results
import gymnasium as gym
import numpy as np
from PIL import Image

import lilgym_mp
from lilgym_mp.cli import main as command
from lilgym_mp.contrib.report.charts import save
from lilgym_mp.envs.proposer_verifier import (
    AGENTS,
    PROTOCOLS,
    SCRIPTED,
    OracleVerifier,
    Partner,
    PartnerTurn,
    Role,
    parallel_env,
)
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation import CONFIGURATIONS, Episode, Settings, evaluate
from lilgym_mp.evaluation.film import episode_frames, film_frames, save_gif
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.render.drawing import COLOUR_RGB
from lilgym_mp.solver import Solver

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
AGENT, SPLIT = "parse-and-plan", "dev"
REPORTED = "imitation-tower"  # a fast agent for the picture of a report
SHOWN = {  # tasks for the films
    "TowerScratch": "tower-dev-048",
    "TowerFlipIt": "tower-dev-144-e",
    "ScatterScratch": "scatter-dev-093",
    "ScatterFlipIt": "scatter-dev-040-d",
}
PROPOSERS = {"critique": "deceptive"}  # "helpful" in the other protocols
GAME_SEED = 7
CHROMIUM = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars"),
    *("--force-color-profile=srgb", "--window-size=960,1125"),
)
LOGO_PITCH = 110  # pixels between the boxes of the logo
BADGE_CHARACTER = 6.8  # pixels

ELSEWHERE = {  # pictures made by other commands
    "game_guide.gif": "python scripts/draw_guide_film.py BUILDER GUIDE, with runs as in docs/game_experiments.md",
    "results-edit*.png": "python scripts/draw_results.py",
    "web/*": "python scripts/web_screenshots.py",
}


def shown_episode(configuration: str) -> Episode:
    """The agent's episode of the task in SHOWN, which must succeed without a needless action."""
    settings = Settings(configuration)
    policy = lilgym_mp.load_agent(AGENT, "cpu").policy(settings)
    (episode,) = evaluate(policy, settings, SPLIT, task_ids=[SHOWN[configuration]])
    task = settings.make(SPLIT).tasks.by_id(episode.task)
    assert episode.is_success
    assert len(episode.actions) == Solver(settings.dynamics()).solve(task).steps
    return episode


def frames_of(configuration: str, episode: Episode) -> list[UInt8Array]:
    """The episode as rendered by mode "rgb_array", with the grid drawn in."""
    env = gym.make(Settings(configuration).id, split=SPLIT, render_mode="rgb_array", render_cells=True).unwrapped
    assert isinstance(env, LilGymEnv)
    env.reset(options={"task": episode.task})
    frames = [np.asarray(env.render(), np.uint8)]
    for action in episode.actions:
        env.step(env.dynamics.appearance.encode(action))
        frames.append(np.asarray(env.render(), np.uint8))
    return frames


def draw_films() -> None:
    """A film and a first frame for each configuration, and films of all four, and of two for phones."""
    films = []
    for configuration in CONFIGURATIONS:
        episode = shown_episode(configuration)
        frames = frames_of(configuration, episode)
        save_gif(PICTURES / f"{configuration}.gif", frames)
        Image.fromarray(frames[0]).save(PICTURES / f"{configuration}.png", optimize=True)
        films.append(list(episode_frames(Settings(configuration).make(SPLIT), episode)))
    film_frames(PICTURES / "agent.gif", films, columns=2)
    film_frames(PICTURES / "agent-dark.gif", films, columns=2, dark=True)
    film_frames(PICTURES / "agent-phone.gif", films[1::2], columns=1)


def draw_games() -> None:
    """A film of one game per protocol, between a scripted proposer and a verifier that knows the truth."""
    for protocol in PROTOCOLS:
        frames = game_frames(protocol, seed=GAME_SEED)
        save_gif(PICTURES / f"game_{protocol}.gif", frames)


def game_frames(protocol: str, seed: int) -> list[UInt8Array]:
    """A game as rendered by mode "rgb_array"."""
    game = parallel_env(protocol=protocol, start="flipit", split=SPLIT, render_mode="rgb_array")
    rng = np.random.default_rng(seed)
    game.reset(seed=seed)
    players: dict[str, Partner] = dict(
        zip(AGENTS, (SCRIPTED[PROPOSERS.get(protocol, "helpful")], OracleVerifier()), strict=True)
    )
    frames = [np.asarray(game.render(), np.uint8)]
    while game.agents:
        seats = {agent: PartnerTurn(game.engine.games, role, rng) for agent, role in zip(AGENTS, Role, strict=True)}
        game.step({agent: _choice(players[agent], turn) for agent, turn in seats.items()})
        frames.append(np.asarray(game.render(), np.uint8))
    return frames


def _choice(partner: Partner, turn: PartnerTurn) -> int:
    """The only legal action if there is just one, such as waiting, otherwise the partner's choice."""
    legal = np.flatnonzero(turn.action_mask)
    return int(legal[0]) if len(legal) == 1 else int(partner(turn))


def draw_episode() -> None:
    _run("examples/first_steps.py", "--seed", "40", "--out", str(PICTURES / "episode.png"))


def draw_architecture() -> None:
    _run("scripts/draw_architecture.py", str(PICTURES / "architecture.svg"))


def logo() -> str:
    """A scene of Scatter as SVG."""
    scene = Scene.of(
        [Item(10, 58, Shape.CIRCLE, Colour.YELLOW, Size.LARGE), Item(60, 64, Shape.SQUARE, Colour.BLUE, Size.MEDIUM)],
        [Item(35, 12, Shape.TRIANGLE, Colour.BLACK, Size.LARGE), Item(35, 55, Shape.SQUARE, Colour.YELLOW, Size.LARGE)],
        [Item(16, 20, Shape.CIRCLE, Colour.BLUE, Size.MEDIUM), Item(54, 54, Shape.TRIANGLE, Colour.BLUE, Size.LARGE)],
    )
    make_appearance("scatter").check_scene(scene)
    parts: list[str] = []
    for index, box in enumerate(scene.boxes):
        parts.append(f'<rect x="{index * LOGO_PITCH + 1}" y="1" width="100" height="100" rx="10" fill="#f0f0ec"/>')
        parts += [_svg(item, index * LOGO_PITCH + 1 + item.x, 1 + item.y) for item in box.items]
    width = 2 * LOGO_PITCH + 102
    return _svg_file(width, 102, "lilgym_mp", parts)


def _svg(item: Item, x: int, y: int) -> str:
    """The item at (x, y)."""
    side, fill = item.side, "#{:02x}{:02x}{:02x}".format(*COLOUR_RGB[item.colour])
    match item.shape:
        case Shape.CIRCLE:
            form = f'circle cx="{x + side / 2:g}" cy="{y + side / 2:g}" r="{side / 2:g}"'
        case Shape.SQUARE:
            form = f'rect x="{x}" y="{y}" width="{side}" height="{side}"'
        case Shape.TRIANGLE:
            form = f'path d="M{x + side / 2:g} {y}l{side / 2:g} {side}h{-side}z"'
    return f'<{form} fill="{fill}" stroke="#555" stroke-width=".8"/>'


def badges() -> str:
    """Versions and licence, as pyproject.toml states them, as one SVG."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    facts = {"python": project["requires-python"], "licence": project["license"]}
    needed = [
        *project["dependencies"],
        *(one for extra in ("sb3", "pettingzoo") for one in project["optional-dependencies"][extra]),
    ]
    for name in ("gymnasium", "pettingzoo", "stable-baselines3"):
        facts[name] = next(text.removeprefix(name) for text in needed if text.startswith(name))
    parts, x = list[str](), 0.0
    for name, value in facts.items():
        for text, fill in ((name, "#555"), (value.replace(">=", "≥ "), "#0a7d43")):
            width = BADGE_CHARACTER * len(text) + 12
            parts.append(f'<rect x="{x:g}" width="{width:g}" height="20" fill="{fill}"/>')
            parts.append(f'<text x="{x + 6:g}" y="14" textLength="{width - 12:g}">{text}</text>')
            x += width
        x += 6
    style = "<style>text{font:11px Verdana,DejaVu Sans,sans-serif;fill:#fff}</style>"
    return _svg_file(x - 6, 20, ", ".join(f"{name} {value}" for name, value in facts.items()), [style, *parts])


def _svg_file(width: float, height: int, title: str, parts: Sequence[str]) -> str:
    size = f'width="{width:g}" height="{height}" viewBox="0 0 {width:g} {height}"'
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img"><title>{escape(title)}</title>',
            *parts,
            "</svg>\n",
        ]
    )


def draw_signs() -> None:
    """The logo and the badges."""
    (PICTURES / "logo.svg").write_text(logo())
    (PICTURES / "badges.svg").write_text(badges())


def draw_report() -> None:
    """The beginning of a report on the included agent and other policies, as Chromium shows it."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise SystemExit("no Chromium on the PATH")
    with tempfile.TemporaryDirectory() as name, chdir(name):
        policies = ["--policy", "expert", "random-type", "--configuration", "TowerScratch"]
        command(["evaluate", REPORTED, *policies, "--record", "results", "--optimal", "--device", "cpu"])
        command(["report", "results", "--out", "report"])
        address = Path("report", "index.html").resolve().as_uri()
        picture = f"--screenshot={PICTURES / 'report.png'}"
        subprocess.run([program, *CHROMIUM, picture, address], check=True, capture_output=True)


def draw_charts() -> None:
    """The charts of tables in docs/results that need no official data."""
    charts = {
        "results-ppo-curves.png": draw_results.curves(),
        "results-table-2-curves.png": draw_results.curves(draw_results.PAPER_CURVES),
        "results-figure-4.png": draw_results.curves(draw_results.REWARD_CURVES),
        "results-mean-reward.png": draw_results.rewards(),
        "proposer_verifier_curve.svg": draw_results.verifier_curve(),
        "reward_model_curves.svg": draw_results.reward_model_curves(),
        "llm_curve.png": draw_results.language_model(),
        "reliability.png": draw_results.calibration(),
    }
    for name, figure in charts.items():
        save(figure, PICTURES / name, Path(name).suffix[1:])


def _run(*command: str) -> None:
    subprocess.run([sys.executable, *command], cwd=ROOT, check=True)


DRAWN: dict[str, Callable[[], None]] = {
    "films": draw_films,
    "games": draw_games,
    "episode": draw_episode,
    "architecture": draw_architecture,
    "signs": draw_signs,
    "charts": draw_charts,
    "report": draw_report,
}
FILES = [  # made by DRAWN
    *(f"{configuration}.{ending}" for configuration in CONFIGURATIONS for ending in ("gif", "png")),
    *(f"game_{protocol}.gif" for protocol in PROTOCOLS),
    "agent.gif",
    "agent-dark.gif",
    "agent-phone.gif",
    "episode.png",
    "report.png",
    "llm_curve.png",
    "reliability.png",
    "reward_model_curves.svg",
    "proposer_verifier_curve.svg",
    "results-figure-4.png",
    "results-mean-reward.png",
    "results-ppo-curves.png",
    "results-table-2-curves.png",
    "architecture.svg",
    "logo.svg",
    "badges.svg",
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
