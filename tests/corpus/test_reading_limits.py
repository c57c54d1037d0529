"""Irregular or too large files: one clear error, little memory, no blocking."""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lilgym_mp.corpus import CorpusError, load_tasks
from lilgym_mp.corpus.records import read_bytes, read_text

READ = """
import resource, sys
from pathlib import Path
from lilgym_mp.corpus import CorpusError
from lilgym_mp.corpus.records import read_text
resource.setrlimit(resource.RLIMIT_AS, (2_000_000_000, 2_000_000_000))
resource.setrlimit(resource.RLIMIT_CPU, (30, 30))
try:
    read_text(Path(sys.argv[1]))
except CorpusError as fault:
    print(fault)
"""


def read_in_child(path: Path) -> str:
    """The output of reading the file in a process with limited memory and time."""
    done = subprocess.run([sys.executable, "-c", READ, path], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-500:]
    return done.stdout


def test_read__a_decompression_bomb_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "bomb.jsonl.gz"
    megabyte = gzip.compress(bytes(1_000_000))
    path.write_bytes(megabyte * 3_000)  # three gigabytes, in three megabytes
    assert "a corpus file may have at most 268435456 bytes when unpacked" in read_in_child(path)


def test_read__a_device_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "zero.jsonl"
    path.symlink_to("/dev/zero")
    assert f"{path}: cannot be read: not a regular file" in read_in_child(path)


def test_read__a_large_file_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "sparse.jsonl"
    with path.open("wb") as file:
        file.truncate(10**11)
    assert "a corpus file may have at most 268435456 bytes" in read_in_child(path)


def test_read__a_pipe_does_not_block(tmp_path: Path) -> None:
    path = tmp_path / "pipe.jsonl"
    os.mkfifo(path)
    with pytest.raises(CorpusError, match="not a regular file"):
        read_text(path)
    with pytest.raises(CorpusError, match="not a regular file"):
        load_tasks(path, "tower", "scratch", "train")


@pytest.mark.parametrize("name", ["a" * 5_000, "a\0b"])
def test_read__invalid_file_names_are_errors(name: str, tmp_path: Path) -> None:
    with pytest.raises(CorpusError, match="cannot be read"):
        read_bytes(tmp_path / name)


def test_read__a_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "marked.json"
    path.write_bytes(b"\xef\xbb\xbf{}")
    assert read_text(path)[0] == "{}"


def test_errors__escape_control_characters(tmp_path: Path) -> None:
    path = tmp_path / "red\x1b[31m.jsonl"
    with pytest.raises(CorpusError) as fault:
        read_text(path)
    assert r"red\x1b[31m.jsonl" in str(fault.value)
    assert str(fault.value).isprintable()
