"""The features extractor of the example for Stable-Baselines3."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from gymnasium import spaces
from train_masked_ppo import EVERY, FIRST, StatementAndBoxes

from lilgym_mp.scene import Colour
from lilgym_mp.scene.render import draw
from tests.scenes import scene, tower


@pytest.fixture
def extractor() -> StatementAndBoxes:
    torch.manual_seed(0)
    image, statement = spaces.Box(0, 255, (3, 10, 38), np.uint8), spaces.Box(0, 9, (6,), np.int64)
    return StatementAndBoxes(spaces.Dict({"image": image, "statement": statement}), words=9).eval()


def features(extractor: StatementAndBoxes, statement: list[int], target: int = 1) -> torch.Tensor:
    torch.manual_seed(1)
    inputs = {
        "image": torch.rand(1, 3, 10, 38),
        "statement": torch.tensor([statement]),
        "target": torch.tensor([[target]]),
    }
    with torch.inference_mode():
        return extractor(inputs)


def test_extractor__tells_statements_word_orders_and_targets_apart_but_ignores_padding(extractor: StatementAndBoxes):
    read = features(extractor, [2, 3, 4, 5])
    assert torch.allclose(features(extractor, [2, 3, 4, 5, 0, 0]), read, atol=1e-6)
    for other in (
        features(extractor, [2, 3, 4, 6]),
        features(extractor, [4, 3, 2, 5]),
        features(extractor, [2, 3, 4, 5], 0),
    ):
        assert not torch.allclose(other, read, atol=1e-3)


def test_few_pixels__tell_all_towers_apart():
    towers = [tower(*colours) for height in range(5) for colours in itertools.product(Colour, repeat=height)]
    images = {draw(scene(middle=items), "half")[FIRST::EVERY, FIRST::EVERY].tobytes() for items in towers}
    assert len(images) == len(towers) == 121
