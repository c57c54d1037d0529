"""Tasks: truth of the statement in a scene, and whether STOP succeeds there."""

from __future__ import annotations

import dataclasses
import json
import pickle

import pytest

from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from tests.scenes import B, K, scene, tower

TASK = Task("7-a", "Some block is blue.", "exist(filter_color(all_items, Color.BLUE))", False, scene(tower(B)))


@pytest.mark.parametrize("target", [True, False])
def test_solved_by__truth_equal_to_the_target(target: bool):
    task = dataclasses.replace(TASK, target=target)
    assert task.solved_by(scene(tower(B))) is target
    assert task.solved_by(scene(tower(K))) is not target


def test_truth__is_false_if_the_program_raises():
    task = dataclasses.replace(TASK, program="is_blue(unique(all_items))")
    assert task.truth(scene(tower(B))) is True
    assert task.truth(Scene.empty()) is False
    assert task.truth(scene(tower(B, B))) is False


def test_task__is_an_immutable_value():
    copied = pickle.loads(pickle.dumps(TASK))
    assert copied == TASK
    assert copied.truth(scene(tower(B)))
    with pytest.raises(dataclasses.FrozenInstanceError):
        TASK.target = True  # type: ignore[misc]


def test_json__gives_the_task_back():
    assert Task.from_json(json.loads(json.dumps(TASK.to_json()))) == TASK


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": 1}, "a task's target must be of type bool, not 1"),
        ({"program": None}, "a task's program must be of type str, not None"),
        ({"start": [[], []]}, "a scene has 3 boxes, not 2"),
    ],
)
def test_json__of_another_form_is_refused(change: dict[str, object], message: str):
    with pytest.raises(ValueError, match=message):
        Task.from_json({**TASK.to_json(), **change})
    with pytest.raises(ValueError, match="a task must be an object"):
        Task.from_json([])
