"""Atomic writing of files, and checks of output paths."""

import os
from functools import partial
from pathlib import Path

import pytest

from lilgym_mp.evaluation.files import OutputError, fresh_file, writable_directory, write_atomically


def test_write_atomically__failure_keeps_the_old_file(tmp_path):
    target = tmp_path / "result"
    target.write_text("old")

    def fail(temporary):
        temporary.write_text("half")
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        write_atomically(target, fail)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_writable_directory__error_names_the_path(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"cannot write results to .*file/results: Not a directory"):
        writable_directory(tmp_path / "file" / "results")


def test_fresh_file__rejects_what_is_not_a_file(tmp_path):
    (tmp_path / "link").symlink_to("/dev/null")
    for path in (tmp_path, tmp_path / "link", Path("/dev/null")):
        with pytest.raises(OutputError, match="it is not a regular file; name a file"):
            fresh_file(path, force=True)


def test_fresh_file__rejects_names_that_are_not_utf8(tmp_path):
    for check in (partial(fresh_file, force=True), writable_directory):
        with pytest.raises(OutputError, match="the name is not UTF-8"):
            check(tmp_path / os.fsdecode(b"\xff.json"))
    assert not list(tmp_path.iterdir())


def test_write__follows_a_link_to_a_name_as_long_as_the_file_system_allows_and_keeps_the_mode(tmp_path):
    target, link = tmp_path / "elsewhere" / f"{'x' * 250}.json", tmp_path / "link"  # a name of the greatest length
    link.symlink_to(target)
    assert fresh_file(link, force=False) == target
    write_atomically(link, lambda temporary: temporary.write_text("first"))
    target.chmod(0o640)
    write_atomically(link, lambda temporary: temporary.write_text("second"))
    assert link.is_symlink()
    assert (target.read_text(), target.stat().st_mode & 0o777) == ("second", 0o640)
