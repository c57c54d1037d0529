"""Reading files: one clear error each."""

import pytest

from lilgym_mp.corpus import CorpusError
from lilgym_mp.corpus.records import read_bytes, read_text


@pytest.mark.parametrize("name", ["a" * 5_000, "a\0b"])
def test_read__invalid_file_names_are_errors(name, tmp_path):
    with pytest.raises(CorpusError, match="cannot be read"):
        read_bytes(tmp_path / name)


def test_read__a_byte_order_mark_is_skipped(tmp_path):
    path = tmp_path / "marked.json"
    path.write_bytes(b"\xef\xbb\xbf{}")
    assert read_text(path)[0] == "{}"


def test_errors__escape_control_characters(tmp_path):
    path = tmp_path / "red\x1b[31m.jsonl"
    with pytest.raises(CorpusError) as fault:
        read_text(path)
    assert r"red\x1b[31m.jsonl" in str(fault.value)
    assert str(fault.value).isprintable()
