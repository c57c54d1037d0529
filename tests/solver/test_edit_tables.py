"""The tables of all edits of a box agree with the rules."""

import random

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.scene.appearances import Scatter
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPE_FOOTPRINTS, ITEM_TYPES
from lilgym_mp.solver.canonical_items import canonical_index
from lilgym_mp.solver.edit_tables import (
    addition_actions,
    addition_table,
    removal_actions,
)
from tests.solver.tasks import after_random_edits, mdp


@pytest.mark.parametrize(("grid", "rules"), [((19, 5), "paper"), ((38, 10), "paper"), ((19, 1), "release")])
def test_tables__agree_with_the_rules(grid, rules):
    dynamics = mdp("scatter", rules, grid=grid)
    scatter, placement = dynamics.appearance, dynamics.rules.placement
    assert isinstance(scatter, Scatter)
    rng = random.Random(0)
    for seed, one in enumerate(load_tasks("builtin", "scatter", "flipit", "train")[:160:20]):
        state = after_random_edits(dynamics, dynamics.start(one), seed % 5, seed)
        for index, box in enumerate(state.scene.boxes):
            table = addition_table(scatter, placement, index, box.items)
            adds = addition_actions(scatter, index, range(len(table.canonical)))
            for action in rng.sample(adds, 60):
                after, invalid = scatter.apply(state.scene, scatter.decode(action), placement)
                cell, item_type = divmod(action - adds[0], len(ITEM_TYPES))
                canonical = table.canonical[action - adds[0]]
                if invalid:
                    assert canonical == -1
                else:
                    item = after.boxes[index].items[-1]
                    place = table.places[cell, ITEM_TYPE_FOOTPRINTS[item_type]].tolist()
                    assert (place, canonical) == ([item.x, item.y], canonical_index(item))
            for position in range(len(box.items)):
                for action in removal_actions(scatter, index, box.items, position)[:2]:
                    after, _ = scatter.apply(state.scene, scatter.decode(action), placement)
                    assert after.boxes[index] == box.without(position)
