"""Recordings are checked by playing them again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import Recording, read_episodes, write_episodes
from lilgym_mp.evaluation.files import SUFFIX, EpisodesError
from lilgym_mp.evaluation.recording import check_recording
from lilgym_mp.scene.actions import STOP, RemoveBlock, RemoveItem
from tests.corpora import write_own_corpus
from tests.scripts import load_script

RUNS = Path(__file__).parents[2] / "docs" / "results" / "runs.csv"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    directory = tmp_path_factory.mktemp("kept")
    write_own_corpus(directory / "own.jsonl")
    words = ["evaluate", "--policy", "random-legal", "--configuration", "TowerScratch", "--passes", "2"]
    assert main([*words, "--corpus", str(directory / "own.jsonl"), "--record", str(directory)]) == 0
    return read_episodes(next(directory.glob(f"*{SUFFIX}")))


def test_check__accepts_what_evaluate_records(recording: Recording):
    check_recording(recording)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda it: replace(it, header=replace(it.header, tasks_sha256="0" * 64)),
            "its tasks_sha256 is '0000",
        ),
        (lambda it: replace(it, episodes=it.episodes[1:]), "must be played 2 times"),
        (
            lambda it: replace(it, episodes=(*it.episodes, replace(it.episodes[0], task="x"))),
            "x must be played 0 times",
        ),
        (lambda it: _first(it, rewards=(1.0,) * len(it.episodes[0].actions)), "when played again"),
        (lambda it: _first(it, outcome="success", rewards=(1.0,), actions=(STOP,)), "when played again"),
        (lambda it: _first(it, actions=(STOP, STOP), rewards=(-0.1, -1.0)), "ends after 1 actions"),
        (lambda it: _first(it, target=False), "its target is False, but True when"),
        (lambda it: _first(it, actions=(RemoveItem(0, 0),), rewards=(-1.0,)), "is not an action of tower"),
        (lambda it: _first(it, actions=(RemoveBlock(3),), rewards=(-1.0,)), "is not an action of tower"),
        (lambda it: _first(it, invalid_reason="overlap"), "its invalid_reason is 'overlap', but "),
    ],
)
def test_check__names_what_is_false(recording: Recording, change: Callable[[Recording], Recording], message: str):
    with pytest.raises(EpisodesError, match=message) as error:
        check_recording(change(recording))
    assert str(recording.path) in str(error.value)


def _first(recording: Recording, **changes: object) -> Recording:
    return replace(recording, episodes=(replace(recording.episodes[0], **changes), *recording.episodes[1:]))


def test_report__check_stops_before_the_report(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    false = _first(recording, outcome="success", rewards=(1.0,), actions=(STOP,))
    (tmp_path / "kept").mkdir()
    write_episodes(tmp_path / "kept" / f"false{SUFFIX}", false.header, false.episodes)
    assert main(["report", str(tmp_path / "kept"), "--out", str(tmp_path / "out"), "--check"]) == USAGE_ERROR
    assert "when played again" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_results__random_rows_have_the_published_digest(official_data: Path, tmp_path: Path):
    configurations = [*("--configuration", *CONFIGURATIONS), *("--corpus", "lilgym", "--split", "dev", "--optimal")]
    command = ["evaluate", "--policy", "random-legal", "random-type", "--passes", "5", "--record", str(tmp_path)]
    assert main([*command, *configurations]) == 0
    digest = load_script("digest_recordings").digest(tmp_path)
    row = next(line for line in RUNS.read_text(encoding="utf-8").splitlines() if line.startswith('"8, 9"'))
    assert row.endswith(digest)
