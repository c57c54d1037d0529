"""Training excludes the same held-out statements whichever files are installed."""

from lilgym_mp.corpus import load_all_tasks, write_corpus
from lilgym_mp.corpus.held_out import corpus_digests, digests_sha256, held_out_digests, statement_digest
from tests.solver.conftest import STATEMENTS, corpus_entries


def test_held_out_digests__do_not_depend_on_installed_files(monkeypatch, tmp_path):
    monkeypatch.delenv("LILGYM_DATA", raising=False)
    without = held_out_digests("builtin"), held_out_digests("lilgym")
    monkeypatch.setenv("LILGYM_DATA", str(tmp_path))
    assert (held_out_digests("builtin"), held_out_digests("lilgym")) == without


def test_held_out_digests__cover_the_builtin_corpus():
    assert corpus_digests("builtin") <= held_out_digests("builtin")


def test_held_out_digests__cover_official_dev(official_data):
    digests = held_out_digests("builtin")
    for tasks in load_all_tasks("lilgym", splits=("dev",)):
        assert all(statement_digest(task.statement) in digests for task in tasks)


def test_held_out_digests__add_those_of_a_corpus_of_ones_own(tmp_path):
    path = tmp_path / "own.jsonl"
    write_corpus(path, "own", "MIT", corpus_entries("dev"))
    added = held_out_digests(str(path)) - held_out_digests("builtin")
    assert added == {statement_digest(statement) for _, statement, _, _ in STATEMENTS}
    assert digests_sha256(held_out_digests(str(path))) != digests_sha256(held_out_digests("builtin"))


def test_statement_digest__ignores_case_and_punctuation():
    assert statement_digest("There is a box.") == statement_digest("there is a box")
    assert statement_digest("There is a box.") != statement_digest("there is no box")
