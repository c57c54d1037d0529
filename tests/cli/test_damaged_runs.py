"""Damaged run directories: one clear line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.cli import USAGE_ERROR, main

DAMAGES = {
    "deep": "[" * 100_000,
    "a list": "[]",
    "a text": '"run"',
    "nothing": "",
    "an empty object": "{}",
    "other types": '{"format": "lilgym_mp-run", "version": 1, "environment": 5, "recipe": [], "statement_length": 7}',
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("words", [["evaluate"], ["train", "--resume", "--out"]])
def test_damaged_description__is_told_in_one_line(
    damage: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.json").write_text(DAMAGES[damage], encoding="utf-8")
    assert main([*words, str(tmp_path)]) == USAGE_ERROR
    said = capsys.readouterr().err
    assert str(tmp_path) in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("length", [1_000_000_000, 0, -1, 1.5, "7", None, True])
def test_statement_length__that_no_statement_has_is_refused(length: Any) -> None:
    run_directory = pytest.importorskip("lilgym_mp.learning.run_directory")
    with pytest.raises(ValueError, match="statement_length must be a whole number of 1 to 10000 words"):
        run_directory._checked_length(length)


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        ("network", None, "network must be a dictionary, not None"),
        ("network", {"layer": [1.0]}, "layer of the network must be numbers"),
        ("network", {"layer": float("nan")}, "layer of the network must be numbers, all of them finite"),
        ("optimiser", {}, "the optimiser must have a state and param_groups"),
        ("seconds", "long", "seconds must be a number that is not negative, not 'long'"),
        ("steps", -1, "steps must be a number that is not negative, not -1"),
    ],
)
def test_damaged_checkpoint__is_refused_by_name(part: str, value: Any, message: str, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    run_directory = pytest.importorskip("lilgym_mp.learning.run_directory")
    if isinstance(value, dict) and isinstance(value.get("layer"), float):
        value = {"layer": torch.tensor(value["layer"])}
    good = {"network": {}, "optimiser": {"state": {}, "param_groups": []}}
    counts = {"steps": 0, "updates": 0, "episodes": 0, "seconds": 0.0}
    directory = run_directory.RunDirectory(tmp_path)
    torch.save({**good, **counts}, directory.checkpoint_file)
    directory.load()
    torch.save({**good, **counts, part: value}, directory.checkpoint_file)
    with pytest.raises(run_directory.RunError, match=f"{directory.checkpoint_file}: damaged.*{message}"):
        directory.load()
