"""A corpus of a few statements that a small network learns in seconds."""

import pytest

from lilgym_mp.corpus import write_corpus
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.imitation.learner import ImitationRecipe
from tests.corpora import BLACK_BLOCK, BLUE_BLOCK, CIRCLE, entry
from tests.json_files import read_json_lines

SMALL = {
    "pretraining": 0.0,
    "width": 32,
    "text_layers": 1,
    "item_layers": 1,
    "dropout": 0.0,
    "statements": 4,
    "held_out": 0.0,
    "unknown_words": 0.0,
    "learning_rate": 5e-3,
}
BLACK_CIRCLE = {**CIRCLE, "color": "Black"}
STATEMENTS = {
    "tower": [
        ("Some block is blue.", "exist(filter_color(all_items, Color.BLUE))"),
        ("No block is black.", "not exist(filter_color(all_items, Color.BLACK))"),
        ("Exactly two blocks are yellow.", "count(filter_color(all_items, Color.YELLOW)) == 2"),
    ],
    "scatter": [
        ("There is a black item.", "exist(filter_color(all_items, Color.BLACK))"),
        ("There is a circle.", "exist(filter_shape(all_items, Shape.CIRCLE))"),
        ("There is no triangle.", "not exist(filter_shape(all_items, Shape.TRIANGLE))"),
    ],
}
SCENES = {
    "tower": {"0": [[BLUE_BLOCK], [], []], "1": [[BLACK_BLOCK], [], []], "2": [[BLUE_BLOCK], [BLACK_BLOCK], []]},
    "scatter": {"0": [[CIRCLE], [], []], "1": [[], [BLACK_CIRCLE], []]},
}


@pytest.fixture(scope="session")
def statements(tmp_path_factory):
    """The path of a corpus with three statements per appearance, the same in train and dev."""
    path = tmp_path_factory.mktemp("imitation") / "statements.jsonl"
    entries = [
        entry(f"{appearance}-{split}-{number}", appearance, split, *told, **SCENES[appearance])
        for appearance, pairs in STATEMENTS.items()
        for split in ("train", "dev")
        for number, told in enumerate(pairs)
    ]
    write_corpus(path, "our own statements", "as this package", entries)
    return str(path)


@pytest.fixture
def settings(statements):
    """Settings of that corpus."""
    return Settings("TowerFlipIt", corpus=statements)


def small_recipe(settings, **changes):
    return ImitationRecipe.of(settings.configuration, **{**SMALL, **changes})


def progress_lines(out):
    return read_json_lines(out / "progress.jsonl")
