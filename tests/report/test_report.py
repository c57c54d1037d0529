"""Reports: one golden report, statistics with known answers, the files of a report, and errors."""

import json
import re
from dataclasses import replace
from itertools import pairwise

import pytest
from matplotlib.container import BarContainer

from lilgym_mp.contrib.report import ReportError, make_report
from lilgym_mp.contrib.report import items as report_items
from lilgym_mp.contrib.report.aggregation import (
    MeanStd,
    accuracy_where,
    holm,
    mean_std,
    mean_where,
    paired_difference,
)
from lilgym_mp.contrib.report.behaviour import ERROR_KINDS, error_kind, failures, figure_10
from lilgym_mp.contrib.report.charts import BarPanel, Line, Looks, bar_chart, line_chart
from lilgym_mp.contrib.report.items import Chart, Item, Table, format_cell
from lilgym_mp.contrib.report.learning_curves import dev_curves
from lilgym_mp.contrib.report.report_data import load_report_data
from lilgym_mp.contrib.report.results import paired_tests, summary, table_2
from lilgym_mp.contrib.report.writing import chapters
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.files import OutputError
from tests.command_line import error_of, succeeds
from tests.json_files import read_json
from tests.report.recordings import (
    EPISODES,
    GOLDEN,
    SCATTER,
    episode,
    report_text,
    trained,
    write_example,
    written,
)


def test_report__has_the_recorded_numbers_and_charts(example):
    assert report_text(example) == GOLDEN.read_text(), "python -m tests.report.recordings"


def test_error_kind__without_the_experts_solution_is_a_later_stop():
    assert error_kind(replace(EPISODES[3], actions_left=None)) == "later stop"
    assert error_kind(episode("horizon", *["REMOVE(0, 0)"] * 12)) == "horizon"


def test_figure_10__counts_the_edits_of_each_cell_by_kind(tmp_path):
    written(tmp_path)
    (chart,) = figure_10(load_report_data([tmp_path]))
    maps = {axes.get_title(loc="left"): axes.images[0].get_array() for axes in chart.figure.axes if axes.images}
    assert list(maps) == ["mine, ScatterFlipIt, 1 ADD", "mine, ScatterFlipIt, 5 REMOVE"]
    added, removed = maps.values()
    assert added[4, 0] == added.sum() == 100
    assert (removed[0, 0], removed[4, 18], removed.sum()) == (80, 20, 100)
    chart.figure.draw_without_rendering()
    assert chart.figure.get_tightbbox().ymax * chart.figure.dpi < chart.figure.bbox.height  # no title is cut


def test_figure_10__without_edits_of_cells_says_so(tmp_path):
    written(tmp_path, settings=Settings("TowerFlipIt"), episodes=[episode("wrong_stop", "STOP")])
    (item,) = figure_10(load_report_data([tmp_path]))
    assert item.note == "no recorded edit names a cell of a grid"


def test_mean_std__reproduces_the_papers_deviation_for_one_success_in_3_x_591():
    assert str(mean_std([100 / 591, 0, 0])) == "0.06 ± 0.10"


def accuracies(*by_statement):
    """Episodes of statements "0", "1", ...: successes (1) and failures (0) of each."""
    return tuple(
        episode("success" if outcome else "wrong_stop", "STOP", statement=str(index), task=f"{index}-{number}")
        for index, outcomes in enumerate(by_statement)
        for number, outcome in enumerate(outcomes)
    )


def recordings(directory, *of_runs):
    for seed, kept in enumerate(of_runs):
        written(directory, kept, training_seed=seed)
    return load_report_data([directory]).entries[0].runs


def interval(of):
    found = accuracy_where(of)
    return found.low, found.high


def test_interval__carries_the_spread_between_statements_and_between_runs(tmp_path):
    alike = interval(recordings(tmp_path / "alike", accuracies(*[[1], [0]] * 50)))
    assert alike == pytest.approx((40, 60), abs=1.5)  # 50 +- 1.96 * 50 / sqrt(100)
    all_or_nothing = recordings(tmp_path / "unlike", accuracies(*[[1]] * 100), accuracies(*[[0]] * 100))
    assert interval(all_or_nothing) == (0, 100)
    assert interval(recordings(tmp_path / "one", accuracies([1, 0] * 50))) == (50, 50)
    assert accuracy_where(all_or_nothing, lambda episode: episode.target) is None


def test_paired_difference__resamples_the_statements_of_both_agents_together(tmp_path):
    def successes(count, of):
        outcomes = [[1]] * count + [[0]] * (of - count)
        return recordings(tmp_path / f"{count} of {of}", accuracies(*outcomes))

    first, better = successes(60, 100), successes(70, 100)
    difference = paired_difference(better, first)
    assert difference[:3] == pytest.approx((10, 4.5, 16), abs=1.5)
    assert difference.p_value == pytest.approx(0.001, abs=0.001)  # z = 10 / 3
    assert paired_difference(first, first) == (0, 0, 0, 1)
    assert paired_difference(successes(5, 5), successes(0, 5)) == (100, 100, 100, 2**-4)


def test_holm__corrects_p_values_for_their_number():
    assert holm([0.01, 0.04, 0.03, 0.6]) == pytest.approx([0.04, 0.09, 0.09, 0.6])
    assert holm([]) == []


def test_paired_tests__p_is_corrected_for_the_tests_of_the_table(tmp_path):
    for agent, successes in (("first", 60), ("second", 60), ("third", 70)):
        written(tmp_path, accuracies(*[[1]] * successes, *[[0]] * (100 - successes)), agent=agent)
    data = load_report_data([tmp_path])
    (table,) = paired_tests(data)
    first, _, third = data.entries
    three_times = f"{3 * paired_difference(first.runs, third.runs).p_value:.4f}"
    assert [row[-1] for row in table.rows] == ["1.0000", three_times, three_times]
    assert "corrected for the 3 tests" in table.note


def test_chapters__missing_items_say_why(tmp_path):
    written(tmp_path, [episode("horizon", *["REMOVE(0, 0)"] * 12, optimal_actions=None)], expert=False)
    items = [item for items in chapters(load_report_data([tmp_path])).values() for item in items]
    missing = {item.item: item.note for item in items if type(item) is Item}
    assert {"Figure 4", "Calibration of STOP"} <= missing.keys()
    assert "--optimal" in missing["Edits needed"]


def contents(directory):
    return {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The directory of the example; read-only."""
    place = tmp_path_factory.mktemp("example")
    write_example(place)
    return place


def test_summary__is_three_sentences_on_the_best_trained_agent(example):
    first, second, third = summary(load_report_data([example]))
    assert re.fullmatch(r"\S.* solves .* on dev\.", first)
    assert second.startswith(("The second of", "No other"))
    assert third == "Of the episodes that sampler fails, 100 % end with a wrong STOP."


def test_failures__link_to_play_and_watch(example):
    links = dict(next(failures(load_report_data([example]))).links)
    assert any(text.startswith("Play") and "/play?configuration=" in link for text, link in links.items())
    assert any(text.startswith("Watch") and "/watch?text=" in link for text, link in links.items())


@pytest.mark.long
def test_report__is_reproducible_and_writes_every_item_as_files(tmp_path):
    kept, out = tmp_path / "kept", tmp_path / "one"
    written(kept)
    page = make_report([kept], out).read_text()
    before = contents(tmp_path)
    (out / "figures" / "old.svg").touch()
    make_report([kept], out)  # replaces the existing report
    assert contents(tmp_path) == before
    for address in ("http://www.w3.org", "http://127.0.0.1:8000"):  # of SVG; links to the browser interface
        page = page.replace(address, "")
    assert "http" not in page  # no external resources
    suffixes = {Table: ("tables", "csv", "tex"), Chart: ("figures", "pdf"), Item: ("",)}
    for items in chapters(load_report_data([kept])).values():
        for item in items:
            assert f'id="{item.name}"' in page
            folder, *kinds = suffixes[type(item)]
            assert all(before[out / folder / f"{item.name}.{kind}"] for kind in kinds)


@pytest.mark.usefixtures("undrawn")
def test_report__escapes_statements_and_shows_no_markup(tmp_path):
    written(tmp_path / "kept", [replace(EPISODES[0], statement="<script>$x_1$")], agent="<b>mine<b>")
    page = make_report([tmp_path / "kept"], tmp_path / "out").read_text()
    assert "<b>mine" not in page
    assert "&lt;b&gt;mine" in page
    assert "<code>lilgym-mp train ppo" in page
    assert "`" not in page
    assert "Comparison of agents" not in page  # there is one


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"settings": replace(SCATTER, corpus="lilgym")}, "corpus is 'lilgym', but 'builtin' in"),
        ({"tasks_sha256": "0" * 64}, "tasks_sha256 is 000000000000"),
        ({"run": "runs/b"}, "training_seed 0 is that of"),
        ({"training_seed": None}, "training_seed is missing"),
    ],
)
def test_report__incomparable_recordings_are_refused_naming_file_and_key(tmp_path, change, said):
    written(tmp_path / "kept" / "a")
    other = written(tmp_path / "kept" / "b", **change)
    with pytest.raises(ReportError, match=said) as fault:
        make_report([tmp_path / "kept"], tmp_path / "out")
    assert str(other.parent) in str(fault.value) or "training_seed" in said
    assert not (tmp_path / "out").exists()


def cut(path):
    path.write_bytes(path.read_bytes()[:-9])


@pytest.mark.parametrize(
    ("prepare", "said"),
    [
        (lambda place: place.mkdir(), "no recorded episodes (*.episodes.jsonl.gz) in "),
        (lambda place: None, "kept: there is no such file"),
        (lambda place: cut(written(place)), "truncated"),
        (lambda place: place.write_text("hello"), "damaged, or not a file of recorded episodes"),
    ],
)
def test_report_command__bad_input_is_reported_in_one_line_and_nothing_is_written(tmp_path, capsys, prepare, said):
    prepare(tmp_path / "kept")
    assert said in error_of(capsys, f"report {tmp_path / 'kept'} --out", tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir() if path.name != "kept"] == []


def test_report__a_directory_with_other_files_is_not_touched_and_a_file_refused(tmp_path):
    written(tmp_path / "kept")
    with pytest.raises(OutputError, match=r"out\.html: .* name a directory"):
        make_report([tmp_path / "kept"], tmp_path / "out.html")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.md").write_text("x")
    with pytest.raises(OutputError, match=r"holds something other than a report, notes\.md"):
        make_report([tmp_path / "kept"], tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["notes.md"]


def test_figure_4__a_recipe_has_one_name_in_all_panels_that_names_stop_forcing(tmp_path):
    written(tmp_path)
    recipes = [("ScatterScratch", "ours"), ("ScatterScratch", "other"), ("TowerScratch", "ours")]
    for seed, (configuration, model) in enumerate(recipes):
        trained(tmp_path / str(seed), 0, [(0.5, None, None)], configuration, model=model, stop_forcing=seed == 1)
    _, table = dev_curves(load_report_data([tmp_path]))
    assert [row[0] for row in table.rows] == ["PPO, model ours", "PPO, model ours", "PPO+SF, model other"]


def test_line_chart__of_a_single_evaluation_is_a_point_at_a_whole_number_of_steps():
    lines = [Line("a", [0], [50]), Line("b", [0], [60], agent="a")]
    (axes,) = line_chart([("one", "steps", "%", lines)], Looks()).axes
    first, second = axes.lines
    assert first.get_marker() == second.get_marker() == "o"
    assert first.get_color() == second.get_color()
    assert first.get_linestyle() != second.get_linestyle()
    low, high = axes.get_xlim()
    assert [tick for tick in axes.get_xticks() if low <= tick <= high] == [0]


def test_line_chart__names_few_lines_at_their_ends_without_overlap_and_many_in_a_legend():
    near = [Line(name, [0, 1], [0, 50 + index]) for index, name in enumerate("abcde")]
    named = line_chart([("one", "steps", "%", near)], Looks())
    named.draw_without_rendering()
    labels = [text for text in named.axes[0].texts if text.get_text()]
    assert [text.get_text() for text in labels] == list("abcde")
    assert not overlap(labels)
    assert not named.legends
    many = line_chart([("one", "steps", "%", [*near, Line("f", [0, 1], [0, 9])])], Looks())
    assert len(many.legends) == 1
    assert not many.axes[0].texts


def overlap(labels):
    """Whether a label overlaps the next one that is not empty."""
    boxes = [label.get_window_extent() for label in labels if label.get_text()]
    return any(box.overlaps(after) for box, after in pairwise(boxes))


def certain(value):
    return MeanStd(value, None, 1, value, value)


def test_bar_chart__has_error_bars_a_shared_axis_and_labels_that_do_not_collide():
    measured = MeanStd(50.0, None, 1, 40.0, 65.0)
    names = [kind.replace(" ", "\n") for kind in ERROR_KINDS]
    values = {f"agent {index}": [measured, None, *[certain(20)] * 7] for index in range(5)}
    panels = [BarPanel("one", names, values), BarPanel("other", names[:2], {"agent 0": [certain(70), certain(2)]})]
    figure = bar_chart(panels, "%", Looks())
    one, other = figure.axes
    assert one.get_ylim() == other.get_ylim()
    assert one.get_ylabel() == other.get_ylabel() == "%"
    assert other.get_ylim()[1] > 70
    (lines,) = next(bars.errorbar for bars in one.containers if isinstance(bars, BarContainer)).lines[2]
    assert lines.get_segments()[0][:, 1].tolist() == [40, 65]
    figure.draw_without_rendering()
    assert not any(overlap((*axes.get_xticklabels(), *axes.texts)) for axes in figure.axes)


def test_bar_chart__labels_of_a_panel_have_the_same_decimals():
    panels = [BarPanel("", ["a", "b"], {"x": list(map(certain, values))}) for values in ((0.641, -1.2), (9.5, 12.3))]
    figure = bar_chart(panels, "", Looks())
    assert [[label.get_text() for label in axes.texts] for axes in figure.axes] == [["0.64", "−1.20"], ["10", "12"]]


def test_text__rounds_halves_up_and_keeps_the_decimals_of_the_paper():
    assert MeanStd(84.05, 3.25, 3).text(1) == "84.1 ± 3.3"
    assert MeanStd(84.05, None, 1, printed_places=2).text(1) == "84.05"


def test_table__columns_without_own_values_are_dropped_and_decimals_fit():
    cells = [("own", 200 / 3, None, MeanStd(2 / 3, None, 3)), ("paper †", -1.0, 2.0, None)]
    made = report_items.table("Table", "Shares", ("a", "b (%)", "c", "d"), cells)
    assert made.columns == ("a", "b (%)", "d")
    assert made.texts() == [["own", "66.7", "0.67"], ["paper †", "−1.0", "–"]]
    for line in (r"\begin{tabular}{lrr}", r"a & b (\%) & d \\", r"paper $^\dagger$ & $-$1.0 & -- \\"):
        assert line in made.latex()
    few = MeanStd(200 / 3, 1.25, 3, 60.04, 70.06, episodes=99)
    many = few._replace(episodes=100)
    assert format_cell(many, places=1) == "66.7 ± 1.3 [60.0, 70.1]"
    mixed = report_items.table("Table", "Shares", ("a", "b (%)"), [("few", few), ("many", many)])
    assert [row[1] for row in mixed.texts()] == ["67 ± 1 [60, 70]"] * 2  # a column has one number of decimals


def test_report__damaged_evaluations_are_named(tmp_path):
    written(tmp_path)
    trained(tmp_path / "a", 0, [(0.5, None, None)])
    (tmp_path / "a" / "evaluations.jsonl").write_text('{"steps"')
    with pytest.raises(ReportError, match="damaged, or not a training run"):
        load_report_data([tmp_path])


def test_labels__distinguish_runs_that_differ_in_more_than_the_seed(tmp_path):
    for seed, width in enumerate((64, 128, 128)):
        written(tmp_path, recipe={"width": width, "seed": seed}, training_seed=seed)
    entries = load_report_data([tmp_path]).entries
    assert {entry.agent: len(entry.runs) for entry in entries} == {"mine (width 64)": 1, "mine (width 128)": 2}
    written(tmp_path, recipe={"width": 128, "seed": 3}, training_seed=3, supervision="programs")
    assert "mine (width 128, programs)" in load_report_data([tmp_path]).agents


@pytest.mark.usefixtures("undrawn")
@pytest.mark.long
def test_report__configurations_may_be_played_on_different_splits(tmp_path):
    written(tmp_path / "kept")
    written(tmp_path / "kept", settings=replace(SCATTER, configuration="ScatterScratch"), split="test")
    assert make_report([tmp_path / "kept"], tmp_path / "report").is_file()


def test_curves__of_a_resumed_run_have_each_number_of_steps_once(tmp_path):
    written(tmp_path)
    trained(tmp_path / "a", 0, [(0.5, None, None), (0.6, None, None)])
    file = tmp_path / "a" / "evaluations.jsonl"
    file.write_text(file.read_text() + file.read_text().replace("0.6", "0.7"))
    (curve,) = load_report_data([tmp_path]).curves
    assert [(each["steps"], each["accuracy"]) for each in curve.evaluations] == [(0, 0.5), (32, 0.7)]


@pytest.mark.long
def test_report__of_random_policies_agrees_with_the_evaluation(tmp_path):
    kept, results = (tmp_path / name for name in ("kept", "results.json"))
    command = "evaluate --policy random-legal random-type --configuration TowerFlipIt"
    succeeds(f"{command} --record {kept} --out", results)
    found = load_report_data([kept])
    for row in read_json(results)["results"]:
        runs = found.find(row["agent"], "TowerFlipIt").runs
        assert accuracy_where(runs).mean == pytest.approx(100 * row["accuracy"])
        assert mean_where(runs, lambda episode: episode.reward).mean == pytest.approx(row["mean_reward"])


def written_games(path, *pairs):
    """Results of games as `lilgym-mp evaluate --out` writes them, in part: both agents, success and remark."""
    shared = {"configuration": "ScatterFlipIt", "protocol": "veto", "corpus": "builtin", "split": "dev"}
    results = [
        {
            **shared,
            "actions": "greedy",
            "messages": None,
            "proposer": proposer,
            "verifier": verifier,
            "success": success,
            "success_interval": [success - 0.1, success + 0.1],
            "games": 200,
            "remark": remark,
        }
        for proposer, verifier, success, remark in pairs
    ]
    path.write_text(json.dumps({"results": results}))
    return path


def test_games__are_a_matrix_of_pairs_with_intervals_and_remarks(tmp_path):
    pairs = ("a", "a", 0.5, ""), ("a", "b", 0.3, "trained with other views"), ("expert", "a", 0.7, "")
    file = written_games(tmp_path / "games.json", *pairs)
    ((matrix,),) = chapters(load_report_data([file])).values()
    assert isinstance(matrix, Table)
    assert matrix.columns == ("proposer", "a", "b")
    assert matrix.texts() == [["a", "50.0 [40.0, 60.0]", "30.0 [20.0, 40.0]"], ["expert", "70.0 [60.0, 80.0]", "–"]]
    assert "a with b: trained with other views." in matrix.note
    page = make_report([file], tmp_path / "report").read_text()
    assert "Success (%), ScatterFlipIt, veto, dev, builtin, greedy" in page


def test_games__another_json_file_is_refused_by_name(tmp_path):
    (tmp_path / "other.json").write_text("{}")
    refused = r"other\.json: not results of games, which `lilgym-mp evaluate --out` writes"
    with pytest.raises(ReportError, match=refused):
        load_report_data([tmp_path / "other.json"])


def test_table_2__has_a_row_of_a_runs_two_agents_and_says_so_only_then(example, tmp_path):
    games = written_games(tmp_path / "games.json", ("runs/a", "runs/a", 0.5, ""), ("random", "random", 0.0, ""))
    (made,), (without,) = (table_2(load_report_data(paths)) for paths in ([example, games], [example]))
    assert isinstance(made, Table)
    (shown,) = (cells for cells in made.texts() if cells[0].endswith("‡"))
    assert shown[0] == "runs/a ‡"
    assert "50 [40, 60]" in shown
    assert "‡" in made.note
    assert "‡" not in without.note
