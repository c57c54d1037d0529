"""`lilgym-mp data ...` as a person meets it: what is printed, what is written, what is refused and how."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from lilgym_mp.cli import main
from lilgym_mp.corpus import load_tasks, write_corpus
from lilgym_mp.corpus.official.fetching import RetryPolicy
from tests.small_corpus import register_as_official, small_entries, write_released
from tests.web import Misdeed, web_server

Run = Callable[..., str]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the official corpus goes: a user's cache of this test's own."""
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "lilgym_mp" / "lilgym"


@pytest.fixture
def released(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory whose two files count as the release."""
    directory = write_released(tmp_path / "released")
    register_as_official(directory, monkeypatch)
    return directory


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A corpus file of our own."""
    write_corpus(tmp_path / "own.jsonl", "own", "MIT", small_entries())
    return tmp_path / "own.jsonl"


@pytest.fixture
def data(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `lilgym-mp data ...`, which must succeed; gives what it prints."""

    def run(*words: object, exit_code: int = 0) -> str:
        assert main(["data", *map(str, words)]) == exit_code
        return capsys.readouterr().out

    return run


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `lilgym-mp data ...`, which must refuse in one line; gives that line."""

    def run(*words: object) -> str:
        assert main(["data", *map(str, words)]) == 2
        said = capsys.readouterr().err
        assert said.startswith("lilgym-mp data: ")
        assert said.count("\n") == 1
        return said

    return run


@pytest.fixture
def tower_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """The release has Tower only."""
    names = ["tower_scratch_test.json", "tower_flipit_test.json"]
    monkeypatch.setattr("lilgym_mp.corpus.official.release.official_names", lambda splits: names)


@pytest.mark.usefixtures("tower_only")
def test_import__makes_the_official_corpus_load(data: Run, released: Path, cache: Path):
    said = data("import", released, "--splits", "test")
    assert f"installed in {cache} from {released}" in said
    assert "content digest" in said
    assert load_tasks("lilgym", "tower", "scratch", "test").ids == ("7",)
    assert "lilgym   TowerFlipIt" in data("list")


@pytest.mark.usefixtures("tower_only")
def test_import__tells_when_the_variable_names_another_directory(
    data: Run, released: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("LILGYM_DATA", str(released))
    assert f'note: LILGYM_DATA is set, so the corpus "lilgym" is read from {released}' in data("import", released)


@pytest.mark.usefixtures("cache")
def test_import__a_partial_directory_is_refused_naming_what_is_missing(refused: Run, released: Path, cache: Path):
    said = refused("import", released)
    assert "lacks scatter_flipit_dev.json, scatter_flipit_test.json" in said
    assert "it has tower_flipit_test.json, tower_scratch_test.json" in said
    assert not cache.exists()


@pytest.mark.usefixtures("tower_only")
def test_download__installs_once(data: Run, released: Path, cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with web_server() as web:
        web.files.update({f"/{path.name}": path.read_bytes() for path in released.iterdir()})
        assert f"installed in {cache} from {web.url}" in data("download", "--url", web.url)
        asked = len(web.asked)
        assert f"already installed from {web.url}" in data("download", "--url", web.url)
        assert len(web.asked) == asked
        assert "installed in" in data("download", "--url", web.url, "--force")
        assert f"from {web.url}/" in data("download", "--url", f"{web.url}/", "--splits", "test", "test")
    assert "no faults" in data("check", "lilgym")


@pytest.mark.usefixtures("tower_only")
def test_download__without_a_server_tells_what_to_do(
    refused: Run, cache: Path, released: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setattr(
        "lilgym_mp.corpus.official.download.RetryPolicy", lambda: RetryPolicy(pause=lambda seconds: None)
    )
    with web_server() as web:
        web.misdeeds["/tower_scratch_test.json"] = [Misdeed(resets=True)] * 5
        said = refused("download", "--url", web.url)
    assert "invalid response" in said
    assert "run the same command again to resume" in said
    assert "lilgym-mp data import DIRECTORY" in said
    assert not cache.exists()


@pytest.mark.usefixtures("cache")
def test_download__a_url_that_is_none_is_refused(refused: Run):
    assert "a URL must start with http:// or https://" in refused("download", "--url", "ftp://somewhere")


@pytest.mark.usefixtures("cache")
def test_list__an_absent_official_corpus_is_said_to_be(data: Run, capsys: pytest.CaptureFixture[str]):
    main(["data", "list"])
    said = capsys.readouterr()
    assert "lilgym   not installed" in said.out
    assert "lilgym-mp data download" in said.err


def test_list__counts_tasks_and_contexts(data: Run, own: Path):
    lines = data("list", own).splitlines()
    assert [line.split()[1:] for line in lines[2:]] == [
        ["TowerScratch", "train", "2", "2"],
        ["TowerFlipIt", "train", "3", "3"],
        ["ScatterScratch", "dev", "1", "1"],
        ["ScatterFlipIt", "dev", "1", "1"],
    ]


def test_stats__prints_tables_and_writes_charts_and_counts(data: Run, own: Path, tmp_path: Path):
    said = data("stats", own, "--charts", tmp_path / "charts", "--json", tmp_path / "counts.json")
    assert "3 statements with 3 programs" in said
    assert "existence" in said
    assert len(list((tmp_path / "charts").glob("*.svg"))) == 4
    counts = json.loads((tmp_path / "counts.json").read_text())
    assert counts["splits"][0]["phenomena"]["exact cardinality"] == 1
    assert counts["splits"][0]["phenomena"]["syntax: coordination"] == 0
    assert "syntax: prepositional attachment" in said
    assert "Blue is here" not in (tmp_path / "counts.json").read_text()


def test_stats__of_released_files_show_the_paper_s_numbers(data: Run, released: Path, monkeypatch: pytest.MonkeyPatch):
    said = data("stats", released)
    assert "tasks (paper)" in said
    assert "the paper counts 2,661 statements" in said


def test_stats__a_place_that_cannot_be_written_is_refused(refused: Run, own: Path, tmp_path: Path):
    assert "cannot be written" in refused("stats", own, "--json", tmp_path / "nowhere" / "counts.json")
    assert "cannot be written" in refused("stats", own, "--charts", own)


def test_check__a_faulty_corpus_gives_another_exit_code(data: Run, own: Path, tmp_path: Path):
    assert "no faults" in data("check", own)
    entries = small_entries()
    entries[0]["starts"][0]["label"] = False
    write_corpus(tmp_path / "faulty.jsonl", "own", "MIT", entries)
    assert "label is false but the program is true" in data("check", tmp_path / "faulty.jsonl", exit_code=1)


def test_show__tells_all_of_a_task(data: Run, own: Path, tmp_path: Path):
    said = data("show", "blue-no", "--corpus", own, "--image", tmp_path / "blue.png")
    for line in (
        "statement  Blue is here.",
        "program    exist(filter_color(all_items, Color.BLUE))",
        "target     true: make the statement true",
        "truth      false of this scene",
        "phenomena  existence",
        "form       COLOUR is here",
    ):
        assert line in said
    assert "kkkk" in said
    with Image.open(tmp_path / "blue.png") as image:
        assert image.size == (784, 304)


def test_show__an_id_that_is_none_is_refused_with_ids_like_it(refused: Run, own: Path):
    assert "no task 'blu-no' in corpus" in refused("show", "blu-no", "--corpus", own)
    assert "tasks include blue-no" in refused("show", "blu-no", "--corpus", own)


def test_show__an_id_in_several_sets_needs_a_choice(data: Run, refused: Run, released: Path):
    (released / "tower_scratch_dev.json").write_bytes((released / "tower_scratch_test.json").read_bytes())
    assert "several tasks have the id '7': " in refused("show", "7", "--corpus", released)
    assert "split 'dev'" in data("show", "7", "--corpus", released, "--split", "dev")


def test_synthesize__writes_a_corpus_of_near_misses(data: Run, own: Path, tmp_path: Path):
    path = tmp_path / "new.jsonl.gz"
    said = data("synthesize", own, "--output", path, "--starts", 2, "--seed", 5)
    assert "3 statements, 6 start scenes, 3 true and 3 false" in said
    assert "no faults" in data("check", path)
    assert load_tasks(path, "scatter", "flipit", "dev").ids == ("round:1", "round:2")


def test_synthesize__a_truth_value_that_is_never_met_is_told(data: Run, tmp_path: Path):
    entries = [{**small_entries()[0], "id": "many", "program": "count(all_items) > 900", "starts": []}]
    write_corpus(tmp_path / "own.jsonl", "own", "MIT", entries)
    said = data("synthesize", tmp_path / "own.jsonl", "--output", tmp_path / "new.jsonl")
    assert "note: only false start scenes found for 'many': Blue is here." in said


def test_permute__boxes_come_in_every_order(data: Run, own: Path, tmp_path: Path):
    said = data("permute", own, "--output", tmp_path / "new.jsonl")
    assert "3 statements, 4 start scenes permuted into 12" in said
    assert "no faults" in data("check", tmp_path / "new.jsonl")
    assert load_tasks(tmp_path / "new.jsonl", "scatter", "flipit", "dev").ids[0] == "round-yes"


@pytest.mark.parametrize("command", ["synthesize", "permute"])
def test_output__a_file_is_replaced_only_by_force(command: str, data: Run, refused: Run, own: Path, tmp_path: Path):
    path = tmp_path / "new.jsonl"
    path.write_text("precious")
    assert "new.jsonl exists; --force overwrites it" in refused(command, own, "--output", path)
    assert path.read_text() == "precious"
    data(command, own, "--output", path, "--force")
    assert path.read_text() != "precious"
    assert "cannot be written" in refused(command, own, "--output", tmp_path / "nowhere" / "new.jsonl")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["new.jsonl", "own.jsonl"]


def test_synthesize__no_starts_are_refused(refused: Run, own: Path, tmp_path: Path):
    assert "--starts must be at least 1, not 0" in refused("synthesize", own, "--output", tmp_path / "x", "--starts", 0)
