"""Features, exchanges, and plans of the search."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.rules import Outcome, State, make_dynamics
from lilgym_mp.learning.reward_model.features import (
    BoxTable,
    InputReader,
    exchanges,
    standard_exchanges,
)
from lilgym_mp.learning.reward_model.learner import RewardModelRecipe
from lilgym_mp.learning.reward_model.network import ModulatedNetwork
from lilgym_mp.learning.reward_model.search import SearchPlanner
from lilgym_mp.scene import BOX_SIDE, Colour, Item, Scene, Shape
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.appearances.tower.geometry import every_box, tower_tables

STATEMENT = "there is a black block on the left"
VOCABULARY = Vocabulary(("a", "black", "blue", "is", "left", "on", "right", "the", "there", "yellow"))


def new_planner(appearance, *, seed=0, is_flipit=True):
    table = BoxTable(appearance)
    torch.manual_seed(seed)
    counts = 4 if appearance == "scatter" else 0
    shape = len(VOCABULARY), table.item_width, table.box_width
    network = ModulatedNetwork(*shape, counts=counts).eval().requires_grad_(requires_grad=False)
    reader = InputReader(VOCABULARY, table, torch.device("cpu"))
    dynamics = make_dynamics(make_appearance(appearance))
    return SearchPlanner(network, reader, dynamics, RewardModelRecipe(beam=3), is_flipit=is_flipit)


@pytest.mark.parametrize("appearance", ["tower", pytest.param("scatter", marks=pytest.mark.long)])
@settings(max_examples=20)
@given(data=st.data())
def test_plan__is_valid_by_the_rules_and_stops_within_the_horizon(appearance, data):
    tasks = load_tasks("builtin", appearance, "flipit", "dev")
    task = tasks[data.draw(st.integers(0, len(tasks) - 1))]
    steps = data.draw(st.sampled_from([0, 5, 9, 10, 11]))
    planner = new_planner(appearance, seed=data.draw(st.integers(0, 3)))
    plan = planner.plan(task.start, task.statement, task.target, steps)
    state = State(task, task.start, steps)
    for index, action in enumerate(plan.actions):
        transition = planner.dynamics.step(state, action)
        ends = transition.outcome in (Outcome.SUCCESS, Outcome.WRONG_STOP)
        assert ends == (index == len(plan.actions) - 1)
        state = transition.state
    assert 0 <= plan.success_probability <= 1


def test_plans__are_as_short_as_the_best_and_nearly_as_sure():
    planner = new_planner("tower")
    task = load_tasks("builtin", "tower", "flipit", "dev")[0]
    best, *others = planner.plans(task.start, task.statement, task.target, most=20)
    assert best == planner.plan(task.start, task.statement, task.target)
    assert others
    assert {len(plan.actions) for plan in others} == {len(best.actions)}
    least = best.success_probability - planner.recipe.edit_cost
    assert all(least <= plan.success_probability <= best.success_probability for plan in others)


def test_distances_of_boxes__are_those_of_single_edits():
    after, distances = tower_tables().after, every_box().distances
    assert (distances == distances.T).all()
    for box, successors in enumerate(after):
        assert {*np.flatnonzero(distances[box] == 1).tolist()} == {*successors[successors >= 0].tolist()}


def exchanged_scene(exchange, scene):
    def exchanged(item):
        x = BOX_SIDE - item.x - item.side if exchange.mirrored else item.x
        return Item(x, item.y, Shape(exchange.shapes[item.shape]), Colour(exchange.colours[item.colour]), item.size)

    return Scene.of(*(map(exchanged, box.items) for box in scene.boxes))


def test_exchange__permutes_the_features_of_the_exchanged_scene(appearance):
    scenes = [task.start for task in load_tasks("builtin", appearance, "flipit", "dev")[:20]]
    for exchange in exchanges(appearance)[::7]:
        table = BoxTable(appearance)
        items, boxes = exchange.columns(appearance)
        for scene in scenes:
            exchanged = exchanged_scene(exchange, scene)
            (one, looks), (other, exchanged_looks) = (
                table.features(np.array(table.of(each))) for each in (scene, exchanged)
            )
            assert np.array_equal(table.item_features[one], table.item_features[other][..., items])
            assert np.array_equal(looks, exchanged_looks[..., boxes])


def test_statements__are_read_in_a_standard_order():
    def read(words, appearance):
        kinds = [exchanges(appearance)[index].words() for index in standard_exchanges(words.split(), appearance)]
        return {" ".join(kind.get(word, word) for word in words.split()) for kind in kinds}

    assert read("a blue block above a black one", "tower") == {"a yellow block above a black one"}
    assert read("a black circle right of blue triangles", "scatter") == {"a yellow circle left of black squares"}
    assert read("two blocks", "tower") == {"two blocks"}
    assert len(standard_exchanges(["two", "blocks"], "tower")) == 6  # any colours in the scene
    assert len(standard_exchanges(["two", "blue", "blocks"], "scatter")) == 4  # a block may mean a square


def test_network__ignores_the_order_of_boxes(appearance):
    planner = new_planner(appearance)
    starts = [task.start for task in load_tasks("builtin", appearance, "flipit", "dev")[:9]]
    one, two, three = (planner.reader.table.of(start)[0] for start in starts[::4])
    network = planner.network
    reading = network.read(*planner.reader.statements([STATEMENT], [0]))
    features, scenes = planner.reader.scenes(np.array([[[one, two, three], [three, one, two], [two, two, two]]]))
    logits = network(reading, features, scenes)[0].detach()
    assert logits[0] == pytest.approx(logits[1].item(), abs=1e-5)
    assert abs(logits[0] - logits[2]) > 1e-4
