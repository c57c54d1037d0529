"""A subset of the builtin corpus with all kinds of statements, quick to load."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

from lilgym_mp.corpus import write_corpus

BUILTIN = Path(__file__).parent.parent / "data" / "builtin.jsonl.gz"


def write_thin_corpus(path: Path, step: int) -> Path:
    """Writes every `step`-th statement of the builtin corpus and returns the path."""
    _, *lines = gzip.decompress(BUILTIN.read_bytes()).splitlines()
    write_corpus(path, "thin", "MIT", map(json.loads, lines[::step]))
    return path
