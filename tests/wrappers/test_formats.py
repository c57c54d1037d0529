"""Each observation format on a literal scene."""

import threading

import numpy as np
import pytest

from lilgym_mp.programs.task import Task
from lilgym_mp.scene.actions import named
from lilgym_mp.wrappers import (
    ChannelsFirst,
    FlatObservation,
    GridPlanes,
    StatementEmbedding,
    StepsLeft,
    StructuredObservation,
    TokenizedStatement,
    WrongEnvironment,
)
from tests.scenes import scene_of

# Scene "round-yes": in the middle box a large yellow circle at (0, 70) and a small blue triangle at (60, 5).
CIRCLE, TRIANGLE = [0, 70, 0, 0, 2], [60, 5, 2, 2, 0]  # x, y, shape, colour, size
STATEMENT = "Something round."
HORIZON = 12


def observe(env, task="round-yes"):
    return env.reset(options={"task": task})[0]


def test_structured__lists_the_items_box_by_box(make):
    observation = observe(StructuredObservation(make("ScatterFlipIt")))
    assert observation["item_array"][1, :3].tolist() == [CIRCLE, TRIANGLE, [-1] * 5]
    assert observation["present"].sum(axis=1).tolist() == [0, 2, 0]
    assert set(observation) == {"item_array", "present", "statement", "target"}


def test_structured__pads_to_the_slots_asked_for(make):
    env = StructuredObservation(make("ScatterFlipIt"))
    wider = StructuredObservation(make("ScatterFlipIt"), slots=30)
    observation = observe(wider)
    assert wider.observation_space.contains(observation)
    capacity = env.observation_space["present"].shape[1]
    assert np.array_equal(observation["item_array"][:, :capacity], observe(env)["item_array"])
    with pytest.raises(ValueError, match=f"slots must be at least {capacity}"):
        StructuredObservation(make("ScatterFlipIt"), slots=3)


def test_structured__space_contains_items_that_the_release_snaps_outside_a_box(make):
    start = scene_of("square 30,14 small")
    env = StructuredObservation(make("ScatterScratch", rules="release"))
    env.reset(options={"task": Task("own", "It is so.", "exist(all_items)", True, start)})
    observation, *_ = env.step(env.unwrapped.dynamics.appearance.encode(named("ADD(2, 0, TRIANGLE, YELLOW, LARGE)")))
    assert observation["item_array"][0, 1].tolist()[:2] == [38, -1]
    assert observation in env.observation_space


def test_keep_image__keeps_the_image(make):
    for wrapper in (StructuredObservation, GridPlanes):
        assert "image" in observe(wrapper(make("ScatterFlipIt"), keep_image=True))


def test_planes__count_items_at_centres_and_mark_occupied_cells(make):
    planes = observe(GridPlanes(make("ScatterFlipIt")))["planes"]
    circle, triangle = [4, 7], [0, 10]  # row and column of the centres, (155, 85) and (205, 10) on the image
    shapes = colours = [[circle], [], [triangle]]
    sizes, occupied = [[triangle], [], [circle]], [[triangle, [3, 7], [3, 8], [4, 7], [4, 8]]]
    assert [np.argwhere(plane).tolist() for plane in planes] == shapes + colours + sizes + occupied


def test_planes__put_each_block_of_a_tower_in_its_own_cell(make):
    env = GridPlanes(make("TowerScratch"))
    env.reset(seed=0)
    for _ in range(4):
        planes = env.step(3)[0]["planes"]  # ADD(LEFT, BLUE)
    assert planes[5].sum(axis=1).tolist() == [0, 1, 1, 1, 1]


def test_channels_first__moves_the_channel_axis(make):
    original, moved = (observe(env)["image"] for env in (make("ScatterFlipIt"), ChannelsFirst(make("ScatterFlipIt"))))
    assert moved.shape == (3, 50, 190)
    assert np.array_equal(moved, original.transpose(2, 0, 1))


def test_steps_left__counts_down(make):
    env = StepsLeft(make("TowerScratch"))
    assert observe(env, "blue")["steps_left"] == HORIZON
    assert [env.step(1)[0]["steps_left"], env.step(1)[0]["steps_left"]] == [HORIZON - 1, HORIZON - 2]


def test_embedding__encodes_each_statement_once(make):
    encoded = []

    def encoder(statement):
        encoded.append(statement)
        return [len(statement), statement.count("o")]

    env = StatementEmbedding(make("ScatterFlipIt"), encoder)
    for _ in range(3):
        assert observe(env)["statement"].tolist() == [len(STATEMENT), 2]
    assert encoded.count(STATEMENT) <= 2  # once for the space, once for the statement


def test_embedding__accepts_a_sentence_encoder(make):
    class Encoder:
        def __init__(self):
            self.lock = threading.Lock()  # cannot be copied

        def encode(self, sentences):
            return np.array([[len(sentence)] for sentence in sentences])

    assert observe(StatementEmbedding(make("ScatterFlipIt"), Encoder()))["statement"].tolist() == [len(STATEMENT)]


@pytest.mark.parametrize(
    ("encoder", "message"),
    [
        ("bert", "encoder must be a function of a statement or have an encode method, not 'bert'"),
        (lambda statement: 1.0, r"encoder must return a vector, not an array of shape \(\)"),
        (lambda statement: [np.nan], r"encoder returned values beyond limit=1000.0 for '.*'"),
    ],
)
def test_embedding__refuses_invalid_encoders(make, encoder, message):
    with pytest.raises(ValueError, match=message):
        observe(StatementEmbedding(make("ScatterFlipIt"), encoder))


def test_embedding__refuses_vectors_of_different_lengths(make):
    lengths = iter((2, 3))
    env = StatementEmbedding(make("ScatterFlipIt"), lambda statement: [0.0] * next(lengths))
    with pytest.raises(ValueError, match=r"shape \(3,\) for 'Something round.', not \(2,\)"):
        observe(env)


def test_flat__concatenates_parts_in_alphabetical_order(make):
    env = FlatObservation(StepsLeft(TokenizedStatement(StructuredObservation(make("ScatterFlipIt")), length=2)))
    vector = observe(env)
    items, present, _, steps_left, target = np.split(vector, np.cumsum([3 * 14 * 5, 3 * 14, 2, HORIZON + 1]))
    assert items.reshape(3, 14, 5)[1, :2].tolist() == [CIRCLE, TRIANGLE]
    assert present.reshape(3, 14).sum(axis=1).tolist() == [0, 2, 0]
    assert steps_left.argmax() == HORIZON
    assert target.tolist() == [1, 0]
    assert vector.dtype == np.float32


def test_flat__refuses_text(make):
    with pytest.raises(WrongEnvironment, match="apply TokenizedStatement or StatementEmbedding first"):
        FlatObservation(make("TowerScratch"))


@pytest.mark.parametrize("wrapper", [StructuredObservation, GridPlanes, ChannelsFirst, StepsLeft, TokenizedStatement])
def test_format__refuses_observations_without_parts(make, wrapper):
    with pytest.raises(WrongEnvironment, match=f"{wrapper.__name__} needs Dict observations, .*Apply .* earlier"):
        wrapper(FlatObservation(TokenizedStatement(make("TowerScratch"))))


def test_channels_first__refuses_observations_without_an_image(make):
    with pytest.raises(WrongEnvironment, match="with a part 'image'"):
        ChannelsFirst(StructuredObservation(make("TowerScratch")))
