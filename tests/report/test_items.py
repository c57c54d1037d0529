"""Report numbers against a few hand-counted episodes, and the files of a report."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import mean
from typing import Any

import pytest
from matplotlib.container import BarContainer

from lilgym_mp.actions import Action, named
from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.evaluation.episodes import SUFFIX, Header, RecordedEpisode, Recording, write_episodes
from lilgym_mp.evaluation.files import OutputError
from lilgym_mp.evaluation.recording_metadata import RecordingMetadata
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.report import ReportError, html_report, make_report
from lilgym_mp.report import items as report_items
from lilgym_mp.report.aggregation import (
    MeanStd,
    accuracy_where,
    add_up,
    holm,
    mean_std,
    mean_where,
    paired_difference,
    success,
)
from lilgym_mp.report.behaviour import ADDS, ERROR_KINDS, REMOVES, ROLLOUT_STATISTICS, action_map, error_kind, errors
from lilgym_mp.report.charts import BarPanel, bar_chart
from lilgym_mp.report.difficulty import _regret, calibration_line, comparison_items, edits_category
from lilgym_mp.report.html_report import chapters
from lilgym_mp.report.items import Chart, MissingItem, Table, format_cell
from lilgym_mp.report.language import accuracy_by_novelty, accuracy_by_phenomenon, read_tags
from lilgym_mp.report.learning_curves import dev_curves, mean_line, progress_curves
from lilgym_mp.report.markdown_report import commits_text
from lilgym_mp.report.report_data import ReportData, load_report_data
from lilgym_mp.report.results import basis, figure_5, provenance, table_2, training_runs
from lilgym_mp.scene import Scene

SCATTER = Settings("ScatterFlipIt")
ITEM = {"x_loc": 10, "y_loc": 10, "type": "circle", "color": "#0099ff", "size": 20}
BLUE = Scene.from_json([[{**ITEM, "color": "#0099ff"}], [], []])
HEADER = Header(
    "0.1.0",
    SCATTER,
    "dev",
    "mine",
    "rewards alone",
    "greedy",
    False,
    False,
    0,
    0,
    1,
    0,
    6,
    4,
    "own",
    "f" * 64,
    True,
    "runs/a",
)


def actions(*names: str) -> tuple[Action, ...]:
    return tuple(map(named, names))


def episode(outcome: str, *names: str, **changes: Any) -> RecordedEpisode:
    last = 1.0 if outcome == "success" else -1.0
    made = RecordedEpisode(
        task=f"task-{outcome}-{len(names)}",
        statement="There is a blue item.",
        program="exist(filter_color(all_items, Color.BLUE))",
        target=False,
        statement_seen=False,
        form_seen=False,
        tags=(),
        outcome=outcome,
        invalid_reason=None,
        actions=actions(*names),
        rewards=(*(-0.1,) * (len(names) - 1), last),
        start=BLUE,
        optimal_actions=2,
    )
    return replace(made, **changes)


# Two successes in six; one of them takes an edit more than necessary.
EPISODES = (
    episode("success", "REMOVE(0, 0)", "STOP", statement_seen=True, form_seen=True),
    episode("success", "ADD(0, 4, CIRCLE, BLUE, SMALL)", "REMOVE(0, 0)", "STOP", statement="No blue.", form_seen=True),
    episode("wrong_stop", "STOP", statement="B", target=True, actions_left=2, program="not exist(all_items)"),
    episode("wrong_stop", "REMOVE(0, 0)", "STOP", statement="B", actions_left=4, optimal_actions=5),
    episode("wrong_stop", "REMOVE(0, 0)", "STOP", statement="C", actions_left=5, optimal_actions=5),
    episode("invalid_action", "REMOVE(18, 4)", statement="C", target=True, invalid_reason="nothing_to_remove"),
)


def written(directory: Path, episodes: Sequence[RecordedEpisode] = EPISODES, **changes: Any) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    header = replace(HEADER, episodes=len(episodes), **changes)
    name = f"{header.agent} {header.settings.configuration} {header.split} {header.training_seed} {header.seed}{SUFFIX}"
    write_episodes(directory / name, header, episodes)
    return directory / name


@pytest.fixture
def data(tmp_path: Path) -> ReportData:
    written(tmp_path)
    return load_report_data([tmp_path])


def runs(data: ReportData) -> tuple[Recording, ...]:
    return data.entries[0].runs


def plain(cell: Any) -> Any:
    """Without the interval."""
    return MeanStd(*cell[:3]) if isinstance(cell, MeanStd) else cell


def rows(table: Any) -> list[tuple[Any, ...]]:
    assert isinstance(table, Table)
    return [tuple(map(plain, row)) for row in table.rows]


def test_mean_std__reproduces_the_papers_deviation_for_one_success_in_3_x_591():
    assert str(mean_std([100 / 591, 0, 0])) == "0.06 ± 0.10"


def test_mean_std__of_one_run_has_no_deviation_and_of_none_is_none():
    assert mean_std([50.0]) == MeanStd(50.0, None, 1)
    assert mean_std([]) is None


def test_accuracy__and_reward_are_counted_by_episode(data: ReportData):
    assert plain(accuracy_where(runs(data))) == MeanStd(pytest.approx(100 / 3), None, 1)
    reward = mean_where(runs(data), lambda episode: episode.reward)
    assert plain(reward) == MeanStd(pytest.approx((0.9 + 0.8 - 1 - 1.1 - 1.1 - 1) / 6), None, 1)


def test_table_2__aggregates_seeds_next_to_the_papers_rows(tmp_path: Path):
    for seed, kept in enumerate((EPISODES, EPISODES[2:], EPISODES[:2])):
        written(tmp_path, kept, training_seed=seed)
    table = table_2(load_report_data([tmp_path]))
    (ours, *published) = rows(table)
    assert isinstance(table, Table)
    assert table.columns == ("agent", "supervision", "actions", "runs", "ScatterFlipIt dev, n = 6")  # those played
    assert ours == ("mine", "rewards alone", "greedy", 3, MeanStd(pytest.approx(400 / 9), pytest.approx(50.917508), 3))
    assert table.texts()[0][-1] == "44 ± 51 [0, 100]"  # of six episodes
    assert table.texts()[3][1:] == ["rewards alone", "sampled", "3", "13.3 ± 6.9"]
    assert published[2][0] == "PPO ViLT †"
    assert "ScatterFlipIt dev, n = 6 low" in table.csv()


def test_figure_5__splits_by_target(data: ReportData):
    _, table = figure_5(data)
    assert [(row[2], row[3], row[5]) for row in rows(table)] == [
        ("True", 2, MeanStd(0.0, None, 1)),
        ("False", 4, MeanStd(50.0, None, 1)),
    ]


def test_figures_6_and_9__rollout_statistics():
    shares = {name: mean(map(value, EPISODES)) for name, value in ROLLOUT_STATISTICS.items()}
    assert shares == {
        "without STOP (%)": pytest.approx(100 / 6),
        "with an invalid action (%)": pytest.approx(100 / 6),
        "mean actions": pytest.approx(11 / 6),
        "mean ADD": pytest.approx(1 / 6),
        "mean REMOVE": pytest.approx(5 / 6),
    }


def test_section_d2__errors_by_reason_and_by_kind_of_stop(data: ReportData):
    assert [error_kind(kept) for kept in EPISODES] == [
        *(None, None, "direct stop", "early stop", "erroneous stop", "nothing to remove"),
    ]
    assert error_kind(replace(EPISODES[3], actions_left=None)) == "later stop"
    assert error_kind(episode("horizon", *["REMOVE(0, 0)"] * 12)) == "horizon"
    table = next(errors(data))
    (ours, *published) = rows(table)
    assert ours[:4] == ("mine", "ScatterFlipIt", 4, 0.0)
    assert sum(ours[3:]) == pytest.approx(100)
    assert sum(cell or 0 for cell in published[0][3:]) == pytest.approx(100)


def test_figure_10__counts_actions_by_cell_and_type(data: ReportData):
    removed = action_map(data.entries[0], (19, 5), REMOVES)
    assert (removed[0][0], removed[4][18], removed.sum()) == (4, 1, 5)
    assert action_map(data.entries[0], (19, 5), ADDS)[4][0] == 1


def test_phenomena__tags_are_rule_made_unless_a_file_is_given(data: ReportData, tmp_path: Path):
    (table,) = accuracy_by_phenomenon(data, None)
    by_name = {row[0]: row[1:] for row in rows(table)}
    assert by_name["existence"] == (4, 6, 192, MeanStd(pytest.approx(100 / 3), None, 1))
    assert by_name["negation"] == (1, 1, 52, MeanStd(0.0, None, 1))
    assert by_name["syntax: coordination"] == (0, 0, 20, None)
    assert "the words of the statement for the two rows of syntax" in table.note
    assert "rule-made" in table.title
    (tmp_path / "tags.json").write_text('{"No blue.": ["negation", "syntax: coordination"]}')
    (table,) = accuracy_by_phenomenon(data, read_tags(tmp_path / "tags.json"))
    by_name = {row[0]: row[1:] for row in rows(table)}
    assert by_name["syntax: coordination"] == (1, 1, 20, MeanStd(100.0, None, 1))
    assert "hand-made" in table.title


def test_phenomena__syntax_rows_are_derived_from_the_statement(tmp_path: Path):
    joined = "We see a box with a circle and a blue square."
    nested = "We see a box with a square on a triangle."
    kept = [replace(EPISODES[0], statement=joined), replace(EPISODES[2], statement=nested), *EPISODES[3:]]
    written(tmp_path, kept)
    (table,) = accuracy_by_phenomenon(load_report_data([tmp_path]), None)
    by_name = {row[0]: row[1:] for row in rows(table)}
    assert by_name["syntax: coordination"] == (1, 1, 20, MeanStd(100.0, None, 1))
    assert by_name["syntax: prepositional attachment"] == (1, 1, 8, MeanStd(0.0, None, 1))


def test_seen_and_new__splits_accuracy_by_novelty(data: ReportData):
    _, table = accuracy_by_novelty(data)
    assert rows(table)[0][2:] == (1, MeanStd(100.0, None, 1), 1, MeanStd(100.0, None, 1), 4, MeanStd(0.0, None, 1))


def test_edits_needed__come_from_the_experts_solution():
    assert [edits_category(kept) for kept in EPISODES[:4]] == ["1", "1", "1", "4"]
    assert edits_category(replace(EPISODES[0], optimal_actions=9)) == "6 or more"
    assert edits_category(replace(EPISODES[0], optimal_actions=None)) is None


def test_regret__extra_actions_and_shares_of_optimal_episodes(data: ReportData):
    assert list(map(plain, _regret(data.entries[0]))) == [
        MeanStd(0.5, None, 1),
        MeanStd(50.0, None, 1),
        MeanStd(pytest.approx(100 / 6), None, 1),
    ]


def test_calibration__compares_the_probability_of_stop_with_its_success(tmp_path: Path):
    # The target is "no blue item": STOP is wrong before the removal and right after it.
    kept = (
        episode("success", "REMOVE(0, 0)", "STOP", stop_probabilities=(0.12, 0.97)),
        episode("wrong_stop", "STOP", stop_probabilities=(0.18,)),
    )
    written(tmp_path, kept)
    line = calibration_line(load_report_data([tmp_path]).entries[0])
    assert line is not None
    assert line.xs == [pytest.approx(0.15), 0.97]
    assert line.ys == [0.0, 1.0]


def test_totals__are_by_run_and_statement(data: ReportData):
    totals = add_up([run.episodes for run in runs(data)], success)
    assert totals.statements == ("B", "C", "No blue.", "There is a blue item.")
    assert totals.values.tolist() == [[0, 0, 100, 100]]
    assert totals.episodes.tolist() == [[2, 2, 1, 1]]


def accuracies(*by_statement: Sequence[int]) -> tuple[RecordedEpisode, ...]:
    """Episodes of statements "0", "1", ...: successes (1) and failures (0) of each."""
    return tuple(
        episode("success" if outcome else "wrong_stop", "STOP", statement=str(index), task=f"{index}-{number}")
        for index, outcomes in enumerate(by_statement)
        for number, outcome in enumerate(outcomes)
    )


def recordings(directory: Path, *of_runs: Sequence[RecordedEpisode], agent: str = "mine") -> tuple[Recording, ...]:
    for seed, kept in enumerate(of_runs):
        written(directory, kept, training_seed=seed, agent=agent)
    return load_report_data([directory]).entries[0].runs


def interval(of: Sequence[Recording]) -> tuple[float, float]:
    found = accuracy_where(of)
    assert found is not None
    return found.spread


def test_interval__carries_the_spread_between_statements_and_between_runs(tmp_path: Path):
    half = accuracies(*[[1], [0]] * 50)
    alike = interval(recordings(tmp_path / "alike", half))
    assert alike == (pytest.approx(40, abs=1.5), pytest.approx(60, abs=1.5))  # 50 +- 1.96 * 50 / sqrt(100)
    all_or_nothing = recordings(tmp_path / "unlike", accuracies(*[[1]] * 100), accuracies(*[[0]] * 100))
    assert interval(all_or_nothing) == (0, 100)
    one_statement = accuracies([1, 0] * 50)
    assert interval(recordings(tmp_path / "one", one_statement)) == (50, 50)
    assert accuracy_where(all_or_nothing, lambda episode: episode.target) is None


def test_paired_difference__resamples_the_statements_of_both_agents_together(tmp_path: Path):
    hard = [[1]] * 60 + [[0]] * 40
    first = recordings(tmp_path / "first", accuracies(*hard))
    better = recordings(tmp_path / "better", accuracies(*[[1]] * 70, *[[0]] * 30))
    difference = paired_difference(better, first)
    assert difference is not None
    assert difference[:3] == (pytest.approx(10), pytest.approx(4.5, abs=1.5), pytest.approx(16, abs=1.5))
    assert difference.p_value == pytest.approx(0.001, abs=0.001)  # z = 10 / 3
    assert paired_difference(first, first) == (0, 0, 0, 1)
    none = recordings(tmp_path / "none", accuracies(*[[0]] * 5))
    all_five = recordings(tmp_path / "all", accuracies(*[[1]] * 5))
    assert paired_difference(all_five, none) == (100, 100, 100, 2**-4)


def test_holm__corrects_p_values_for_their_number():
    assert holm([0.01, 0.04, 0.03, 0.6]) == pytest.approx([0.04, 0.09, 0.09, 0.6])
    assert holm([]) == []


def test_paired_tests__p_is_corrected_for_the_tests_of_the_table(tmp_path: Path):
    for agent, successes in (("first", 60), ("second", 60), ("third", 70)):
        written(tmp_path, accuracies(*[[1]] * successes, *[[0]] * (100 - successes)), agent=agent)
    data = load_report_data([tmp_path])
    (table,) = comparison_items(data)
    difference = paired_difference(data.entries[0].runs, data.entries[2].runs)
    assert difference is not None
    three_times = f"{3 * difference.p_value:.4f}"
    assert [row[-1] for row in rows(table)] == ["1.0000", three_times, three_times]
    assert "corrected for the 3 tests" in table.note


def test_evaluation_seeds__of_a_trained_agent_are_one_run(tmp_path: Path):
    for evaluation_seed, outcomes in enumerate(([1, 1], [0, 1])):
        written(tmp_path, accuracies(outcomes), seed=evaluation_seed, actions="sampled", training_seed=0)
    (entry,) = load_report_data([tmp_path]).entries
    assert entry.evaluation_seeds == (0, 1)
    assert [(len(run.episodes), run.header.passes) for run in entry.runs] == [(4, 2)]
    assert plain(accuracy_where(entry.runs)) == MeanStd(75.0, None, 1)


def test_chapters__name_every_item_as_the_paper_does(data: ReportData):
    names = " ".join(item.item for _, items in chapters(data, None) for item in items)
    for table in range(1, 7):
        assert f"Table {table}" in names
    for figure in (1, 2, 3, 4, 5, 6, 7, 9, 10):
        assert f"Figure {figure}" in names
    assert "Section D.2" in names


def test_chapters__missing_items_say_why(tmp_path: Path):
    written(tmp_path, [episode("horizon", *["REMOVE(0, 0)"] * 12, optimal_actions=None)], expert=False)
    missing = {
        item.item: item
        for _, items in chapters(load_report_data([tmp_path]), None)
        for item in items
        if isinstance(item, MissingItem)
    }
    assert {
        "Figure 1",
        "Figure 4",
        "Edits needed",
        "Regret",
        "Calibration of STOP",
        "Horizon left at STOP",
    } <= missing.keys()
    assert "--optimal" in missing["Regret"].note


def digests(directory: Path) -> dict[str, str]:
    files = [path for path in directory.rglob("*") if path.is_file()]
    return {str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.long
def test_report__is_reproducible_and_writes_every_item_as_files(tmp_path: Path):
    written(tmp_path / "kept")
    page = make_report([tmp_path / "kept"], tmp_path / "one").read_text()
    before = digests(tmp_path)
    (tmp_path / "one" / "figures" / "old.svg").touch()
    make_report([tmp_path / "kept"], tmp_path / "one")  # replaces the existing report
    assert digests(tmp_path) == before
    assert "http" not in page.replace("http://www.w3.org", "")  # no external resources
    made = [item for _, items in chapters(load_report_data([tmp_path / "kept"]), None) for item in items]
    for item in made:
        assert f'id="{item.name}"' in page
        for suffix in {Table: ("tables/{}.csv", "tables/{}.md"), Chart: ("figures/{}.svg", "figures/{}.png")}.get(
            type(item), ()
        ):
            assert (tmp_path / "one" / suffix.format(item.name)).stat().st_size
    with next((tmp_path / "one" / "tables").glob("table-2*.csv")).open() as file:
        first = next(csv.DictReader(file))
    column = "ScatterFlipIt dev, n = 6"
    assert float(first[f"{column} mean"]) == pytest.approx(100 / 3)
    assert (first["agent"], first[f"{column} sd"], first[f"{column} runs"]) == ("mine", "", "1")


def test_report__escapes_statements(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(html_report, "save", lambda figure, path, kind: path.write_bytes(b""))  # drawing is slow
    written(tmp_path / "kept", [replace(EPISODES[0], statement="<script>$x_1$")], agent="<b>mine<b>")
    page = make_report([tmp_path / "kept"], tmp_path / "out").read_text()
    assert "<b>mine" not in page
    assert "&lt;b&gt;mine" in page


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"settings": replace(SCATTER, corpus="lilgym")}, "corpus is 'lilgym', but 'builtin' in"),
        ({"settings": replace(SCATTER, rules="release")}, "rules is 'release', but 'paper' in"),
        ({"tasks_sha256": "0" * 64}, "tasks_sha256 is 000000000000"),
        ({"run": "runs/b"}, "training_seed 0 and seed 0 are those of"),
        ({"training_seed": None}, "training_seed is missing"),
    ],
)
def test_report__incomparable_recordings_are_refused_naming_file_and_key(
    tmp_path: Path, change: dict[str, Any], said: str
):
    written(tmp_path / "kept" / "a")
    other = written(tmp_path / "kept" / "b", **change)
    with pytest.raises(ReportError, match=said) as fault:
        make_report([tmp_path / "kept"], tmp_path / "out")
    assert str(other.parent) in str(fault.value) or "training_seed" in said
    assert not (tmp_path / "out").exists()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


@pytest.mark.parametrize(
    ("prepare", "words", "said"),
    [
        (lambda place: (place / "empty").mkdir(), ["empty"], "empty contains no training run and no recorded episodes"),
        (lambda place: None, ["absent"], "absent: there is no such file"),
        (lambda place: cut(written(place / "kept")), ["kept"], "truncated"),
        (lambda place: (place / "x").write_text("hello"), ["x"], "damaged, or not a file of recorded episodes"),
        (lambda place: written(place / "kept"), ["kept", "--tags", "{}/no"], "no: cannot be read"),
    ],
)
def test_report_command__bad_input_is_reported_in_one_line_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], prepare: Callable[[Path], object], words: list[str], said: str
):
    prepare(tmp_path)
    place, *options = words
    command = ["report", str(tmp_path / place), *(word.format(tmp_path) for word in options)]
    assert main([*command, "--out", str(tmp_path / "out")]) == USAGE_ERROR
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_report__an_unknown_phenomenon_in_hand_made_tags_is_named_with_the_choices(tmp_path: Path):
    (tmp_path / "tags.json").write_text('{"A statement.": ["irony"]}')
    with pytest.raises(ReportError, match=r"tags\.json.*'A statement\.'.*'irony'.*choose from existence"):
        read_tags(tmp_path / "tags.json")


def test_report__a_directory_with_other_files_is_not_touched(tmp_path: Path):
    written(tmp_path / "kept")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("x")
    with pytest.raises(OutputError, match="holds something other than a report"):
        make_report([tmp_path / "kept"], tmp_path / "out")
    assert (tmp_path / "out" / "precious").read_text() == "x"


def trained(
    directory: Path,
    seed: int,
    points: Sequence[tuple[float | None, ...]],
    configuration: str = "TowerScratch",
    **recipe: Any,
) -> None:
    """A PPO run with evaluations: accuracy on all tasks, on tasks with an image, and image accuracy."""
    directory.mkdir(parents=True)
    environment = {"configuration": configuration}
    identity = {"learner": "ppo", "environment": environment, "recipe": {"seed": seed, **recipe}}
    (directory / "run.json").write_text(json.dumps({"identity": identity}))
    (directory / "progress.jsonl").write_text('{"steps": 32, "accuracy": 0.5}\n')
    keys = ("steps", "accuracy", "accuracy_with_image", "image_accuracy")
    lines = [json.dumps(dict(zip(keys, (32 * index, *point), strict=True))) for index, point in enumerate(points)]
    (directory / "evaluations.jsonl").write_text("\n".join(lines))


def test_figure_4__averages_dev_accuracy_over_seeds_by_reward(tmp_path: Path):
    written(tmp_path)
    trained(tmp_path / "a", 0, [(0, 0.1, 0), (0, 0.5, 0), (0, 0.9, 0)])
    trained(tmp_path / "b", 1, [(0, 0.3, 0), (0, 0.7, 0)])
    trained(tmp_path / "c", 0, [(0, 0.2, 0), (0, 0.4, 0.25)], nlvr_reward=True)
    found = load_report_data([tmp_path])
    line = mean_line("x", [curve.evaluations for curve in found.curves[:2]], "accuracy_with_image", 100)
    assert (line.xs, line.ys) == ([0, 32], [pytest.approx(20), pytest.approx(60)])
    assert line.deviations == [pytest.approx(200**0.5), pytest.approx(200**0.5)]
    chart, table = dev_curves(found.curves)
    assert isinstance(chart, Chart)
    assert rows(table) == [
        ("PPO, program reward", "TowerScratch", 2, 32, MeanStd(pytest.approx(80), pytest.approx(200**0.5), 2)),
        ("PPO, NLVR reward", "TowerScratch", 1, 32, MeanStd(25.0, None, 1)),
        ("PPO, NLVR reward, by program", "TowerScratch", 1, 32, MeanStd(40.0, None, 1)),
    ]


@pytest.mark.parametrize(
    ("recipes", "expected", "absent"),
    [
        ([{"mask": False}], "no mask of legal actions", "illegal ones masked"),
        ([{"mask": True}], "illegal ones masked", "no mask"),
        ([{"mask": False}, {"mask": True}], "masked for some runs alone", "no mask"),
        ([{}], "not recorded whether masked", "illegal ones"),
        ([{"mask": False, "stop_forcing": True}], "STOP was forced in training", "NLVR"),
        ([{"mask": False, "nlvr_reward": True}], "with the NLVR reward", "forced"),
    ],
)
def test_figure_4__caption_says_what_the_recipes_say(
    tmp_path: Path, recipes: list[dict[str, bool]], expected: str, absent: str
):
    written(tmp_path)
    for seed, recipe in enumerate(recipes):
        trained(tmp_path / str(seed), seed, [(0.5, 0.5, 0.5)], **recipe)
    chart, _ = dev_curves(load_report_data([tmp_path]).curves)
    assert expected in chart.note
    assert absent not in chart.note


def test_figure_4__lines_name_stop_forcing(tmp_path: Path):
    written(tmp_path)
    for seed, forced in enumerate((False, True)):
        trained(tmp_path / str(seed), seed, [(0.5, None, None)], stop_forcing=forced)
    _, table = dev_curves(load_report_data([tmp_path]).curves)
    assert [row[0] for row in rows(table)] == ["PPO", "PPO+SF"]


def test_figure_4__a_recipe_has_one_name_in_all_panels(tmp_path: Path):
    written(tmp_path)
    recipes = [("ScatterScratch", "ours"), ("ScatterScratch", "other"), ("TowerScratch", "ours")]
    for seed, (configuration, model) in enumerate(recipes):
        trained(tmp_path / str(seed), 0, [(0.5, None, None)], configuration, model=model)
    _, table = dev_curves(load_report_data([tmp_path]).curves)
    assert [row[0] for row in rows(table)] == ["PPO, model ours", "PPO, model ours", "PPO, model other"]


def test_figure_4__of_a_single_evaluation_is_a_point_at_a_whole_number_of_steps(tmp_path: Path):
    written(tmp_path)
    trained(tmp_path / "a", 0, [(0.5, None, None)])
    chart, _ = dev_curves(load_report_data([tmp_path]).curves)
    (axes,) = chart.figure.axes
    (line,) = axes.lines
    assert line.get_marker() == "o"
    low, high = axes.get_xlim()
    assert [tick for tick in axes.get_xticks() if low <= tick <= high] == [0]


def test_training_runs__name_corpus_checksum_commit_and_the_whole_recipe(tmp_path: Path):
    written(tmp_path)
    trained(tmp_path / "a", 3, [(0.5, None, None)], mask=False, gamma=0.99)
    file = tmp_path / "a" / "run.json"
    described = json.loads(file.read_text())
    described["identity"] |= {
        "environment": {"configuration": "TowerScratch", "corpus": "own"},
        "tasks_sha256": "e" * 64,
    }
    file.write_text(json.dumps({**described, "made": {"commit": "abc"}}))
    table = training_runs(load_report_data([tmp_path]))
    assert rows(table) == [("a", "ppo", "TowerScratch", "own", "e" * 10, "abc", "seed 3, mask off, gamma 0.99")]


def test_basis__every_row_names_seeds_tasks_supervision_actions_and_commit(tmp_path: Path):
    recording = written(tmp_path, training_seed=5, seed=7)
    RecordingMetadata("2026-01-01 10:00", "lilgym-mp evaluate x", "abc", "a processor", {}).write(recording)
    table = basis(load_report_data([tmp_path]))
    (row,) = (dict(zip(table.columns, row, strict=True)) for row in rows(table))
    assert (row["training seeds"], row["evaluation seeds"], row["runs"], row["episodes"]) == ("5", "7", 1, 6)
    assert (row["actions"], row["supervision"]) == ("greedy", "rewards alone")
    assert (row["tasks"], row["commit"]) == ("f" * 10, "abc")


def test_learning_curves__are_means_over_the_runs_of_a_recipe(tmp_path: Path):
    written(tmp_path)
    for seed, rates in enumerate(([0.2, 0.4], [0.4, 0.8, 0.9])):
        trained(tmp_path / str(seed), seed, [(0, 0.1, 0)])
        lines = [json.dumps({"steps": 10 * (step + 1), "accuracy": rate}) for step, rate in enumerate(rates)]
        (tmp_path / str(seed) / "progress.jsonl").write_text("\n".join(lines))
    chart = progress_curves(load_report_data([tmp_path]))
    assert isinstance(chart, Chart)
    (axes,) = chart.figure.axes
    (line,) = axes.lines
    assert list(line.get_xdata()) == [10, 20]  # to the end of the first run
    assert list(line.get_ydata()) == pytest.approx([0.3, 0.6])
    assert axes.get_title(loc="left") == "ppo TowerScratch"
    assert len(axes.collections) == 1  # the band


def test_bar_chart__has_error_bars_a_shared_axis_and_labels_that_do_not_collide():
    measured = MeanStd(50.0, None, 1, 40.0, 65.0)
    names = [kind.replace(" ", "\n") for kind in ERROR_KINDS]
    values = {f"agent {index}": [measured, None, *[20.0] * 7] for index in range(5)}
    figure = bar_chart([BarPanel("one", names, values), BarPanel("other", names[:2], {"agent 0": [1.0, 2.0]})], "%")
    one, other = figure.axes
    assert one.get_ylim() == other.get_ylim()
    assert [axes.get_ylabel() for axes in figure.axes] == ["%", "%"]
    (lines,) = next(bars.errorbar for bars in one.containers if isinstance(bars, BarContainer)).lines[2]
    assert lines.get_segments()[0][:, 1].tolist() == [40, 65]
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [label.get_window_extent() for label in (*axes.get_xticklabels(), *axes.texts) if label.get_text()]
        assert not any(box.overlaps(after) for box, after in pairwise(boxes))


def test_bar_chart__labels_of_a_panel_have_the_same_decimals():
    rewards, shares = BarPanel("", ["a", "b"], {"x": [0.641, -1.2]}), BarPanel("", ["a", "b"], {"x": [9.5, 12.3]})
    figure = bar_chart([rewards, shares], "")
    assert [[label.get_text() for label in axes.texts] for axes in figure.axes] == [["0.64", "-1.20"], ["10", "12"]]


def test_table__columns_without_own_values_are_dropped_and_decimals_fit():
    half = MeanStd(2 / 3, None, 3)
    cells = [("own", 200 / 3, None, half), ("paper †", 1.0, 2.0, None)]
    made = report_items.table("Table", "Shares", ("a", "b (%)", "c", "d"), cells)
    assert made.columns == ("a", "b (%)", "d")
    assert made.texts() == [["own", "66.7", "0.67"], ["paper †", "1.0", "–"]]
    few = MeanStd(200 / 3, 1.25, 3, 60.04, 70.06, episodes=99)
    shown = [format_cell(cell, places=1) for cell in (few, few._replace(episodes=100))]
    assert shown == ["67 ± 1 [60, 70]", "66.7 ± 1.2 [60.0, 70.1]"]


def test_figure_4__uses_all_flipit_tasks_and_explains_missing_evaluations(tmp_path: Path):
    written(tmp_path)
    trained(tmp_path / "a", 0, [(0.5, None, None)])
    _, table = dev_curves(load_report_data([tmp_path]).curves)
    assert rows(table)[0][-1] == MeanStd(50.0, None, 1)
    (missing,) = dev_curves(())
    assert isinstance(missing, MissingItem)
    assert "--evaluate-every" in missing.note


def test_report__damaged_evaluations_are_named(tmp_path: Path):
    written(tmp_path)
    trained(tmp_path / "a", 0, [(0.5, None, None)])
    (tmp_path / "a" / "evaluations.jsonl").write_text('{"steps"')
    with pytest.raises(ReportError, match="damaged, or not the progress"):
        load_report_data([tmp_path])


def test_provenance__lists_commands_dates_commits_and_machines(tmp_path: Path):
    for seed, date in enumerate(("2026-01-01 10:00", "2026-01-02 11:00")):
        recording = written(tmp_path, training_seed=seed)
        RecordingMetadata(date, "lilgym-mp evaluate x", "abc", "a processor, 2 cores", {}).write(recording)
    table = provenance(load_report_data([tmp_path]))
    assert rows(table) == [
        ("lilgym-mp evaluate x", "2026-01-01 10:00, 2026-01-02 11:00", "abc", "a processor, 2 cores", 2),
    ]


def test_document__has_tables_pictures_and_provenance_but_no_statement(tmp_path: Path):
    recording = written(tmp_path / "kept" / "episodes")
    RecordingMetadata("2026-01-01 10:00", "lilgym-mp evaluate x", "abc", "a processor", {}).write(recording)
    (tmp_path / "kept" / "finished").mkdir()
    finished = {"commands": [["train", "ppo", "TowerScratch"], ["evaluate"]], "seconds": 1}
    (tmp_path / "kept" / "finished" / "a.json").write_text(json.dumps(finished))
    page = tmp_path / "docs" / "results.md"
    command = ["report", str(tmp_path / "kept"), "--out", str(tmp_path / "out"), "--document", str(page)]
    assert main(command) == 0
    text, pictures = page.read_text(), list((tmp_path / "docs" / "pictures").iterdir())
    assert "Episodes recorded 2026-01-01 10:00 UTC; commit abc; machine: a processor." in text
    assert "Trained by:\n\n```\nlilgym-mp train ppo TowerScratch\n```" in text
    assert "Recorded by:\n\n```\nlilgym-mp evaluate x\n```" in text
    assert f"`lilgym-mp {' '.join(command)}`" in text
    assert "| mine " in text
    assert {path.name for path in pictures} == set(re.findall(r"\(pictures/(.*?)\)", text))
    assert any("figure-3" in path.name for path in pictures)
    assert not [kept.statement for kept in EPISODES[:2] if kept.statement in text]


@pytest.mark.parametrize(
    ("commits", "text"),
    [
        (["abc"], "commit abc"),
        (["abc", "abc"], "commit abc"),
        (["abc with changes"], "commit abc with changes"),
        (["abc with changes", "abc", "fed", None], "commits abc with changes, abc, fed, unknown"),
        ([None], "commit unknown"),
    ],
)
def test_document__commits_are_listed_once(commits: list[str | None], text: str):
    made = [RecordingMetadata(f"2026-01-0{day}", "x", name, "x", {}) for day, name in enumerate(commits, start=1)]
    assert commits_text(made) == text


def test_document__another_page_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    written(tmp_path / "kept")
    (tmp_path / "mine.md").write_text("# Mine")
    command = ["report", str(tmp_path / "kept"), "--out", str(tmp_path / "out"), "--document"]
    assert main([*command, str(tmp_path / "mine.md")]) == USAGE_ERROR
    assert "was not made by a report; choose a new file" in capsys.readouterr().err
    assert main([*command, str(tmp_path)]) == USAGE_ERROR
    assert (tmp_path / "mine.md").read_text() == "# Mine"
    assert not (tmp_path / "out").exists()


def test_labels__distinguish_runs_that_differ_in_more_than_the_seed(tmp_path: Path):
    written(tmp_path / "a", recipe={"width": 64, "seed": 0})
    written(tmp_path / "b", recipe={"width": 128, "seed": 1}, training_seed=1)
    written(tmp_path / "c", recipe={"width": 128, "seed": 2}, training_seed=2)
    found = load_report_data([tmp_path])
    assert {entry.agent: len(entry.runs) for entry in found.entries} == {"mine (width 64)": 1, "mine (width 128)": 2}


def test_report__of_random_policies_agrees_with_the_evaluation(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    kept, results = tmp_path / "kept", tmp_path / "results.json"
    words = ["--policy", "random-legal", "random-type", "--configuration", "TowerFlipIt"]
    assert main(["evaluate", *words, "--record", str(kept), "--json", str(results)]) == 0
    found = load_report_data([kept])
    for row in json.loads(results.read_text())["results"]:
        entry = found.find(row["agent"], "TowerFlipIt")
        assert entry is not None
        assert plain(accuracy_where(entry.runs)) == MeanStd(pytest.approx(100 * row["accuracy"]), None, 1)
        reward = mean_where(entry.runs, lambda episode: episode.reward)
        assert plain(reward) == MeanStd(pytest.approx(row["mean_reward"]), None, 1)
        invalid = mean_where(entry.runs, ROLLOUT_STATISTICS["with an invalid action (%)"])
        assert invalid is not None
        assert invalid.mean == pytest.approx(100 * row["outcomes"]["invalid_action"])
