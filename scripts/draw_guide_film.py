"""Draws a film of a builder and a guide: `python scripts/draw_guide_film.py BUILDER GUIDE`, two runs of `train game`.

The game is that of the guide's run on builtin dev, actions are the most probable ones. Each frame shows an exchange, at
the left what the builder sees and does, at the right the guide, with its messages in words.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lilgym_mp.contrib.llm.game_text import message_name
from lilgym_mp.envs.proposer_verifier import GameSettings, Partner, PartnerTurn, Role
from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
from lilgym_mp.evaluation.film import (
    BORDER,
    FONT_PIXELS,
    INK_RGB,
    LINE_HEIGHT,
    MARGIN,
    PAPER_RGB,
    PENDING_RGB,
    SUCCESS_RGB,
    TILE_WIDTH,
    save_gif,
    wrap_text,
)
from lilgym_mp.learning.common.agents import open_agent
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import IMAGE_HEIGHT, IMAGE_WIDTH, Scene
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.render.frames import smooth_picture

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "game_guide.gif"
HEAD_LINES = FOOT_LINES = 3
EXCHANGES = range(3, 10)  # of the game that is shown: of those with a refusal and a success, the most direct one


class Exchange(NamedTuple):
    """A proposal and its answer, "" if it needed none."""

    scene: Scene
    heard: str
    proposed: str
    answer: str = ""
    said: str = ""


def play(env: BaseGameEnv, players: tuple[Partner, Partner], task: str) -> tuple[list[Exchange], str]:
    """The exchanges of a game, and its outcome."""
    engine, rng = env.engine, np.random.default_rng(0)
    engine.reset(0, {"task": task})
    game, games = engine.game, engine.games
    found: list[Exchange] = []
    heard = "nothing"
    while engine.movers:
        (role,) = engine.movers
        action = int(players[role](PartnerTurn(games, role, rng)))
        name = game.describe(role, action)
        if role is Role.PROPOSER:
            found.append(Exchange(games.mdp(0).scene, heard, name))
            engine.step(action, None)
        else:
            heard = message_name(game, role, action % (game.message_sizes[role] + 1))
            found[-1] = found[-1]._replace(answer=name.partition(",")[0], said=heard)
            engine.step(None, action)
    return found, str(games.last_outcome(0))


def is_shown(exchanges: Sequence[Exchange], outcome: str) -> bool:
    """Whether a game is short, succeeds, and has a refusal."""
    return outcome == "success" and len(exchanges) in EXCHANGES and any(each.answer == "reject" for each in exchanges)


def needless(exchanges: Sequence[Exchange], task: Task) -> int:
    """How many exchanges begin in a scene in which the goal was reached, besides the last."""
    return sum(task.solved_by(each.scene) for each in exchanges[:-1])


def frames(exchanges: Sequence[Exchange], statement: str) -> Iterator[UInt8Array]:
    """A picture of each exchange of a game that succeeds."""
    for each in exchanges:
        rgb, end = PENDING_RGB, ""
        if each is exchanges[-1]:
            rgb, end = SUCCESS_RGB, "The game ends: success."
        builder = ["The builder sees only the scene", f"and has heard: {each.heard}"]
        guide = ["The guide also sees:", f'"{statement}" (make it true)']
        answer = [f"It {each.answer}s, and says: {each.said}", end]
        yield np.hstack(
            [
                tile(each.scene, builder, [f"It proposes: {each.proposed}"], rgb),
                tile(each.scene, guide, answer if each.answer else ["(no answer is needed)", end], rgb),
            ]
        )


def tile(scene: Scene, head: Sequence[str], foot: Sequence[str], rgb: tuple[int, int, int]) -> UInt8Array:
    """The scene between lines of text."""
    image = Image.new(
        "RGB", (TILE_WIDTH, IMAGE_HEIGHT + (HEAD_LINES + FOOT_LINES) * LINE_HEIGHT + 3 * MARGIN), PAPER_RGB
    )
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(FONT_PIXELS)
    top = 2 * MARGIN + HEAD_LINES * LINE_HEIGHT
    for start, texts in ((MARGIN, head), (top + IMAGE_HEIGHT + BORDER, foot)):
        lines = [line for text in texts for line in wrap_text(text, IMAGE_WIDTH, pen, font)]
        for row, line in enumerate(lines):
            pen.text((MARGIN, start + row * LINE_HEIGHT), line, INK_RGB, font)
    edge = MARGIN - BORDER
    pen.rectangle((edge, top - BORDER, edge + IMAGE_WIDTH + 2 * BORDER - 1, top + IMAGE_HEIGHT + BORDER - 1), rgb)
    image.paste(Image.fromarray(smooth_picture(scene, 1)), (MARGIN, top))
    return np.asarray(image)


def main() -> None:
    parser = argparse.ArgumentParser(description="Draws a film of a builder and a guide.")
    parser.add_argument("builder", type=Path, metavar="BUILDER", help="a run of `train game` that learned to build")
    parser.add_argument("guide", type=Path, metavar="GUIDE", help="a run of `train game` that learned to speak to it")
    parser.add_argument("--out", type=Path, default=PICTURE, metavar="FILE", help="the film (default: %(default)s)")
    args = parser.parse_args()
    builder, guide = open_agent(args.builder, "cpu"), open_agent(args.guide, "cpu")
    assert isinstance(guide.game, GameSettings)
    settings = replace(guide.game, corpus="builtin", split="dev")
    players = builder.partner(Role.PROPOSER, settings), guide.partner(Role.VERIFIER, settings)
    if players[0] is None or players[1] is None:
        parser.error("BUILDER must have a trained proposer, GUIDE a trained verifier")
    env = BaseGameEnv(**vars(settings))
    games = ((task, *play(env, (players[0], players[1]), task.id)) for task in env.tasks)
    shown = [(task, exchanges) for task, exchanges, outcome in games if is_shown(exchanges, outcome)]
    if not shown:
        raise SystemExit("no game of builtin dev is short, with a refusal and a success")
    task, exchanges = min(shown, key=lambda game: (needless(game[1], game[0]), len(game[1])))
    save_gif(args.out, frames(exchanges, task.statement))
    print(f"{args.out}: task {task.id}")


if __name__ == "__main__":
    main()
