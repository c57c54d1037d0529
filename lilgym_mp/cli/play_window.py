"""`lilgym-mp play --window`: playing by mouse. Clicks are translated into the text commands of `play`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from PIL import Image, ImageDraw

from lilgym_mp.appearances import Appearance
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.cli.commands import BOXES, COLOURS, SHAPES, SIZES
from lilgym_mp.cli.session import Session
from lilgym_mp.envs.rendering import Window
from lilgym_mp.options import CommandError
from lilgym_mp.render.frames import FRAME_SHAPE, INK_RGB, MARGIN, PAPER_RGB, SCALE, caption_font
from lilgym_mp.scene import BOX_PITCH, BOX_SIDE, IMAGE_HEIGHT, IMAGE_WIDTH

FPS = 30
BUTTON_WIDTH, BUTTON_HEIGHT, GAP = 76, 30, 8  # pixels
MESSAGE_HEIGHT = 28
SELECTED_RGB, BUTTON_RGB, EDGE_RGB = (200, 219, 245), (240, 240, 240), (150, 150, 150)
LEFT_BUTTON, RIGHT_BUTTON = 1, 3  # pygame's numbers of the mouse buttons
COMMANDS = ("stop", "hint", "next", "back", "quit")
HELP = "Left button adds, right button removes. Keys: s stop, h hint, n next, b back, q quit."


class Button(NamedTuple):
    """A button below the picture."""

    word: str
    left: int
    top: int

    def contains(self, x: int, y: int) -> bool:
        return self.left <= x < self.left + BUTTON_WIDTH and self.top <= y < self.top + BUTTON_HEIGHT


@dataclass
class ControlPanel:
    """The buttons, the attributes selected for the next item, and the last message."""

    appearance: Appearance
    message: str = HELP
    selected: dict[int, str] = field(default_factory=dict)  # the selected word in each row of buttons

    def __post_init__(self) -> None:
        attributes: list[Sequence[str]] = [[*COLOURS]]
        if self.appearance.grid is not None:
            attributes += [[*SHAPES], [*SIZES]]
        self.attributes = attributes
        self.selected = {row: words[0] for row, words in enumerate(attributes)}
        top = FRAME_SHAPE[0] + GAP
        self.buttons = [
            Button(word, MARGIN + (BUTTON_WIDTH + GAP) * column, top + (BUTTON_HEIGHT + GAP) * row)
            for row, words in enumerate([*attributes, COMMANDS])
            for column, word in enumerate(words)
        ]

    @property
    def height(self) -> int:
        return self.buttons[-1].top + BUTTON_HEIGHT + MESSAGE_HEIGHT

    def click(self, x: int, y: int, button: int) -> str | None:
        """The command for a click, if any; a click on an attribute selects it."""
        word = next((shown.word for shown in self.buttons if shown.contains(x, y)), None)
        if word in COMMANDS:
            return word
        if word is not None:
            row = next(row for row, words in enumerate(self.attributes) if word in words)
            self.selected[row] = word
            return None
        cell = self._cell_at((x - MARGIN) // SCALE, (y - MARGIN) // SCALE)
        if cell is None or button not in (LEFT_BUTTON, RIGHT_BUTTON):
            return None
        return f"remove {cell}" if button == RIGHT_BUTTON else f"add {cell} {' '.join(self.selected.values())}"

    def _cell_at(self, x: int, y: int) -> str | None:
        """The cell or box at a native pixel, as named in commands; None outside of the boxes."""
        if not (0 <= x < IMAGE_WIDTH and 0 <= y < IMAGE_HEIGHT and x % BOX_PITCH < BOX_SIDE):
            return None
        if self.appearance.grid is None:
            return [*BOXES][x // BOX_PITCH]
        columns, rows = self.appearance.grid
        return f"{x * columns // IMAGE_WIDTH} {y * rows // IMAGE_HEIGHT}"

    def picture(self, frame: UInt8Array) -> UInt8Array:
        """(height, 784, 3) the frame above the buttons and the message."""
        image = Image.new("RGB", (FRAME_SHAPE[1], self.height), PAPER_RGB)
        image.paste(Image.fromarray(frame))
        pen, font = ImageDraw.Draw(image), caption_font()
        for word, left, top in self.buttons:
            corners = left, top, left + BUTTON_WIDTH - 1, top + BUTTON_HEIGHT - 1
            is_selected = word in self.selected.values()
            pen.rounded_rectangle(corners, 5, SELECTED_RGB if is_selected else BUTTON_RGB, EDGE_RGB)
            middle = left + BUTTON_WIDTH // 2, top + BUTTON_HEIGHT // 2
            pen.text(middle, word, fill=INK_RGB, font=font, anchor="mm")
        pen.text((MARGIN, self.height - MESSAGE_HEIGHT + 4), self.message, fill=INK_RGB, font=font)
        return np.asarray(image)


def play(session: Session, panel: ControlPanel) -> None:
    """Shows the session's picture and executes mouse and key commands until the person quits.

    Raises CommandError without pygame or without a display.
    """
    try:
        window = Window(FPS)
    except gym.error.DependencyNotInstalled as error:
        raise CommandError(str(error).replace('render_mode="human"', "--window")) from None
    pygame: Any = import_module("pygame")
    keys = {getattr(pygame, f"K_{word[0]}"): word for word in COMMANDS}
    try:
        while not session.is_over:
            window.show(panel.picture(session.picture))
            event = pygame.event.wait()
            command = None
            if event.type == pygame.QUIT:
                return
            if event.type == pygame.KEYDOWN:
                command = keys.get(event.key)
            elif event.type == pygame.MOUSEBUTTONDOWN:
                x, y = event.pos
                command = panel.click(x, y, event.button)
            if command is not None:
                panel.message = ""
                session.answer(command)
    except pygame.error as error:
        raise CommandError(f"cannot open a window: {error}; play without --window") from None
    finally:
        window.close()
