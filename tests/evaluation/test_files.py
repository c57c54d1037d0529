"""Atomic writing of files, and checks of output paths."""

from __future__ import annotations

from pathlib import Path

import pytest

from lilgym_mp.evaluation.files import OutputError, fresh_file, writable_directory, write_atomically


def test_write_atomically__failure_keeps_the_old_file(tmp_path: Path):
    target = tmp_path / "result"
    target.write_text("old")

    def fail(temporary: Path) -> None:
        temporary.write_text("half")
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        write_atomically(target, fail)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_writable_directory__error_names_the_path(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"cannot write results to .*file/results: Not a directory"):
        writable_directory(tmp_path / "file" / "results")


def test_fresh_file__rejects_what_is_not_a_file(tmp_path: Path):
    (tmp_path / "link").symlink_to("/dev/null")
    for path in (tmp_path, tmp_path / "link", Path("/dev/null")):
        with pytest.raises(OutputError, match="it is not a regular file; name a file"):
            fresh_file(path, force=True)
