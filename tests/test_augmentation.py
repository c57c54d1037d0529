"""Recolouring: rewriting, refusals, and commuting with truth values and the rules."""

import random

import numpy as np
import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.scene_walks import ScenePool
from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.learning.common.augmentation import RECOLOURINGS, Recolouring, recolourable
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import Scatter, Tower
from tests.scenes import B, K, Y, scene, tower

ROTATED = Recolouring((K, B, Y))
NOT_BLACK = Task(
    id="1",
    statement="Black? No: a BLUE block.",
    program="AND(NOT(exist(filter_obj(all_items, is_black))), exist(filter_color(all_items, Color.BLUE)))",
    target=False,
    start=scene(tower(B, Y)),
)


def test_task__statement_program_and_scene_change_consistently():
    assert ROTATED.task(NOT_BLACK) == Task(
        id="1",
        statement="Blue? No: a YELLOW block.",
        program="AND(NOT(exist(filter_obj(all_items, is_blue))), exist(filter_color(all_items, Color.YELLOW)))",
        target=False,
        start=scene(tower(Y, K)),
    )
    assert ROTATED.text("Blackish bluebells.") == "Blackish bluebells."


@pytest.mark.parametrize(
    "statement",
    [
        "Neither is there.",
        "A black one or a bkack one, but a blue block.",
        "A black one, but ablue block and a blue one.",
    ],
)
def test_recolourable__only_if_statement_and_program_name_the_same_colours(statement):
    assert not recolourable(statement, NOT_BLACK.program)
    assert recolourable("There is a black one, and back there a blue block.", NOT_BLACK.program)


def check_truths(corpus, split, step, count):
    """Asserts that truth values follow every recolouring of a corpus's tasks; returns how many are recolourable."""
    rng, found = random.Random(3), 0
    for appearance in ("tower", "scatter"):
        scenes = rng.sample(ScenePool.sample(appearance, rng, 12).scenes, count)
        tasks = load_tasks(corpus, appearance, "scratch", split)
        for statement, program in sorted({(task.statement, task.program) for task in tasks})[::step]:
            if recolourable(statement, program):
                found += 1
                for recolouring in RECOLOURINGS[1:]:
                    before, after = compile_program(program), compile_program(recolouring.text(program))
                    assert [after(recolouring.scene(shown)) for shown in scenes] == [before(shown) for shown in scenes]
    return found


@pytest.mark.long
def test_builtin_programs__truth_follows_every_recolouring():
    assert check_truths("builtin", "dev", 2, 20) > 50


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_official_programs__truth_follows_every_recolouring():
    assert check_truths("lilgym", "train", 12, 8) > 60


@pytest.mark.parametrize("appearance", [Tower(), Scatter()], ids=str)
def test_action__recolouring_commutes_with_steps_and_masks(appearance):
    rng, placement = np.random.default_rng(11), RULE_SETS["paper"].placement
    actions = [appearance.encode(ROTATED.action(appearance.decode(each))) for each in range(appearance.action_count)]
    for _ in range(12):
        before = Scene.empty()
        for _ in range(12):
            other, mask = ROTATED.scene(before), appearance.legal_mask(before, placement)
            assert np.array_equal(appearance.legal_mask(other, placement)[actions], mask)
            action = appearance.decode(int(rng.choice(np.flatnonzero(mask)[1:])))
            before = appearance.apply(before, action, placement).scene
            assert appearance.apply(other, ROTATED.action(action), placement).scene == ROTATED.scene(before)
