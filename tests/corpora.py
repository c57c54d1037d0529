"""Small corpora of our own statements."""

import copy
import gzip
import json

from lilgym_mp.corpus import write_corpus
from lilgym_mp.corpus.official import FileFacts, content_digest, read_released_file
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene
from tests.scenes import B, K, Y, scene, square, tower
from tests.scripts import ROOT

BUILTIN = ROOT / "data" / "builtin.jsonl.gz"
BLUE_BLOCK = {"x_loc": 40, "y_loc": 80, "type": "square", "color": "#0099ff", "size": 20}
BLACK_BLOCK = {**BLUE_BLOCK, "color": "Black"}
CIRCLE = {"x_loc": 0, "y_loc": 70, "type": "circle", "color": "Yellow", "size": 30}
TRIANGLE = {"x_loc": 60, "y_loc": 5, "type": "triangle", "color": "#0099ff", "size": 10}


def entry(name, appearance, split, statement, program, **starts):
    """A corpus entry; `starts`: scenes as JSON, by what their ids end with."""
    truth = compile_program(program)
    return {
        "id": name,
        "appearance": appearance,
        "split": split,
        "statement": statement,
        "program": program,
        "starts": [
            {"id": f"{name}-{end}", "label": truth(Scene.from_json(scene)), "scene": scene}
            for end, scene in starts.items()
        ],
    }


_BLUE = "exist(filter_color(all_items, Color.BLUE))"
_BLACK = "exist(filter_color(all_items, Color.BLACK))"
_ROUND = "exist(filter_shape(all_items, Shape.CIRCLE))"
BLUE = entry(
    *("blue", "tower", "train", "Blue is here.", _BLUE),
    yes=[[BLACK_BLOCK], [BLUE_BLOCK], []],
    no=[[BLACK_BLOCK], [], []],
)
PAIR = entry("pair", "tower", "train", "Two blocks, it's all.", "count(all_items) == 2", no=[[BLUE_BLOCK], [], []])
BLACK = entry("black", "tower", "dev", "Black is seen somewhere.", _BLACK, yes=[[], [], [BLACK_BLOCK]])
ROUND = entry(
    *("round", "scatter", "train", "Something round.", _ROUND),
    yes=[[], [CIRCLE, TRIANGLE], []],
    no=[[TRIANGLE], [], []],
)
ROUND_IN_DEV = {**ROUND, "split": "dev", "starts": ROUND["starts"][:1]}


def small_entries():
    """Three entries, which the caller may change: two of Tower's train, one of Scatter's dev."""
    return copy.deepcopy([BLUE, PAIR, ROUND_IN_DEV])


def write_thin_corpus(path, step):
    """Writes every `step`-th statement of the builtin corpus and returns the path."""
    _, *lines = gzip.decompress(BUILTIN.read_bytes()).splitlines()
    write_corpus(path, "thin", "MIT", map(json.loads, lines[::step]))
    return path


def write_released(directory):
    """Writes the Tower test split in the released file format and returns its directory."""
    directory.mkdir()
    blue, pair, _ = small_entries()
    scratch = {"7": {"sentence": blue["statement"], "lf": blue["program"]}}
    (directory / "tower_scratch_test.json").write_text(json.dumps(scratch))
    flipit = {
        start["id"]: {
            "sentence": entry["statement"],
            "lf": entry["program"],
            "label": str(start["label"]).lower(),
            "structured_rep": start["scene"],
            "identifier": entry["id"],
        }
        for entry in (blue, pair)
        for start in entry["starts"]
    }
    (directory / "tower_flipit_test.json").write_text(json.dumps(flipit))
    return directory


def register_as_official(directory, monkeypatch):
    """Registers `write_released`'s files as official, one by digest and one by counts."""
    names = ("tower_scratch_test.json", "tower_flipit_test.json")
    (records,) = read_released_file(directory / names[0], []).records.values()
    facts = {names[0]: FileFacts(1, 1, content_digest(records)), names[1]: FileFacts(3, 3)}
    for module in ("cli.data_report", "corpus.official"):  # the first, when imported, copies those of the second
        monkeypatch.setattr(f"lilgym_mp.{module}.FILE_FACTS", facts)


THREE_STATEMENTS = {
    "Some block is blue.": "exist(filter_color(all_items, Color.BLUE))",
    "Yellow can be seen.": "exist(filter_color(all_items, Color.YELLOW))",
    "There is a tower.": "exist(filter_obj(all_boxes, lambda b: count(b) >= 2))",
}


def write_statements(path, *statements):
    """Writes Tower statements without start scenes: split, text and program of t0, t1, ...; returns the path."""
    write_corpus(path, "own", "MIT", [entry(f"t{index}", "tower", *each) for index, each in enumerate(statements)])
    return path


def write_three_statements(path):
    """Writes three statements without start scenes, the same in train and dev, and returns the path."""
    return write_statements(path, *((split, *each) for split in ("train", "dev") for each in THREE_STATEMENTS.items()))


SPLITS = ("train", "dev", "test")
COLOURS = {Y: "yellow", K: "black", B: "blue"}
COLOURS_OF_SPLIT = {"train": (Y, K), "dev": (Y, B), "test": (B,)}


def write_own_corpus(path):
    """Writes the corpus and returns its path. A third of the dev statements occur verbatim in train."""
    entries = [
        entry
        for split in SPLITS
        for appearance, items in (("tower", tower), ("scatter", _corner_squares))
        for entry in [
            *(_has(split, appearance, colour, items) for colour in COLOURS_OF_SPLIT[split]),
            _counts(split, appearance, items),
        ]
    ]
    write_corpus(path, "own", "MIT", entries)
    return path


def _corner_squares(*colours):
    return [square(25 * index, 0, colour=colour) for index, colour in enumerate(colours)]


def _has(split, appearance, colour, items):
    name = COLOURS[colour]
    other = next(candidate for candidate in COLOURS if candidate != colour)
    return entry(
        *(f"{appearance}-{split}-has-{name}", appearance, split, f"There is something {name}."),
        f"exist(filter_color(all_items, Color.{name.upper()}))",
        yes=scene(items(colour)).to_json(),
        no=scene(items(other), items(other)).to_json(),
    )


def _counts(split, appearance, items):
    count = 1 + SPLITS.index(split)
    return entry(
        *(f"{appearance}-{split}-count", appearance, split, f"Count them: {count}.", f"count(all_items) == {count}"),
        yes=scene(items(*[Y] * count)).to_json(),
        no=scene().to_json(),
    )
