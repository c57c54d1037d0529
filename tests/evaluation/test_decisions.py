"""Recorded decisions: their contents, and their judgement by the expert."""

from dataclasses import replace

import numpy as np
import pytest

from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.evaluation.decisions import Decision, PolicyOutput, action_cells, decisions
from lilgym_mp.evaluation.policies import built_in_policy, random_legal
from lilgym_mp.evaluation.results import EvaluationPlan
from lilgym_mp.scene import Colour
from lilgym_mp.scene.actions import STOP, AddBlock, RemoveBlock
from lilgym_mp.scene.appearances import make_appearance
from tests.evaluation.records import record

TOWER = make_appearance("tower", (19, 5))
SCATTER = make_appearance("scatter", (19, 5))
ALL_LEGAL = np.ones((1, TOWER.action_count), np.bool_)


@pytest.fixture
def episodes(own, tmp_path):
    """A function that gives the recorded episodes of a policy, with their decisions."""

    def played(name, configuration="TowerScratch", **options):
        plan = EvaluationPlan(Settings(configuration, corpus=own), "dev", record_decisions=True)
        return record(tmp_path / name, built_in_policy(name), plan, **options).episodes

    return played


def tower_output(**probabilities):
    row = np.zeros((1, TOWER.action_count))
    actions = {"stop": STOP, "add": AddBlock(1, Colour.BLUE), "add_too": AddBlock(1, Colour.BLACK)}
    actions |= {"remove": RemoveBlock(2)}
    for name, probability in probabilities.items():
        row[0, TOWER.encode(actions[name])] = probability
    return PolicyOutput(row, np.array([0.25]))


def test_decision__sums_probabilities_by_type_and_cell():
    (found,) = decisions(tower_output(stop=0.1, add=0.4, add_too=0.2, remove=0.3), ALL_LEGAL, TOWER)
    assert found.types == (0.1, 0.6, 0.3)
    assert found.add_cells == {1: 0.6}
    assert found.remove_cells == {2: 0.3}
    assert found.likeliest[:2] == ((AddBlock(1, Colour.BLUE), 0.4), (RemoveBlock(2), 0.3))
    assert found.value == 0.25


def test_decision__has_the_probability_of_legal_actions():
    legal = ALL_LEGAL.copy()
    legal[0, TOWER.encode(RemoveBlock(2))] = False
    found = decisions(tower_output(stop=0.1, add=0.6, remove=0.3), legal, TOWER)[0]
    assert found.legal_probability == 0.7
    assert found.legal == (1, 9, 2)


def test_action_cells__scatter_indices_are_column_major():
    types, cells, count = action_cells(SCATTER)
    assert count == 95
    for index in (1, 500, 2565, 2600):
        action = SCATTER.decode(index)
        assert cells[index] == action.column * 5 + action.row
    assert np.bincount(types).tolist() == [1, 2565, 95]


@pytest.mark.parametrize(("name", "configuration"), [("expert", "TowerScratch"), ("random-legal", "ScatterFlipIt")])
def test_record__built_in_policies_have_distributions(episodes, name, configuration):
    for episode in episodes(name, configuration):
        assert len(episode.decisions) == len(episode.actions)
        for decision in episode.decisions:
            assert sum(decision.types) == pytest.approx(1, abs=1e-3)
            assert sum(decision.add_cells.values()) == pytest.approx(decision.types[1], abs=0.01)
            assert decision.legal[0] == 1


def test_record__expert_judges_itself_optimal_and_failed_episodes_not(episodes):
    best = episodes("expert", judges_decisions=True)
    assert all(decision.optimal for episode in best for decision in episode.decisions)
    assert [episode.decisions[0].steps_to_go for episode in best] == [len(episode.actions) for episode in best]
    worse = episodes("random-legal", judges_decisions=True)
    ends = [episode.decisions[-1] for episode in worse if not episode.is_success]
    assert ends
    assert not any(decision.optimal for decision in ends)


def test_record__policy_without_output_has_no_decisions():
    stopping = lambda observations, legal, rng: np.zeros(len(legal), np.int64)  # noqa: E731
    episodes = evaluate(stopping, Settings("TowerScratch"), "dev", record_decisions=True)
    assert all(episode.decisions is None for episode in episodes)


def test_evaluate__recording_decisions_does_not_change_episodes():
    settings = Settings("TowerScratch")
    plain, recorded = (evaluate(random_legal, settings, "dev", record_decisions=on) for on in (False, True))
    assert plain == [replace(episode, decisions=None) for episode in recorded]


def test_from_json__is_the_inverse_of_to_json():
    decision = decisions(tower_output(stop=0.1, add=0.6, remove=0.3), ALL_LEGAL, TOWER)[0]
    decision = replace(decision, programs={"exist(all_items)": 0.5}, success_probability=0.5, optimal=True)
    assert Decision.from_json(decision.to_json()) == decision


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"types": [0.5, 0.5]}, "3 numbers each"),
        ({"types": [0.5, 0.5, 2]}, "types must be probabilities from 0 to 1, not 2"),
        ({"add_cells": [[1, "much"]]}, "add_cells must be probabilities"),
        ({"likeliest": [["FLY", 0.5]]}, "'FLY' is not an action"),
        ({"programs": {"exist(all_items)": -1}}, "programs: exist"),
    ],
)
def test_from_json__errors_name_the_field(change, message):
    good = decisions(tower_output(stop=1.0), ALL_LEGAL, TOWER)[0].to_json()
    with pytest.raises(ValueError, match=message):
        Decision.from_json({**good, **change})
