"""Summaries of episodes, tables and JSON."""

import json
import re
from dataclasses import replace

import pytest

from lilgym_mp.evaluation import Episode, Settings, random_legal, summarise
from lilgym_mp.evaluation.policies import BASELINES, NamedPolicy
from lilgym_mp.evaluation.report import (
    legend,
    markdown_table,
    results_json,
    results_text,
)
from lilgym_mp.evaluation.results import EvaluationPlan, Result, play, playable, training_statements
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP

EPISODES = [
    Episode.of(
        Task("a", statement, "True", True, Scene.empty()), [STOP] * count, outcome, Settings("TowerScratch").dynamics()
    )
    for statement, count, outcome in [
        ("Known.", 3, "success"),
        ("Known.", 1, "wrong_stop"),
        ("New.", 12, "horizon"),
        ("New.", 1, "invalid_action"),
    ]
]


def test_summarise__counts_by_outcome_and_by_whether_the_statement_was_seen():
    summary = summarise(EPISODES, {"Known."})
    assert summary.accuracy == 0.25
    assert (summary.seen.accuracy, summary.unseen.accuracy) == (0.5, 0.0)
    assert summary.mean_reward == pytest.approx(-0.825)
    assert summary.mean_length == pytest.approx(17 / 4)
    assert summary.outcomes == {"success": 0.25, "wrong_stop": 0.25, "invalid_action": 0.25, "horizon": 0.25}


def result():
    named = NamedPolicy("mine", lambda settings: random_legal, "rewards", details={"run": "here"})
    plan, summary = EvaluationPlan(Settings("TowerScratch"), "dev"), summarise(EPISODES, {"Known."})
    return Result(named, plan, summary, EPISODES, 0.5)


def test_results_text__has_a_row_per_policy():
    title, _, head, _, row, *_ = results_text([result()], 200).splitlines()
    assert title == "TowerScratch, 4 episodes"
    names = ("policy", "accuracy", "seen", "unseen", "mean reward", "mean length")
    assert re.split(" {2,}", head) == [*names, "wrong stop", "invalid action", "horizon"]
    values = ("mine", "25.0 %", "50.0 % of 2", "0.0 % of 2", "-0.82", "4.2")
    assert re.split(" {2,}", row) == [*values, *["25.0 %"] * 3]


@pytest.mark.parametrize(("width", "tables"), [(80, 2), (120, 1)])
def test_results_text__fits_the_terminal_and_splits_no_word(width, tables):
    other = replace(result(), named=replace(result().named, name="imitation, seed 0"))
    text = results_text([result(), other], width)
    assert max(map(len, text.splitlines())) <= width
    for words in ("wrong stop", "invalid action", "horizon", "imitation, seed 0", *legend([result()]).split()):
        assert words in text
    assert text.count("\npolicy ") == tables


def test_results_text__leads_with_accuracies_by_policy_and_configuration_and_omits_seen_if_there_are_none():
    plan = EvaluationPlan(Settings("ScatterScratch"), "dev")
    scatter = replace(result(), plan=plan, summary=summarise(EPISODES, set()))
    other = replace(scatter, named=replace(scatter.named, name="other"))
    text = results_text([result(), scatter, other], 100)
    assert [line.split() for line in text.splitlines()[:4]] == [
        ["accuracy", "TowerScratch", "ScatterScratch"],
        ["-" * len(text.splitlines()[1])],
        ["mine", "25.0", "%", "25.0", "%"],
        ["other", "-", "25.0", "%"],
    ]
    assert "seen" in text
    assert "seen" not in results_text([scatter, other], 100)


def test_markdown_table__aligns_numbers_right_and_texts_left():
    rows = [("a", "bcd", "ef"), ("ef", "1.5", "–"), ("g", "x", "12.0 ± 1 [9, 13]")]
    assert markdown_table(rows).splitlines() == [
        "| a  | bcd |               ef |",
        "|----|-----|-----------------:|",
        "| ef | 1.5 |                – |",
        "| g  | x   | 12.0 ± 1 [9, 13] |",
    ]


@pytest.mark.long
def test_results_json__is_sufficient_to_reproduce_the_results():
    plan = EvaluationPlan(Settings("TowerFlipIt"), "dev", seed=5, passes=1, batch_size=16)
    seen = training_statements(plan.settings)
    results = [play(named, plan, seen) for named in BASELINES]
    data = json.loads(json.dumps(results_json(results)))
    (written,) = data["trials"]
    settings = Settings.from_json(written["settings"])
    again = EvaluationPlan(settings, *(written[key] for key in ("split", "seed", "passes", "batch_size")))
    assert again == plan
    assert play(BASELINES[1], again, seen).episodes == results[1].episodes
    rows = [(row["agent"], row["accuracy"]) for row in data["results"]]
    assert rows == [(each.named.name, each.summary.accuracy) for each in results]
    tasks = settings.tasks("dev")
    assert written["tasks"].items() >= {"sha256": tasks.provenance.sha256, "start_scenes": len(tasks)}.items()
    assert {"python", "numpy", "gymnasium"} <= set(data["software"])


def test_playable__skips_policies_that_cannot_play_the_configuration():
    tower_only = NamedPolicy("tower only", lambda settings: random_legal, configurations=("TowerScratch",))
    assert not playable([tower_only], EvaluationPlan(Settings("ScatterScratch"), "dev"))
