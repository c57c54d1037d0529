"""Training tasks with their colours exchanged."""

from __future__ import annotations

from pathlib import Path

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.learning.recolouring import recoloured, write_recoloured
from lilgym_mp.scene import Scene
from lilgym_mp.task import Task
from tests.own_corpus import write_own_corpus
from tests.scenes import B, K, Y, scene, tower

NOT_BLACK = Task(
    id="1",
    statement="Black? No: a BLUE block.",
    program="AND(NOT(exist(filter_obj(all_items, is_black))), exist(filter_color(all_items, Color.BLUE)))",
    target=False,
    start=scene(tower(B, Y)),
)
ROTATED = {Y: K, K: B, B: Y}
UNCHANGED = {Y: Y, K: K, B: B}


def test_recoloured__statement_program_and_scene_change_alike():
    assert recoloured(NOT_BLACK, ROTATED) == Task(
        id="1",
        statement="Blue? No: a YELLOW block.",
        program="AND(NOT(exist(filter_obj(all_items, is_blue))), exist(filter_color(all_items, Color.YELLOW)))",
        target=False,
        start=scene(tower(Y, K)),
    )


def test_recoloured__nothing_exchanged_is_the_task_itself():
    assert recoloured(NOT_BLACK, UNCHANGED) == NOT_BLACK


@pytest.mark.parametrize("statement", ["Not a blak one, but a blue block.", "Neither is there."])
def test_recoloured__a_statement_that_names_other_colours_than_its_program_stays_as_it_is(statement: str):
    task = Task("1", statement, NOT_BLACK.program, False, Scene.empty())
    assert recoloured(task, ROTATED) is None
    assert recoloured(task, UNCHANGED) == task


def test_recoloured__words_that_hold_a_colour_are_no_colours():
    task = Task("1", "Blackish bluebells.", "exist(all_items)", True, Scene.empty())
    assert recoloured(task, ROTATED) == task


@pytest.mark.parametrize("start", ["scratch", "flipit"])
@pytest.mark.parametrize("appearance", ["tower", "scatter"])
def test_write_recoloured__every_exchange_is_a_task_once_and_loads(tmp_path: Path, appearance: str, start: str):
    tasks = load_tasks(write_own_corpus(tmp_path / "own.jsonl"), appearance, start, "train")
    write_recoloured(tmp_path / "more.jsonl", tasks)
    more = load_tasks(tmp_path / "more.jsonl", appearance, start, "train")  # labels are checked against truths
    found = {(task.statement, task.program, task.target, task.start) for task in more}
    assert len(found) == len(more)
    assert found >= {(task.statement, task.program, task.target, task.start) for task in tasks}
    assert {task.statement for task in more} == {
        *("There is something yellow.", "There is something black.", "There is something blue.", "Count them: 1."),
    }
