"""Episodes as numbers, tables and JSON."""

from __future__ import annotations

import json

import pytest

from lilgym_mp.evaluation import Episode, Settings, summarise
from lilgym_mp.evaluation.comparison import BASELINES, Result, Trial, training_statements
from lilgym_mp.evaluation.report import aligned, results_json, table

EPISODES = [
    Episode("a", "Known.", True, "success", 0.8, (1, 2, 0)),
    Episode("b", "Known.", True, "wrong_stop", -1.0, (0,)),
    Episode("c", "New.", True, "horizon", -2.2, (1,) * 12),
    Episode("d", "New.", False, "invalid_action", -1.0, (5,)),
]


def test_summarise__counts_by_outcome_and_by_whether_the_statement_was_seen():
    summary = summarise(EPISODES, {"Known."})
    assert summary.accuracy == 0.25
    assert (summary.seen.accuracy, summary.unseen.accuracy) == (0.5, 0.0)
    assert summary.mean_reward == pytest.approx(-0.85)
    assert summary.mean_length == pytest.approx(17 / 4)
    assert summary.outcomes == {"success": 0.25, "wrong_stop": 0.25, "invalid_action": 0.25, "horizon": 0.25}


def test_summarise__no_seen_statements_have_no_accuracy():
    assert summarise(EPISODES, set()).seen.accuracy is None


def test_summarise__nothing_is_refused():
    with pytest.raises(ValueError, match="no episodes"):
        summarise([], set())


def test_table__has_a_row_a_policy():
    head, rule, row = table([Result("mine", summarise(EPISODES, {"Known."}), EPISODES)]).splitlines()
    assert [cell.strip() for cell in head.strip("|").split("|")] == [
        *("policy", "episodes", "accuracy", "seen", "unseen", "mean reward", "mean length"),
        *("wrong stop", "invalid action", "horizon"),
    ]
    assert [cell.strip() for cell in row.strip("|").split("|")] == [
        *("mine", "4", "25.0 %", "50.0 % of 2", "0.0 % of 2", "-0.85", "4.2", "25.0 %", "25.0 %", "25.0 %"),
    ]
    assert len(head) == len(rule) == len(row)


def test_aligned__first_column_to_the_left_others_to_the_right():
    assert aligned([("a", "bcd"), ("ef", "g")]) == "| a  | bcd |\n|----|----:|\n| ef |   g |"


def test_results__hold_all_that_is_needed_to_get_them_again():
    trial = Trial(Settings("TowerFlipIt"), "dev", seed=5, passes=1, batch_size=16)
    results = list(trial.results(BASELINES, training_statements(trial.settings)))
    data = json.loads(json.dumps(results_json({"evaluation": (trial, results)})))
    written = data["trials"]["evaluation"]
    again = Trial(
        Settings.from_json(written["settings"]),
        written["split"],
        written["seed"],
        written["passes"],
        written["batch_size"],
    )
    assert again == trial
    (legal, unmasked), found = BASELINES, written["policies"]
    (result,) = again.results([unmasked], training_statements(trial.settings))
    assert found[unmasked.name]["episodes"] == [
        {**episode._asdict(), "actions": list(episode.actions)} for episode in result.episodes
    ]
    assert found[legal.name]["summary"]["accuracy"] == results[0].summary.accuracy
    assert written["tasks"]["sha256"] == trial.settings.make("dev").tasks.provenance.sha256
    assert {"python", "numpy", "gymnasium"} <= set(data["software"])


def test_training_statements__are_those_of_the_train_split():
    statements = training_statements(Settings("TowerScratch"))
    assert statements == {task.statement for task in Settings("TowerScratch").make("train").tasks}
