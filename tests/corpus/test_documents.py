"""Counts of corpora in the documentation match the output of commands and scripts; data/croissant.json."""

import gzip
import json
import re
import shlex
import shutil
from collections import Counter
from pathlib import Path

import pytest

from lilgym_mp.cli import make_parser
from lilgym_mp.cli.experiment_plan import read_plan
from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.scene.grouping import grouped
from tests.command_line import succeeds
from tests.scripts import ROOT, load_script

DOCS = ROOT / "docs"


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_official_page__matches_the_command_output(capsys):
    succeeds("data stats lilgym")
    printed = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    page = (DOCS / "official_data.md").read_text()
    (block,) = re.findall(r"\$ lilgym-mp data stats lilgym\n(.*?)```", page, re.DOTALL)
    shown = [line.rstrip() for line in block.splitlines() if not line.startswith("corpus lilgym:")]
    assert len(shown) > 10
    assert [line for line in shown if line not in printed] == []


def test_tables_of_results__are_those_of_the_csv_files():
    page = (DOCS / "results.md").read_text()
    assert page.count(".csv: ") == 2
    assert load_script("write_result_tables").text(page) == page, "run scripts/write_result_tables.py"


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_accuracies_and_paired_tests__are_those_of_the_recorded_outcomes():
    script = load_script("write_result_tables")
    assert script.accuracies() == script.read("accuracy")
    assert script.differences() == script.read("paired_tests")
    assert script.by_phenomenon() == script.read("phenomena")


def test_results__accuracies_on_new_statements_are_of_the_table():
    _, *rows = load_script("write_result_tables").read("returns")
    new = grouped((agent, f"{float(numbers[5].split()[0]):.1f}") for agent, _, *numbers in rows)
    page = (DOCS / "results.md").read_text()
    for agent in ("ppo+sf (greedy)", "imitation", "parse-and-plan"):
        *firsts, last = new[agent]
        assert f"{', '.join(firsts)} and {last}" in page, agent


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_added_recording__gives_the_published_numbers(tmp_path, monkeypatch):
    script = load_script("write_result_tables")
    published = {name: script.read(name) for name in ("returns", "behaviour")}
    monkeypatch.setattr(script, "RESULTS", Path(shutil.copytree(script.RESULTS, tmp_path / "results")))
    command = "evaluate --policy expert --configuration TowerFlipIt --corpus lilgym --optimal --record"
    succeeds(command, tmp_path / "recordings")
    for name, rows in published.items():
        script.write(name, [row for row in rows if row[:2] != ["expert", "TowerFlipIt"]])
    script.add("10", [*(tmp_path / "recordings").glob("*.gz")])
    for name, rows in published.items():
        assert sorted(script.read(name)) == sorted(rows)


@pytest.mark.usefixtures("official_data")
@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("training.md", "paper_cells"),
        ("training.md", "ppo_cells"),
        ("agents.md", "default_cells"),
        ("imitation.md", "imitation_cells"),
        ("reward_model.md", "reward_model_cells"),
        ("stable_baselines3.md", "sb3_cells"),
        ("results.md", "separators_cells"),
        ("results.md", "figure_4_cells"),
    ],
)
def test_page__has_the_recorded_accuracy_of_each_run(name, made):
    rest = (DOCS / name).read_text()
    cells = list(getattr(load_script("write_result_tables"), made)())
    assert cells
    for cell in cells:  # in the order of the page
        _, found, rest = rest.partition(f" {cell} ")
        assert found, cell


@pytest.mark.usefixtures("official_data")
@pytest.mark.long
def test_game_experiments__have_the_recorded_success_of_each_pair():
    script = load_script("measure_messages")
    pairs = grouped((row[0], row) for row in script.read("messages")[1:])
    page = (DOCS / "game_experiments.md").read_text()
    assert [pair for pair, rows in pairs.items() if f"| {script.cells(rows)} |" not in page] == []


@pytest.mark.usefixtures("official_data")
def test_game_experiments__have_the_figures_of_the_recorded_games():
    script = load_script("compare_partners")
    page = (DOCS / "game_experiments.md").read_text()
    assert script.saved()
    assert [cell for cell in script.cells(script.saved()) if f" {cell} " not in page] == []


def test_runs_of_an_experiment__replace_the_published_ones(tmp_path, monkeypatch):
    script = load_script("write_result_tables")
    monkeypatch.setattr(script, "RESULTS", Path(shutil.copytree(DOCS / "results", tmp_path / "results")))
    before = script.read("runs")
    (tmp_path / "finished").mkdir()
    progress = {
        "imitation-TowerFlipIt-1": '{"updates": 3600, "states": 1, "cpu_seconds": 90}\n',
        "ppo-TowerFlipIt-2": '{"steps": 200000, "cpu_seconds": 66}\n',
    }
    for name, line in progress.items():
        run = tmp_path / "runs" / name
        run.mkdir(parents=True)
        (tmp_path / "finished" / f"{name}.json").touch()
        (run / "run.json").write_text('{"made": {"commit": "0123456789 with changes", "machine": "M, 2 cores"}}')
        (run / "progress.jsonl").write_text(f'{{"updates": 0}}\n{line}')
    (run / "validations.jsonl").write_text('{"best_steps": 130000}\n')
    recordings = tmp_path / "episodes" / "ppo-TowerFlipIt-2"
    succeeds("evaluate --policy expert --configuration TowerScratch --record", recordings)
    games = tmp_path / "episodes" / "imitation-TowerFlipIt-1-dev.csv"
    games.write_text("proposer,success\na/b,0.5\n")
    (tmp_path / "finished" / "new-0.json").touch()
    assert script.write_runs(tmp_path) == ["new-0"]
    changed = [row for row in script.read("runs") if row not in before]
    for row in changed:
        assert row.pop(2).endswith(f"--only {row[1]}")
    assert changed == [
        ["3", "imitation-TowerFlipIt-1", "0123456 with changes", "M", "1.5", "3,600", "ff78824a61fe"],
        ["13, 14", "ppo-TowerFlipIt-2", "0123456 with changes", "M", "1.1", "0.13 million", script.digest(recordings)],
    ]


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_published_runs__have_commands_that_are_valid():
    _, *rows = load_script("write_result_tables").read("runs")
    plans = {}
    for _, run, command, *_ in rows:
        program, *words = shlex.split(command.partition("; ")[0])
        if "--only" in words:
            _, file, _, name = words
            plans[file] = plans.get(file) or {planned.name for planned in read_plan(ROOT / file)}
            assert run == name
            assert name in plans[file]
        elif program == "lilgym-mp":
            make_parser().parse_args(words)
        else:
            assert (ROOT / words[0]).is_file()


def test_charts_of_results__are_drawn_from_the_csv_files():
    script = load_script("draw_results")
    (axes,) = script.rewards().axes
    assert len(axes.patches) == 4 * len(script.AGENTS)
    curves = script.curves().axes
    assert [len(panel.lines) for panel in curves if panel.lines] == [3, 1, 4]
    assert curves[1].lines[0].get_ydata()[-1] > 50
    assert len([axes for axes in script.cells().axes if axes.images]) == 2 * 3


def test_datasheet__counts_are_those_of_the_file():
    lines = gzip.decompress((ROOT / "data" / "builtin.jsonl.gz").read_bytes()).decode().splitlines()
    entries = [json.loads(line) for line in lines[1:]]
    hand_written = sum("hand-written" in entry["tags"] for entry in entries)
    text = " ".join((DOCS / "datasheet.md").read_text().split())
    assert f"{len(entries):,} English statements" in text
    assert f"| {hand_written} | for this project" in text
    assert f"| {len(entries) - hand_written:,} | by a grammar" in text
    splits = Counter(entry["split"] for entry in entries if entry["appearance"] == "tower")
    assert f"({splits['train']:,} train, {splits['dev']} dev, {splits['test']} test)" in text


def test_croissant__describes_the_corpus_file():
    written = (ROOT / "data" / "croissant.json").read_text()
    assert written == load_script("write_croissant").text(), "run scripts/write_croissant.py"


def test_hub_dataset__has_every_task_as_flat_rows_and_a_card_that_names_its_files():
    hub = load_script("write_hub_dataset")
    rows = hub.rows_by_split()
    assert {split: len(of_split) for split, of_split in rows.items()} == {"train": 12_205, "dev": 1_820, "test": 3_634}
    first = rows["train"][0]
    assert json.loads(first["scene"]) == [[], [], []]
    assert (first["statement"], first["target"]) == ("There should be a yellow block somewhere.", True)
    card = hub.card()
    assert [split for split in rows if f"path: {split}.parquet" not in card] == []
    assert "](corpus.md" not in card


@pytest.mark.long
def test_croissant__is_valid_and_can_be_read(tmp_path):
    mlcroissant = pytest.importorskip("mlcroissant")
    for name in ("croissant.json", "builtin.jsonl.gz"):
        (tmp_path / name).write_bytes((ROOT / "data" / name).read_bytes())
    succeeds("data export builtin --out", tmp_path / "builtin-tasks.jsonl")
    dataset = mlcroissant.Dataset(jsonld=str(tmp_path / "croissant.json"))
    assert not dataset.metadata.ctx.issues.errors
    assert not dataset.metadata.ctx.issues.warnings
    _, *entries = dataset.records("entries")  # the first is the header
    assert len(entries) == 2_900
    assert entries[0]["entries/statement"].startswith(b"There should be")
    rows = list(dataset.records("tasks"))
    assert len(rows) == sum(map(len, load_all_tasks("builtin")))
    assert {row["tasks/start"] for row in rows} == {b"scratch", b"flipit"}
