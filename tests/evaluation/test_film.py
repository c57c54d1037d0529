"""Episodes as GIFs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from lilgym_mp.evaluation import Episode, Settings
from lilgym_mp.evaluation.film import (
    LAST_FRAME_SECONDS,
    SUCCESS_RGB,
    TILE_HEIGHT,
    TILE_WIDTH,
    episode_frames,
    film_frames,
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
    assert [(frame.truth, frame.target) for frame in (start, added, stopped)] == [
        (False, True),
        (True, True),
        (True, True),
    ]
    assert (stopped.caption, stopped.rgb) == ("2. STOP: success, return +0.9", SUCCESS_RGB)
    assert "I can see a blue block." in start.task


def test_film_frames__waits_for_the_longest_episode(tmp_path: Path):
    films = [list(episode_frames(TOWER.make("dev"), episode)) for episode in (SEEN, UNSEEN, UNSEEN)]
    film_frames(tmp_path / "grid.gif", films, columns=2)
    with Image.open(tmp_path / "grid.gif") as film:
        assert film.size == (2 * TILE_WIDTH, 2 * TILE_HEIGHT)
        assert getattr(film, "n_frames", 1) == 3
        film.seek(2)
        assert film.info["duration"] == round(1000 * LAST_FRAME_SECONDS)
    assert [path.name for path in tmp_path.iterdir()] == ["grid.gif"]
