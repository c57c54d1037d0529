"""Episodes as animated GIFs: one, or several side by side, with their statements and outcomes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation.episodes import Episode, outcome_words, scenes
from lilgym_mp.evaluation.files import write_atomically
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import IMAGE_HEIGHT, IMAGE_WIDTH, Scene
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.render.frames import smooth_picture

MOVING_SECONDS = 4.8  # at most, so that short films need no pause button (WCAG 2.2.2 begins at 5 seconds)
FIRST_FRAME_SHARE = 1.5  # times as long as the next ones
FRAME_SECONDS = (0.5, 1.0)  # shortest and longest

FONT_PIXELS = 14
LINE_HEIGHT = 18
STATEMENT_LINES = 2
MARGIN = 8
BORDER = 4
TILE_WIDTH = IMAGE_WIDTH + 2 * MARGIN
TILE_HEIGHT = IMAGE_HEIGHT + (STATEMENT_LINES + 2) * LINE_HEIGHT + 3 * MARGIN
PAPER_RGB = (255, 255, 255)
INK_RGB = (30, 30, 30)
GOAL_WIDTH = 90  # pixels
MISSED_RGB = (200, 90, 0)
PENDING_RGB = (222, 222, 222)
SUCCESS_RGB = (0, 140, 60)
FAILURE_RGB = (200, 40, 30)
# Pixels
SCORE_WIDTH = 1000
SCORE_HEAD = 120
SCORE_ROW = 68
ACTION_WIDTH = 16
SCORE_COLUMNS = (24, 232, 700)  # left edges of scenes, tasks and bars
DARK_RGB = {  # what a film on a dark page has instead
    PAPER_RGB: (13, 17, 23),
    INK_RGB: (230, 237, 243),
    PENDING_RGB: (70, 76, 84),
    MISSED_RGB: (240, 150, 70),
    SUCCESS_RGB: (70, 190, 100),
    FAILURE_RGB: (255, 110, 100),
}
PLAYER_RGB = ((0, 114, 178), (213, 94, 0), (140, 140, 140))


RGB = tuple[int, int, int]


class FilmFrame(NamedTuple):
    """One frame of an episode."""

    picture: UInt8Array  # (100, 380, 3), antialiased
    task: str  # statement and target as text
    caption: str  # last action, and the outcome at the end
    rgb: RGB  # colour of caption and border
    truth: bool  # of the statement in the picture
    target: bool


def episode_frames(env: LilGymEnv, episode: Episode) -> Iterator[FilmFrame]:
    """A frame for the start and one for each action of an episode in the environment."""
    program = compile_program(episode.program)
    task = f'"{episode.statement}"'
    last = len(episode.actions)
    for step, scene in enumerate(scenes(env.dynamics, episode.start, episode.actions)):
        caption = f"{step}. {describe(episode.actions[step - 1])}" if step else ""
        rgb = PENDING_RGB
        if step == last:
            rgb = SUCCESS_RGB if episode.is_success else FAILURE_RGB
            caption += f": {outcome_words(episode.outcome)}, return {episode.reward:+.1f}"
        yield FilmFrame(smooth_picture(scene, 1), task, caption, rgb, program(scene), episode.target)


def film_frames(path: Path, films: Sequence[Sequence[FilmFrame]], columns: int, *, dark: bool = False) -> None:
    """Writes a GIF of films in a grid; each stays on its last frame until all have ended."""
    shown = DARK_RGB if dark else {rgb: rgb for rgb in DARK_RGB}
    length = max(map(len, films))
    moments = ([film[min(index, len(film) - 1)] for film in films] for index in range(length))
    save_gif(path, (_grid(frames, columns, shown) for frames in moments))


def _grid(frames: Sequence[FilmFrame], columns: int, shown: Mapping[RGB, RGB]) -> UInt8Array:
    rows = -(-len(frames) // columns)
    image = Image.new("RGB", (columns * TILE_WIDTH, rows * TILE_HEIGHT), shown[PAPER_RGB])
    for index, frame in enumerate(frames):
        row, column = divmod(index, columns)
        image.paste(_tile(frame, shown), (column * TILE_WIDTH, row * TILE_HEIGHT))
    return np.asarray(image)


def _tile(frame: FilmFrame, shown: Mapping[RGB, RGB]) -> Image.Image:
    tile = Image.new("RGB", (TILE_WIDTH, TILE_HEIGHT), shown[PAPER_RGB])
    pen = ImageDraw.Draw(tile)
    font = ImageFont.load_default(FONT_PIXELS)
    lines = wrap_text(frame.task, IMAGE_WIDTH, pen, font)[:STATEMENT_LINES]
    for row, line in enumerate(lines, STATEMENT_LINES - len(lines)):
        pen.text((MARGIN, MARGIN + row * LINE_HEIGHT), line, fill=shown[INK_RGB], font=font)
    top = MARGIN + STATEMENT_LINES * LINE_HEIGHT + BORDER
    border = (MARGIN - BORDER, top - BORDER, MARGIN + IMAGE_WIDTH + BORDER - 1, top + IMAGE_HEIGHT + BORDER - 1)
    pen.rectangle(border, fill=shown[frame.rgb])
    tile.paste(Image.fromarray(frame.picture), (MARGIN, top))
    ink = INK_RGB if frame.rgb == PENDING_RGB else frame.rgb
    bottom = top + IMAGE_HEIGHT + BORDER + 2
    pen.text((MARGIN, bottom), frame.caption, fill=shown[ink], font=font)
    goal = f"goal: {str(frame.target).lower()}"
    now = f"now: {str(frame.truth).lower()}"
    rgb = SUCCESS_RGB if frame.truth == frame.target else MISSED_RGB
    pen.text((MARGIN, bottom + LINE_HEIGHT), goal, fill=shown[INK_RGB], font=font)
    pen.text((MARGIN + GOAL_WIDTH, bottom + LINE_HEIGHT), now, fill=shown[rgb], font=font)
    return tile


def wrap_text(
    text: str, width: int, pen: ImageDraw.ImageDraw, font: ImageFont.FreeTypeFont | ImageFont.ImageFont
) -> list[str]:
    """The text in lines no wider than `width` pixels, broken between words; a single word may be wider."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and pen.textlength(longer, font=font) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def save_gif(path: Path, frames: Iterable[UInt8Array]) -> None:
    """Writes a GIF that plays once and stays on its last frame; `frames` are (height, width, 3) of one size.

    Writes atomically. The film moves for at most MOVING_SECONDS, unless that leaves less than half a second to a frame.
    """
    images = [Image.fromarray(frame).quantize(64, dither=Image.Dither.NONE) for frame in frames]
    first, *rest = images
    least, most = FRAME_SECONDS
    each = min(most, max(least, MOVING_SECONDS / (len(rest) - 1 + FIRST_FRAME_SHARE)))
    seconds = [FIRST_FRAME_SHARE * each, *[each] * len(rest)]
    write_atomically(
        path,
        lambda temporary: first.save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=rest,
            duration=[10 * round(100 * shown) for shown in seconds],
        ),
    )


class ScoreLine(NamedTuple):
    """A task in `score_picture`."""

    task: str
    scene: Scene  # in which somebody stopped
    actions: tuple[int | None, ...]  # by player; None: not solved


def score_picture(heading: Sequence[str], players: Sequence[str], lines: Sequence[ScoreLine]) -> Image.Image:
    """Tasks with their scenes, and bars as long as the players' actions, below two lines of text."""
    image = Image.new("RGB", (SCORE_WIDTH, SCORE_HEAD + SCORE_ROW * len(lines) + MARGIN), PAPER_RGB)
    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(FONT_PIXELS - 1)
    for y, line, pixels in zip((18, 62), heading, (30, 17), strict=True):
        pen.text((SCORE_COLUMNS[0], y), line, INK_RGB, ImageFont.load_default(pixels))
    left = SCORE_COLUMNS[2]
    for player, rgb in zip(players, PLAYER_RGB, strict=False):
        pen.rectangle((left, 97, left + 10, 107), rgb)
        pen.text((left + 16, 94), player, INK_RGB, font)
        left += 36 + round(pen.textlength(player, font))
    for top, line in zip(range(SCORE_HEAD, image.height, SCORE_ROW), lines, strict=False):
        scene = Image.fromarray(smooth_picture(line.scene, 1)).resize((190, 50), Image.Resampling.LANCZOS)
        image.paste(scene, (SCORE_COLUMNS[0], top))
        for row, text in enumerate(wrap_text(line.task, 440, pen, font)[:3]):
            pen.text((SCORE_COLUMNS[1], top + 17 * row), text, INK_RGB, font)
        for row, (count, rgb) in enumerate(zip(line.actions, PLAYER_RGB, strict=False)):
            y = top + 17 * row
            end = SCORE_COLUMNS[2] + ACTION_WIDTH * (count or 0)
            pen.rectangle((SCORE_COLUMNS[2], y + 2, end, y + 12), rgb)
            pen.text((end + 6, y), "not solved" if count is None else str(count), INK_RGB, font)
    return image
