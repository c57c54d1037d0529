"""`lilgym-mp data ...`: its output, files and errors."""

import json

import pytest

from lilgym_mp.cli import main
from lilgym_mp.corpus import CorpusError, load_tasks, write_corpus
from tests.corpora import register_as_official, small_entries, write_released, write_statements
from tests.json_files import read_json


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The installation directory of the official corpus, in a temporary user cache."""
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "lilgym_mp" / "lilgym"


@pytest.fixture
def released(tmp_path, monkeypatch):
    """A directory with two files registered as the release."""
    directory = write_released(tmp_path / "released")
    register_as_official(directory, monkeypatch)
    return directory


@pytest.fixture
def own(tmp_path):
    """A small corpus file."""
    write_corpus(tmp_path / "own.jsonl", "own", "MIT", small_entries())
    return tmp_path / "own.jsonl"


@pytest.fixture
def data(capsys):
    """Runs `lilgym-mp data ...` and returns its output."""

    def run(*words, exit_code=0):
        assert main(["data", *map(str, words)]) == exit_code
        return capsys.readouterr().out

    return run


@pytest.fixture
def error_of(capsys):
    """Runs `lilgym-mp data ...`, which must fail with one line, and returns that line."""

    def run(*words):
        assert main(["data", *map(str, words)]) == 2
        output = capsys.readouterr().err
        assert output.startswith("lilgym-mp data: ")
        assert output.count("\n") == 1
        return output

    return run


def test_import__installs_the_official_corpus(data, released, cache):
    output = data("import", released)
    assert f"installed in {cache}" in output
    assert "content digest" in output
    assert load_tasks("lilgym", "tower", "scratch", "test").ids == ("7",)


def test_import__names_the_files_that_the_directory_lacks(data, released, cache):
    (released / "tower_flipit_test.json").unlink()
    assert f"note: {released} lacks tower_flipit_test.json" in data("import", released)
    assert [path.name for path in cache.iterdir()] == ["tower_scratch_test.json"]


@pytest.mark.long
def test_download__gets_only_what_is_not_installed(data, error_of, released, cache):
    data("import", released)
    assert f"already installed: {cache}" in data("download", "--url", "ftp://nowhere")
    (cache / "tower_scratch_test.json").unlink()
    output = error_of("download", "--url", "ftp://nowhere")
    assert "nothing was installed" in output
    assert "lilgym-mp data import DIRECTORY" in output


def test_stats__prints_tables(data, own):
    output = data("stats", own)
    assert "3 statements with 3 programs" in output
    rows = [line.split() for line in output.splitlines()]
    assert ["TowerFlipIt", "train", "3", "3", "1"] in rows
    assert ["tower", "train", "2", "2", "7", "3.5", "4", "-", "-", "-"] in rows


def test_check__exit_code_is_1_for_an_invalid_corpus(data, own, tmp_path):
    assert "no faults" in data("check", own)
    entries = small_entries()
    entries[0]["starts"][0]["label"] = False
    write_corpus(tmp_path / "faulty.jsonl", "own", "MIT", entries)
    assert "label is false but the program is true" in data("check", tmp_path / "faulty.jsonl", exit_code=1)


def test_synthesize__writes_a_corpus_of_near_misses(data, own, tmp_path):
    path = tmp_path / "new.jsonl.gz"
    output = data("synthesize", own, "--out", path, "--starts", 2, "--seed", 5)
    assert "3 statements, 6 start scenes, 3 true and 3 false" in output
    assert "no faults" in data("check", path)
    assert load_tasks(path, "scatter", "flipit", "dev").ids == ("round:1", "round:2")


def test_permute__writes_all_permutations_of_boxes(data, own, tmp_path):
    output = data("permute", own, "--out", tmp_path / "new.jsonl")
    assert "3 statements, 4 start scenes permuted into 15" in output
    assert "no faults" in data("check", tmp_path / "new.jsonl")
    assert load_tasks(tmp_path / "new.jsonl", "scatter", "flipit", "dev").ids[0] == "round-yes"


def test_split__names_its_corpus_by_a_path_relative_to_its_own(data, own, tmp_path):
    lists = tmp_path / "sub" / "own.split.json"
    lists.parent.mkdir()
    data("split", own, "--by", "form", "--out", lists)
    assert "no faults" in data("check", lists)
    written = read_json(lists)
    written["statements"]["tower train"] += ["of an earlier version"]
    lists.write_text(json.dumps(written))
    unknown = r"has ids that are not in .*own\.jsonl \(tower train\): of an earlier version"
    with pytest.raises(CorpusError, match=unknown):
        load_tasks(lists, "tower", "scratch", "train")


@pytest.mark.parametrize("command", ["synthesize", "permute"])
def test_output__is_overwritten_only_with_force(command, data, error_of, own, tmp_path):
    path = tmp_path / "new.jsonl"
    path.write_text("precious")
    assert "new.jsonl exists; --force overwrites it" in error_of(command, own, "--out", path)
    assert path.read_text() == "precious"
    data(command, own, "--out", path, "--force")
    assert path.read_text() != "precious"
    assert f"cannot write results to {own}" in error_of(command, own, "--out", own / "new.jsonl")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["new.jsonl", "own.jsonl"]


def test_check_and_synthesize__list_no_empty_sets_and_leave_out_what_is_always_true(data, tmp_path):
    blue = "exist(filter_obj(all_items, lambda x: is_blue(x)))"
    programs = {"blue": blue, "always": f"{blue} or not {blue}", "never": f"{blue} and not {blue}"}
    own = write_statements(tmp_path / "own.jsonl", *(("dev", *each) for each in programs.items()))
    assert " 0 tasks" not in data("check", own)
    output = data("synthesize", own, "--out", tmp_path / "new.jsonl")
    assert "2 statements" in output
    assert "left out, as no scene was found that makes it false: 't1': always" in output
