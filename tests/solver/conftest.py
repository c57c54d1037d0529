"""A small corpus, so that solving a whole split is fast."""

import pytest

from lilgym_mp.corpus import write_corpus
from tests.corpora import entry
from tests.scenes import scene_of

TOWERS = ("", "tower b | tower ky | tower bbk", "tower y | tower y | tower y")
SCATTERED = (
    "",
    "circle 0,0 large blue; square 40,40 black | triangle 5,60 small | square 80,80 blue",
    "circle 0,70 large | circle 33,33 blue; circle 70,0 large blue | triangle 50,50 large black",
)
STATEMENTS = (
    ("tower", "A blue block is there.", "exist(filter_color(all_items, Color.BLUE))", TOWERS),
    ("tower", "Two towers have two blocks.", "count(filter_obj(all_boxes, lambda b: count(b) == 2)) == 2", TOWERS),
    (
        "tower",
        "Each tower has black on top.",
        "count(filter_obj(all_items, lambda x: is_top(x) and is_black(x))) == 3",
        TOWERS,
    ),
    (
        "scatter",
        "Three circles are blue.",
        "count(filter_obj(all_items, lambda x: is_blue(x) and is_circle(x))) == 3",
        SCATTERED,
    ),
    (
        "scatter",
        "A small thing lies in a corner.",
        "exist(filter_obj(all_items, lambda x: is_small(x) and is_touching_corner(x)))",
        SCATTERED,
    ),
    (
        "scatter",
        "Black is below yellow.",
        "exist(filter_obj(all_items, lambda x: is_yellow(x) and exist(filter_color(get_below(x), Color.BLACK))))",
        SCATTERED,
    ),
)


def corpus_entries(split):
    return [
        entry(
            *(f"{split}-{index}", appearance, split, *told),
            **{str(number): scene_of(start).to_json() for number, start in enumerate(starts)},
        )
        for index, (appearance, *told, starts) in enumerate(STATEMENTS)
    ]


@pytest.fixture(scope="session")
def corpus(tmp_path_factory):
    """The path of the corpus: for each appearance three statements with three starts each, in train and in dev."""
    path = tmp_path_factory.mktemp("corpus") / "own.jsonl"
    write_corpus(path, "own", "MIT", corpus_entries("train") + corpus_entries("dev"))
    return str(path)
