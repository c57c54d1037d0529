"""Damaged run directories are reported in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from lilgym_mp.cli import USAGE_ERROR, main

DAMAGES = {
    "deep": "[" * 100_000,
    "a list": "[]",
    "a text": '"run"',
    "nothing": "",
    "an empty object": "{}",
    "other types": '{"format": "lilgym_mp-training-run", "version": 1, "identity": {"environment": 5, "recipe": []}}',
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("words", [["evaluate"], ["train", "ppo", "--resume", "--out"]])
def test_damaged_run__is_reported_in_one_line(
    damage: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.json").write_text(DAMAGES[damage], encoding="utf-8")
    assert main([*words, str(tmp_path)]) == USAGE_ERROR
    output = capsys.readouterr().err
    assert str(tmp_path) in output
    assert output.count("\n") == 1
