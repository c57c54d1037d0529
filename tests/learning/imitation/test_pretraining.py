"""Pretraining: writing programs, and legal edits."""

from itertools import islice

import numpy as np
import pytest
import torch

from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.rules import make_dynamics
from lilgym_mp.learning.common.program_batches import Example, pairs_of
from lilgym_mp.learning.common.words import StatementTokenizer, vocabulary_of
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DataCollector, entries_from_tasks
from lilgym_mp.learning.imitation.learner import ImitationRecipe
from lilgym_mp.learning.imitation.network import CellGeometry, ImitationNetwork
from lilgym_mp.learning.imitation.pretraining import TextPretraining, pretrain_geometry
from lilgym_mp.scene.appearances import make_appearance


def text_pretraining(**changes):
    """A small network, and its pretraining on some statements."""
    entries = entries_from_tasks(islice(load_tasks("builtin", "tower", "scratch", "train"), 40))
    tokenizer = StatementTokenizer(vocabulary_of(entry.statement for entry in entries))
    network = ImitationNetwork("tower", len(tokenizer.vocabulary), width=32, text_layers=1)
    recipe = ImitationRecipe(width=32, text_layers=1, **changes)
    return network, TextPretraining(network, tokenizer, entries, "tower", set(), recipe, seed=0)


def test_text_pretraining__exchanges_colours_and_drops_words_unless_the_recipe_says_not_to():
    shown = Example("There is a blue block", "exist(filter_obj(all_items, is_blue))", "tower")
    variants = []
    for changes in ({}, {"recolour": False, "unknown_words": 0.0}):
        _, pretraining = text_pretraining(**changes)
        pair = next(pairs_of(iter([shown]), ["there", "is", "a", "blue", "block"]))
        variants.append(len({str(pretraining._indices(pair)) for _ in range(40)}))
    assert variants[0] > 2
    assert variants[1] == 1


@pytest.mark.long
def test_text_pretraining__changes_the_text_encoder_only():
    torch.manual_seed(0)
    network, pretraining = text_pretraining()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    losses = [pretraining.step(step / 60) for step in range(60)]
    assert np.mean(losses[-5:]) < 0.6 * np.mean(losses[:5])
    changed = {name for name, value in network.state_dict().items() if not torch.equal(value, before[name])}
    assert changed
    assert all(name.startswith("text.") for name in changed)


@pytest.mark.long
def test_geometry_pretraining__learns_legal_edits():
    dynamics, table, rng = make_dynamics(make_appearance("scatter")), BoxFeatureTable(), np.random.default_rng(0)
    collector = DataCollector(dynamics, table, rng)
    for task in islice(load_tasks("builtin", "scatter", "flipit", "train"), 800):
        scene = task.start
        for _ in range(3):
            table.indices([scene])
            scene = collector.edited(scene)
    torch.manual_seed(0)
    geometry = CellGeometry()
    pretrain_geometry(geometry, table, 300, 0.03, rng)
    with torch.no_grad():
        offsets = torch.from_numpy(table.offsets.astype(np.int64))
        predicted = geometry(geometry.item_terms(offsets).sum(1))[1].numpy() > 0
    wrong = predicted != table.legal
    for edits, most in ((slice(9), 0.12), (9, 0.05)):  # ADDs and REMOVEs; 0.5 untrained
        for valid in (False, True):
            assert wrong[..., edits][table.legal[..., edits] == valid].mean() < most
