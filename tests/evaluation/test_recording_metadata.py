"""The metadata file next to a recording."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from lilgym_mp.cli import main
from lilgym_mp.evaluation import recording_metadata
from lilgym_mp.evaluation.files import SUFFIX, EpisodesError
from lilgym_mp.evaluation.recording_metadata import RecordingMetadata


def test_recording_metadata__is_next_to_every_recording(tmp_path: Path):
    words = ["evaluate", "--policy", "random-legal", "expert", "--configuration", "TowerScratch", "--record"]
    assert main([*words, str(tmp_path)]) == 0
    recordings = list(tmp_path.glob(f"*{SUFFIX}"))
    assert len(recordings) == 2
    for recording in recordings:
        found = RecordingMetadata.read(recording)
        assert found is not None
        assert found.command == " ".join(["lilgym-mp", *words, str(tmp_path)])
        assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d", found.date)
        assert found.software["numpy"]
        assert found.machine == recording_metadata.machine()


def test_read__is_none_without_a_file_and_names_a_damaged_one(tmp_path: Path):
    recording = tmp_path / f"a{SUFFIX}"
    assert RecordingMetadata.read(recording) is None
    (tmp_path / "a.metadata.json").write_text(json.dumps({"date": "today"}))
    with pytest.raises(EpisodesError, match=r"a\.metadata\.json: not valid metadata of a recording"):
        RecordingMetadata.read(recording)
