"""Episodes as GIFs."""

import numpy as np
import pytest
from PIL import Image, ImageFont, ImageSequence

from lilgym_mp.evaluation import Episode, Settings
from lilgym_mp.evaluation.film import (
    DARK_RGB,
    PAPER_RGB,
    SUCCESS_RGB,
    TILE_HEIGHT,
    TILE_WIDTH,
    episode_frames,
    film_frames,
    save_gif,
)
from lilgym_mp.scene import Colour
from lilgym_mp.scene.actions import STOP, AddBlock
from lilgym_mp.scene.render.frames import smooth_picture
from tests.scenes import B, scene, tower

TOWER = Settings("TowerScratch")
FIRST = "tower-dev-001"  # "I can see a blue block."
TASK = TOWER.tasks("dev").by_id(FIRST)
SEEN = Episode.of(TASK, [AddBlock(0, Colour.BLUE), STOP], "success", TOWER.dynamics())
UNSEEN = Episode.of(TASK, [STOP], "wrong_stop", TOWER.dynamics())


def test_episode_frames__show_the_start_and_each_action():
    start, added, stopped = episode_frames(TOWER.make("dev"), SEEN)
    assert np.array_equal(start.picture, smooth_picture(scene(), 1))
    assert np.array_equal(added.picture, smooth_picture(scene(tower(B)), 1))
    assert added.caption == "1. ADD(LEFT, BLUE)"
    assert [frame.truth for frame in (start, added, stopped)] == [False, True, True]
    assert {frame.target for frame in (start, added, stopped)} == {True}
    assert (stopped.caption, stopped.rgb) == ("2. STOP: success, return +0.9", SUCCESS_RGB)
    assert "I can see a blue block." in start.task
    font = ImageFont.load_default(15)
    failed = list(episode_frames(TOWER.make("dev"), UNSEEN))[-1].caption
    assert failed == "1. STOP: wrong STOP, return -1.0"
    drawn = {letter: bytes(font.getmask(letter)) for letter in failed.replace(" ", "")}
    assert bytes(font.getmask("\N{OBJECT REPLACEMENT CHARACTER}")) not in drawn.values()  # the font has each


def test_film_frames__waits_for_the_longest_episode(tmp_path):
    films = [list(episode_frames(TOWER.make("dev"), episode)) for episode in (SEEN, UNSEEN, UNSEEN)]
    film_frames(tmp_path / "grid.gif", films, columns=2)
    with Image.open(tmp_path / "grid.gif") as film:
        assert film.size == (2 * TILE_WIDTH, 2 * TILE_HEIGHT)
        assert getattr(film, "n_frames", 1) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["grid.gif"]


@pytest.mark.parametrize(
    ("count", "milliseconds"), [(3, [1500, 1000, 1000]), (7, [1110, *[740] * 6]), (30, [750, *[500] * 29])]
)
def test_save_gif__plays_once_and_moves_for_less_than_five_seconds_if_short(tmp_path, count, milliseconds):
    save_gif(tmp_path / "film.gif", [np.full((4, 4, 3), 8 * index, np.uint8) for index in range(count)])
    with Image.open(tmp_path / "film.gif") as film:
        assert "loop" not in film.info
        assert [frame.info["duration"] for frame in ImageSequence.Iterator(film)] == milliseconds


@pytest.mark.parametrize(("dark", "paper"), [(False, PAPER_RGB), (True, DARK_RGB[PAPER_RGB])])
def test_film_frames__have_paper_for_the_page(tmp_path, dark, paper):
    film_frames(tmp_path / "one.gif", [list(episode_frames(TOWER.make("dev"), SEEN))], columns=1, dark=dark)
    with Image.open(tmp_path / "one.gif") as film:
        assert film.convert("RGB").getpixel((0, 0)) == paper
