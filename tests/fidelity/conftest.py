"""The recorded episodes, read once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.fidelity.recorded import Recording, episodes, recording_of


@pytest.fixture(scope="session")
def recorded_episodes(golden: Path) -> dict[Recording, list[dict[str, Any]]]:
    """Every recorded episode, by what was recorded."""
    found: dict[Recording, list[dict[str, Any]]] = {}
    for episode in episodes(golden):
        found.setdefault(recording_of(episode), []).append(episode)
    return found
