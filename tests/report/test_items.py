"""Report numbers against a few hand-counted episodes, and the files of a report."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.actions import Action, named
from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.evaluation.episodes import SUFFIX, Header, RecordedEpisode, Recording, write_episodes
from lilgym_mp.evaluation.files import OutputError
from lilgym_mp.evaluation.recording_metadata import RecordingMetadata
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.report import ReportError, html_report, make_report
from lilgym_mp.report.aggregation import (
    MeanStd,
    accuracy,
    aggregate_runs,
    mean_std,
    paired_difference,
    successes_by_statement,
)
from lilgym_mp.report.behaviour import ADDS, REMOVES, ROLLOUT_STATISTICS, action_map, error_kind, errors
from lilgym_mp.report.difficulty import _regret, calibration_line, edits_category
from lilgym_mp.report.html_report import chapters
from lilgym_mp.report.items import Chart, MissingItem, Table
from lilgym_mp.report.language import accuracy_by_novelty, accuracy_by_phenomenon, read_tags
from lilgym_mp.report.learning_curves import dev_curves, mean_line
from lilgym_mp.report.markdown_report import commits_text
from lilgym_mp.report.report_data import ReportData, load_report_data
from lilgym_mp.report.results import figure_5, mean_reward, provenance, table_2
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
        phenomena=("existence",),
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
    episode("wrong_stop", "STOP", statement="B", target=True, actions_left=2, phenomena=("negation", "existence")),
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


def rows(table: Any) -> list[tuple[Any, ...]]:
    assert isinstance(table, Table)
    return list(table.rows)


def test_mean_std__reproduces_the_papers_deviation_for_one_success_in_3_x_591():
    assert str(mean_std([100 / 591, 0, 0])) == "0.06 ± 0.10"


def test_mean_std__of_one_run_has_no_deviation_and_of_none_is_none():
    assert mean_std([50.0]) == MeanStd(50.0, None, 1)
    assert mean_std([]) is None


def test_accuracy__and_reward_are_counted_by_episode(data: ReportData):
    assert aggregate_runs(runs(data), accuracy) == MeanStd(pytest.approx(100 / 3), None, 1)
    assert mean_reward(EPISODES) == pytest.approx((0.9 + 0.8 - 1 - 1.1 - 1.1 - 1) / 6)


def test_table_2__aggregates_seeds_next_to_the_papers_rows(tmp_path: Path):
    for seed, kept in enumerate((EPISODES, EPISODES[2:], EPISODES[:2])):
        written(tmp_path, kept, training_seed=seed)
    table = table_2(load_report_data([tmp_path]))
    (ours, *published) = rows(table)
    assert isinstance(table, Table)
    dev = table.columns.index("ScatterFlipIt dev")
    assert ours[dev] == MeanStd(pytest.approx(400 / 9), pytest.approx(50.917508), 3)
    assert ours[table.columns.index("TowerScratch dev")] is None
    assert str(published[0][table.columns.index("ScatterFlipIt test")]) == "0.06 ± 0.10"


def test_figure_5__splits_by_target(data: ReportData):
    _, table = figure_5(data)
    assert [(row[2], row[3], row[5]) for row in rows(table)] == [
        ("True", 2, MeanStd(0.0, None, 1)),
        ("False", 4, MeanStd(50.0, None, 1)),
    ]


def test_figures_6_and_9__rollout_statistics():
    shares = {name: number(EPISODES) for name, number in ROLLOUT_STATISTICS.items()}
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
    assert (removed[0][0], removed[4][18], sum(map(sum, removed))) == (4, 1, 5)
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
    assert _regret(data.entries[0]) == (
        MeanStd(0.5, None, 1),
        MeanStd(50.0, None, 1),
        MeanStd(pytest.approx(100 / 6), None, 1),
    )


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


def test_bootstrap__resamples_statements(data: ReportData, tmp_path: Path):
    assert successes_by_statement(runs(data)) == {
        "There is a blue item.": (1, 1),
        "No blue.": (1, 1),
        "B": (0, 2),
        "C": (0, 2),
    }
    solved = [episode("success", "STOP", statement=kept.statement) for kept in EPISODES]
    written(tmp_path / "other", solved, agent="other")
    other = load_report_data([tmp_path / "other"]).entries[0].runs
    difference = paired_difference(other, runs(data))
    assert difference is not None
    assert difference.points == pytest.approx(200 / 3)
    assert 0 <= difference.low <= difference.points <= difference.high <= 100
    same = paired_difference(other, other)
    assert same is not None
    assert (same.points, same.low, same.high, same.p_value) == (0, 0, 0, 1)


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
    assert float(first["ScatterFlipIt dev mean"]) == pytest.approx(100 / 3)
    assert (first["agent"], first["ScatterFlipIt dev sd"], first["ScatterFlipIt dev runs"]) == ("mine", "", "1")


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


def trained(directory: Path, seed: int, points: Sequence[tuple[float | None, ...]], **recipe: Any) -> None:
    """A PPO run on TowerScratch with evaluations: accuracy on all tasks, on tasks with an image, and image accuracy."""
    directory.mkdir(parents=True)
    environment = {"configuration": "TowerScratch"}
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
    line = mean_line("x", [curve.evaluations for curve in found.curves[:2]], "accuracy_with_image")
    assert (line.xs, line.ys) == ([0, 32], [pytest.approx(20), pytest.approx(60)])
    assert line.deviations == [pytest.approx(200**0.5), pytest.approx(200**0.5)]
    chart, table = dev_curves(found.curves)
    assert isinstance(chart, Chart)
    assert rows(table) == [
        ("ppo, program reward", "TowerScratch", 2, 32, MeanStd(pytest.approx(80), pytest.approx(200**0.5), 2)),
        ("ppo, NLVR reward", "TowerScratch", 1, 32, MeanStd(25.0, None, 1)),
        ("ppo, NLVR reward, by program", "TowerScratch", 1, 32, MeanStd(40.0, None, 1)),
    ]


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
        (["abc with changes"], "commit abc (with uncommitted changes)"),
        (
            ["abc with changes", "abc", "def with changes", "fed"],
            "commits abc (with and without uncommitted changes), def (with uncommitted changes) and fed",
        ),
        (["abc", None], "commit abc, unknown for some recordings"),
        ([None], "commit unknown"),
    ],
)
def test_document__commits_are_listed_in_words(commits: list[str | None], text: str):
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
        assert aggregate_runs(entry.runs, accuracy) == MeanStd(pytest.approx(100 * row["accuracy"]), None, 1)
        assert aggregate_runs(entry.runs, mean_reward) == MeanStd(pytest.approx(row["mean_reward"]), None, 1)
        invalid = aggregate_runs(entry.runs, ROLLOUT_STATISTICS["with an invalid action (%)"])
        assert invalid is not None
        assert invalid.mean == pytest.approx(100 * row["outcomes"]["invalid_action"])
