"""`lilgym-mp play --window`: clicks are translated into commands, and the window shows their effect."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.cli.play_window import LEFT_BUTTON, RIGHT_BUTTON, ControlPanel
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.render.frames import FRAME_SHAPE, MARGIN, SCALE

TOWER = Settings("TowerScratch").dynamics().appearance
SCATTER = Settings("ScatterFlipIt").dynamics().appearance


def pixel(x: int, y: int) -> tuple[int, int]:
    """Window coordinates of a native pixel."""
    return MARGIN + SCALE * x, MARGIN + SCALE * y


def press(panel: ControlPanel, word: str) -> str | None:
    (button,) = [one for one in panel.buttons if one.word == word]
    return panel.click(button.left + 3, button.top + 3, LEFT_BUTTON)


def test_click__names_the_box_of_a_tower():
    panel = ControlPanel(TOWER)
    assert panel.click(*pixel(50, 20), LEFT_BUTTON) == "add left yellow"
    assert press(panel, "blue") is None
    assert panel.click(*pixel(379, 99), LEFT_BUTTON) == "add right blue"
    assert panel.click(*pixel(140, 0), RIGHT_BUTTON) == "remove middle"


def test_click__names_the_cell_and_the_selected_attributes():
    panel = ControlPanel(SCATTER)
    for word in ("black", "triangle", "large"):
        assert press(panel, word) is None
    assert panel.click(*pixel(159, 39), LEFT_BUTTON) == "add 7 1 black triangle large"
    assert panel.click(*pixel(0, 99), RIGHT_BUTTON) == "remove 0 4"


@pytest.mark.parametrize("place", [(0, 0), pixel(120, 50), pixel(100, 0), pixel(139, 99), (783, 100)])
def test_click__outside_of_the_boxes_does_nothing(place: tuple[int, int]):
    assert ControlPanel(SCATTER).click(*place, LEFT_BUTTON) is None
    assert ControlPanel(SCATTER).click(*pixel(5, 5), 2) is None


def test_click__on_a_command_button_is_that_command():
    panel = ControlPanel(TOWER)
    assert [press(panel, word) for word in ("stop", "hint", "quit")] == ["stop", "hint", "quit"]


def test_picture__is_the_frame_above_the_buttons_with_the_selected_ones_highlighted():
    panel = ControlPanel(SCATTER)
    frame = np.full(FRAME_SHAPE, 7, np.uint8)
    before = panel.picture(frame)
    assert before.shape == (panel.height, FRAME_SHAPE[1], 3)
    assert (before[: FRAME_SHAPE[0]] == 7).all()
    press(panel, "blue")
    changed = np.argwhere((panel.picture(frame) != before).any(2))
    assert (changed[:, 0].min(), changed[:, 0].max()) >= (FRAME_SHAPE[0], FRAME_SHAPE[0])


@pytest.fixture
def clicked(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sends events to a window without a display."""
    pygame: Any = pytest.importorskip("pygame", reason="needs the extra human")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")

    def give(events: Sequence[Any]) -> None:
        waiting: Iterator[Any] = iter([*events, pygame.event.Event(pygame.QUIT)])
        monkeypatch.setattr("pygame.event.wait", lambda: next(waiting))

    return pygame, give


def test_play_window__plays_an_episode_by_mouse(clicked: Any, capsys: pytest.CaptureFixture[str]):
    pygame, give = clicked
    down, key = pygame.MOUSEBUTTONDOWN, pygame.KEYDOWN
    (blue,) = [one for one in ControlPanel(TOWER).buttons if one.word == "blue"]
    give(
        [
            pygame.event.Event(down, pos=(blue.left + 1, blue.top + 1), button=LEFT_BUTTON),
            pygame.event.Event(down, pos=pixel(10, 10), button=LEFT_BUTTON),
            pygame.event.Event(key, key=pygame.K_x),
            pygame.event.Event(key, key=pygame.K_h),
            pygame.event.Event(key, key=pygame.K_s),
            pygame.event.Event(pygame.MOUSEMOTION, pos=(1, 1), rel=(0, 0), buttons=(0, 0, 0)),
        ]
    )
    words = ["play", "TowerScratch", "--split", "dev", "--task", "tower-dev-001", "--window"]
    assert main(words) == 0
    assert capsys.readouterr().out == "1 of 1 episodes succeeded, reward +0.9\n"


def test_play_window__q_quits(clicked: Any, capsys: pytest.CaptureFixture[str]):
    pygame, give = clicked
    give([pygame.event.Event(pygame.KEYDOWN, key=pygame.K_q), pygame.event.Event(pygame.KEYDOWN, key=pygame.K_s)])
    assert main(["play", "ScatterScratch", "--seed", "1", "--window"]) == 0
    assert capsys.readouterr().out.startswith("no episode completed")


def test_play_window__without_pygame_names_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["play", "--window"]) == USAGE_ERROR
    assert capsys.readouterr().err.startswith("lilgym-mp play: --window needs pygame: pip install")
