"""Programs against the recorded truths of the release and the labels of the official data."""

import gzip
import json
import random

import pytest

from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.scene import Scene


def outcome(evaluate, scene):
    """The value, or the message of the failure."""
    try:
        return evaluate(scene)
    except ProgramRuntimeError as fault:
        return str(fault)


@pytest.fixture(scope="module")
def recorded_truths(golden):
    with gzip.open(golden / "program_truths.json.gz", "rt") as file:
        return json.load(file)


@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_program_truths__of_both_evaluators_equal_the_recorded_ones(recorded_truths, appearance):
    recorded = recorded_truths[appearance]
    scenes = [Scene.from_json(scene) for scene in recorded["scenes"]]
    for source, truths in zip(recorded["programs"], recorded["truths"], strict=True):
        program = compile_program(source)
        assert "".join(str(int(program.evaluate(scene))) for scene in scenes) == truths, source
        some = slice(len(source) % 8, None, 8)  # of the scenes: others for other programs
        assert "".join(str(int(program.evaluate_reference(scene))) for scene in scenes[some]) == truths[some], source


@pytest.mark.parametrize("split", [pytest.param("train", marks=pytest.mark.long), "dev"])
@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_labels__equal_the_truth_in_the_start_scene(official_data, appearance, split):
    records = json.loads((official_data / f"{appearance}_flipit_{split}.json").read_text())
    for identifier, record in records.items():
        program = compile_program(record["lf"])
        assert program(Scene.from_json(record["structured_rep"])) is (record["label"] == "true"), identifier
        assert not program.errors, identifier


def test_official_programs__both_forms_agree_and_nearly_all_have_generated_code(official_data):
    chance = random.Random(0)
    sources = {}
    scenes = []
    for path in sorted(official_data.glob("*_*_*.json")):
        for record in json.loads(path.read_text()).values():
            sources[record["lf"]] = None
            if "structured_rep" in record and chance.random() < 0.02:
                scenes.append(Scene.from_json(record["structured_rep"]))
    for source in sources:
        program = compile_program(source)
        left, middle, right = chance.sample(scenes, 3)
        mixed = Scene.of(left.boxes[0].items, middle.boxes[1].items, right.boxes[2].items)
        for scene in (mixed, mixed.permuted((2, 0, 1))):
            assert outcome(program.evaluate, scene) == outcome(program.evaluate_reference, scene), source
    assert sum(compile_program(source).has_generated_code for source in sources) / len(sources) > 0.99
