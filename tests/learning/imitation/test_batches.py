"""Data collection and batches: labels, and colours permuted consistently in words, scenes and actions."""

import numpy as np
import pytest
import torch

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.spelling import normalised_words
from lilgym_mp.corpus.tokens import Vocabulary
from lilgym_mp.envs.rules import State, make_dynamics
from lilgym_mp.learning.common.words import StatementTokenizer, vocabulary_of
from lilgym_mp.learning.imitation.action_heads import action_heads
from lilgym_mp.learning.imitation.batches import BatchSampler
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.dataset import DataCollector, entries_from_tasks
from lilgym_mp.learning.imitation.learner import ImitationRecipe
from lilgym_mp.programs import compile_program
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Colour, Scene
from lilgym_mp.scene.appearances import Tower
from lilgym_mp.solver import Solver
from tests.scenes import scene as tower_scene
from tests.scenes import tower


@pytest.fixture(scope="module")
def collected(statements):
    """The entries of the corpus with labelled scenes, and their boxes."""
    table = BoxFeatureTable()
    entries = entries_from_tasks(load_tasks(statements, "tower", "flipit", "train"))
    collector = DataCollector(make_dynamics(Tower()), table, np.random.default_rng(0))
    for entry in entries:
        collector.collect(entry, 4, 8, [])
    table.update_features()
    return entries, table


def test_explorer__labels_are_those_of_the_program_and_the_expert(collected):
    entries, table = collected
    solver, heads = Solver(make_dynamics(Tower())), action_heads(Tower())
    for entry in entries:
        assert len(entry.with_actions) >= 4
        for boxes, truth, steps, actions in zip(entry.scenes, entry.truths, entry.steps, entry.actions, strict=True):
            scene = Scene(tuple(table.boxes[box] for box in boxes))
            assert entry.program(scene) == truth
            if actions is not None:
                task = Task("", entry.statement, entry.program.source, not truth, scene)
                found = solver.optimal_actions(State(task, scene, 0))
                assert set(heads.action_of[actions].tolist()) == set(found.actions)
                assert steps == found.steps


def test_batch__labels_hold_after_recolouring(collected):
    entries, table = collected
    vocabulary = Vocabulary.from_statements([*(entry.statement for entry in entries), "yellow black blue 2"])
    heads = action_heads(Tower())
    tokenizer = StatementTokenizer(vocabulary)
    sampler = BatchSampler(table, heads, tokenizer, torch.device("cpu"), ImitationRecipe(unknown_words=0.0))
    batch = sampler.batch(entries, 3, 4, np.random.default_rng(3))
    programs = {}
    for entry in entries:
        words = " ".join(normalised_words(entry.statement, ()))
        (named,) = [colour.name for colour in Colour if colour.name.lower() in words]
        for other in Colour:
            recoloured = words.replace(named.lower(), other.name.lower())
            programs[recoloured] = entry.program.source.replace(named, other.name)
    solver = Solver(make_dynamics(Tower()))
    changed = 0
    for row, entry in enumerate(entries):
        statement = " ".join(vocabulary.decode(batch.inputs.words[row].tolist()))
        changed += statement != " ".join(normalised_words(entry.statement, ()))
        program = programs[statement]
        for column, places in enumerate(batch.inputs.scenes[row].tolist()):
            scene = shown(batch.inputs, row, places)
            truth = compile_program(program)(scene)
            assert truth == bool(batch.truths[row, column])
            if column < 3:
                assert bool(batch.targets[row, column]) == (not truth)
                found = solver.optimal_actions(State(Task("", statement, program, not truth, scene), scene, 0))
                marked = torch.nonzero(batch.optimal[row, column]).flatten().numpy()
                assert set(heads.action_of[marked].tolist()) == set(found.actions)
    assert changed


def shown(inputs, row, places):
    """The Tower scene encoded in the inputs."""
    every = inputs.colours.flatten()
    boxes = (inputs.by_box[row, place] for place in places)
    return tower_scene(*(tower(*map(Colour, every[box[box < len(every)]].tolist())) for box in boxes))


def test_vocabulary__drops_likely_misspellings_from_large_corpora():
    statements = ["Two bleu blocks", "two blue blocks"]
    assert {"bleu", "blue", "2", "9"} <= set(vocabulary_of(statements).words)
    many = vocabulary_of(statements + ["three blue blocks"] * 100)
    assert "blue" in many.words
    assert "bleu" not in many.words
    read, meant = map(StatementTokenizer(many).encode, ("bleu blocks", "blue blocks"))
    assert read.tolist() == meant.tolist()
