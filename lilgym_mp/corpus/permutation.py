"""More start scenes from the same corpus: the boxes in every order.

Source: SPEC section 2 (Wu et al. 2023; NLVR's statements do not speak of the boxes' order).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.scene import BOX_COUNT
from lilgym_mp.task import Task

ORDERS = tuple(permutations(range(BOX_COUNT)))  # the first leaves them as they are


def with_permuted_boxes(tasks: TaskSet, *, distinct: bool = False) -> TaskSet:
    """Every task with its start's boxes in each of the six orders, the task as it is first.

    The task "7" gives "7", "7@021" .. "7@210": the digits tell which old box stands where. Orders in which the
    statement has another truth value are left out: it speaks of the boxes' order. `distinct` also leaves out those
    that give a start scene once more; without it each order is as likely as another in a uniform draw.
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
