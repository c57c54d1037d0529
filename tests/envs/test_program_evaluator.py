"""Whether STOP succeeds is found in compiled code without making scenes; the programs themselves say the same."""

from itertools import product
from operator import attrgetter

import numpy as np
import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.cores.program_evaluator import ItemBoxLowering, StackBoxLowering
from lilgym_mp.envs.fast.box_functions import ITEM_TESTS, MAX_BOX_ITEMS, vectorised_test
from lilgym_mp.envs.fast.instructions import Operation, instructions
from lilgym_mp.programs import Program, compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.programs.values import Side
from lilgym_mp.programs.words import WORDS
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.appearances.tower.geometry import tower_tables
from tests.envs.alike import started_core
from tests.scenes import SMALL, B, circle, scene, scene_of

APPEARANCES = pytest.mark.parametrize("appearance", ["tower", "scatter"])
SPLITS = pytest.mark.parametrize("split", ["dev", pytest.param("train", marks=pytest.mark.long)])
MIXED = scene_of(
    "circle 0,0 small; square 20,0 blue; triangle 70,70 large black"
    "| square 45,90 small blue; square 0,46 black | circle 89,89 small black"
)
STACKED = scene_of("tower ybb | tower k")


def goals(appearance, tasks):
    core, buffers = started_core(appearance, tasks)
    core.write_goals()
    return buffers.goal.tolist()


def copied(of):
    """Without anything that was derived from the scene before."""
    return Scene.from_json(of.to_json())


@pytest.mark.usefixtures("official_data")
@SPLITS
@APPEARANCES
def test_goals__equal_the_values_of_every_official_program(appearance, split):
    check_goals("lilgym", appearance, split)


@SPLITS
@APPEARANCES
def test_goals__equal_the_values_of_every_program_of_the_builtin_corpus(appearance, split):
    check_goals("builtin", appearance, split)


def check_goals(corpus, appearance, split):
    """Compares goals in the start scenes and after legal edits."""
    by_program = {task.program: task for task in load_tasks(corpus, appearance, "flipit", split)}
    core, buffers = started_core(appearance, list(by_program.values()))
    chance = np.random.default_rng(0)
    reached = 0
    for _ in range(4):
        core.write_goals()
        reached += buffers.goal.sum()
        for env_id, goal in enumerate(buffers.goal.tolist()):
            state = core.state(env_id)
            assert goal == state.task.solved_by(copied(state.scene)), (state.task.program, state.scene)
        core.write_masks()
        buffers.mask[:, 0] = False
        buffers.action[:] = (buffers.mask * chance.random(buffers.mask.shape)).argmax(axis=1)  # legal edits
        core.step(None)
    assert reached > 3  # by edits


OPERATIONS = {
    "count(all_items) == 3 + 3": {Operation.LENGTH, Operation.ADD, Operation.EQUAL},
    "count(filter_obj(all_items, lambda x: not is_black(x))) == 3": {Operation.SUBTRACT, Operation.BIT_COUNT},
    "exist(filter_obj(all_items, lambda x: is_black(x) and is_touching_wall(x, Side.BOTTOM)))": {
        Operation.ITEM_TYPE_TEST,
        Operation.POSITION_TEST,
        Operation.BIT_AND,
    },
    "count(filter_obj(all_boxes, lambda b: count(b) > 1)) % 2 == 0": {Operation.REMAINDER, Operation.LESS},
    "exist(filter_obj(all_boxes, lambda b: get_set_colors(b) == {Color.BLACK, Color.BLUE}))": {
        Operation.SHIFT_LEFT,
        Operation.BIT_OR,
    },
    "not exist(filter_color(all_items, Color.YELLOW)) or count(all_items) <= 5": {
        Operation.EQUAL,
        Operation.BIT_OR,
        Operation.LESS_OR_EQUAL,
    },
    "All(all_boxes, lambda b: exist(filter_color(b, Color.BLACK)) and count(b) != 4)": {
        Operation.BIT_AND,
        Operation.UNEQUAL,
    },
}


@pytest.mark.parametrize("source", OPERATIONS)
@APPEARANCES
def test_goals__equal_the_values_of_programs_with_each_operation(appearance, source):
    boxes = StackBoxLowering(tower_tables().boxes) if appearance == "tower" else ItemBoxLowering()
    written = instructions(compile_program(source).tree, boxes.lower_box_function)
    expected = OPERATIONS[source] if appearance == "scatter" else set()  # a tower's boxes are tables
    assert expected <= {instruction.operation for instruction in written}
    starts = [STACKED, scene(), scene_of("tower b | tower bkkk"), *([MIXED] if appearance == "scatter" else [])]
    tasks = [Task("own", "It is so.", source, target, start) for start in starts for target in (True, False)]
    assert goals(appearance, tasks) == [Program(source).evaluate(task.start) == task.target for task in tasks]


@pytest.mark.parametrize(
    ("source", "start", "truth"),
    [
        ("is_black(unique(filter_obj(all_boxes, lambda b: count(b) == 1)[0]))", MIXED, True),  # no generated code
        ("exist(filter_obj(all_boxes, lambda b: is_blue(unique(b))))", MIXED, False),  # no value: two in a box
        ("exist(filter_obj(all_boxes, lambda b: count(b) == 1 and is_black(unique(b))))", MIXED, True),
        ("exist(filter_obj(all_items, lambda x: exist(get_touching(x))))", MIXED, False),  # no instructions
    ],
)
def test_goals__call_the_program_if_compiled_code_returns_unknown(source, start, truth):
    assert goals("scatter", [Task("own", "It is so.", source, truth, start)]) == [True]


def test_goals__call_the_program_for_boxes_of_too_many_items():
    small = [circle(11 * column, 11 * row, SMALL, B) for row in range(4) for column in range(7)]
    assert len(small) > MAX_BOX_ITEMS
    tasks = [Task("own", "It is so.", f"count(all_items) == {n}", True, scene(small)) for n in (len(small), 1)]
    assert goals("scatter", tasks) == [True, False]


def test_goals__of_another_kind_are_asked_about_the_scene():
    class Never:
        def reached_in(self, scene):
            return False

    tasks = [Task("own", "It is so.", "exist(all_items)", True, MIXED, goal) for goal in (None, Never())]
    assert goals("scatter", tasks) == [True, False]


def test_task__refuses_a_subclass_whose_goal_compiled_code_would_not_see():
    with pytest.raises(TypeError, match="Never: a Task cannot be subclassed; give it an `other_goal`"):
        type("Never", (Task,), {"solved_by": lambda self, scene: False})


@pytest.mark.parametrize(
    "name", [name for name, word in WORDS.items() if word.depends_on in ("attributes", "position")]
)
def test_word__its_value_depends_only_on_what_it_declares(name):
    word = WORDS[name]
    for side in Side if len(word.parameters) > 1 else (None,):
        constants = () if side is None else (side,) * (len(word.parameters) - 1)
        test = ITEM_TESTS[vectorised_test(word, constants)]
        assert test.depends_on == word.depends_on
        attributes = ("x", "y", "size") if word.depends_on == "position" else ("shape", "colour", "size")
        parts = attrgetter(*attributes)
        items = [Item(*each) for each in product((0, 3, 66, 70), (0, 6, 50, 70), Shape, Colour, Size)]
        values = {(parts(item), test.passes(item)) for item in items}
        assert len(values) == len(set(map(parts, items)))


def test_position_tests__call_the_program_if_they_exceed_a_bitmask():
    boxes = ItemBoxLowering()
    boxes._indices = {lambda box, n=n: n: n for n in range(62)}
    source = "exist(filter_obj(all_items, lambda x: is_touching_wall(x)))"
    assert instructions(compile_program(source).tree, boxes.lower_box_function) is None
    assert instructions(compile_program(source).tree, ItemBoxLowering().lower_box_function) is not None
