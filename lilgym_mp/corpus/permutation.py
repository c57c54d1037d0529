"""Augments a corpus's start scenes with all permutations of their boxes.

Source: docs/spec.md, "Tasks" (Wu et al. 2023; NLVR's statements do not refer to the order of the boxes).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.scene import BOX_COUNT
from lilgym_mp.task import Task

ORDERS = tuple(permutations(range(BOX_COUNT)))  # the identity first


def with_permuted_boxes(tasks: TaskSet, *, distinct: bool = False) -> TaskSet:
    """Every task with its start scene's boxes in each of the six orders, the original first.

    Task "7" yields "7", "7@021" .. "7@210"; digit k is the old index of the new box k. Orders that change the truth
    value are omitted, because the statement refers to the order. `distinct` also omits orders that yield a duplicate
    start scene; otherwise all orders are equally likely in a uniform draw.
    """
    variants = [(task, variant) for task in tasks for variant in _variants(task, distinct=distinct)]
    tags = {variant.id: tasks.tags(task.id) for task, variant in variants}
    return TaskSet((variant for _, variant in variants), tasks.provenance, tags)


def _variants(task: Task, *, distinct: bool) -> Iterator[Task]:
    truth = task.truth(task.start)
    seen = {task.start}
    yield task
    for order in ORDERS[1:]:
        start = task.start.permuted(order)
        if (distinct and start in seen) or task.truth(start) != truth:
            continue
        seen.add(start)
        yield replace(task, id=f"{task.id}@{''.join(map(str, order))}", start=start)
