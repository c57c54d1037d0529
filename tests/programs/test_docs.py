"""docs/programs.md matches the code."""

import re

import pytest

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene
from tests.scripts import ROOT, load_script


@pytest.fixture(scope="module")
def generator():
    return load_script("generate_program_docs")


def test_program_docs__are_up_to_date(generator):
    written = (ROOT / "docs" / "programs.md").read_text()
    assert written == generator.document(), "run scripts/generate_program_docs.py"


def test_program_docs__examples_are_programs(generator):
    examples = re.findall(r"^```\n((?:exist|count).*)\n```$", generator.document(), re.MULTILINE)
    assert len(examples) == 3
    for source in examples:
        program = compile_program(source)
        assert program.has_generated_code
        assert program.evaluate(Scene.empty()) is False
