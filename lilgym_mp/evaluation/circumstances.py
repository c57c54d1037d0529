"""When, where, by which command and with which code episodes were recorded: a small file beside each recording.

It is apart from the recording so that equal evaluations give equal recordings.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Self

from lilgym_mp.evaluation.episodes import SUFFIX, EpisodesError
from lilgym_mp.evaluation.files import write_json
from lilgym_mp.evaluation.report import software

CIRCUMSTANCES_SUFFIX = ".made.json"
LARGEST = 1 << 20  # bytes
CHANGED = " with changes"  # after a commit's name, where files differ from it
_WRITTEN_BEFORE = ", changed"  # the same, in older files


@dataclass(frozen=True)
class Circumstances:
    """Of one recording."""

    date: str  # UTC, as 2026-01-31 23:59
    command: str
    commit: str | None  # of the checkout that the package lies in; None of an installed package
    machine: str
    software: dict[str, str]  # versions

    @classmethod
    def now(cls, words: Sequence[str]) -> Self:
        """Of this moment and process; `words`: of the command line, without the program's name."""
        date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
        return cls(date, " ".join(["lilgym-mp", *words]), commit(), machine(), software())

    def write(self, recording: Path) -> None:
        write_json(_file(recording), asdict(self))

    @classmethod
    def read(cls, recording: Path) -> Self | None:
        """Those of the recording, None where they were not kept. Raises EpisodesError for a damaged file."""
        file = _file(recording)
        try:
            if file.stat().st_size > LARGEST:
                raise EpisodesError(f"{file}: larger than {LARGEST} bytes")
            made = cls(**json.loads(file.read_text(encoding="utf-8")))
            return replace(made, commit=made.commit and made.commit.replace(_WRITTEN_BEFORE, CHANGED))
        except FileNotFoundError:
            return None
        except EpisodesError:
            raise
        except (OSError, ValueError, TypeError, AttributeError) as error:
            raise EpisodesError(f"{file}: damaged, or not of a recording: {error}") from None


def _file(recording: Path) -> Path:
    return recording.with_name(recording.name.removesuffix(SUFFIX) + CIRCUMSTANCES_SUFFIX)


@cache
def commit() -> str | None:
    """The checkout's commit, marked where files differ from it; None where the package is in no checkout."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    try:
        name = _git(root, "rev-parse", "--short=10", "HEAD")
        return name + CHANGED if _git(root, "status", "--porcelain", "--untracked-files=no") else name
    except (OSError, subprocess.SubprocessError):
        return None


def _git(root: Path, *words: str) -> str:
    return subprocess.run(
        ["git", "-C", str(root), *words], capture_output=True, text=True, check=True, timeout=20
    ).stdout.strip()


@cache
def machine() -> str:
    """The processor and how many of its cores this process may use."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    name = names[0] if names else platform.processor() or platform.machine()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return f"{name}, {cores} cores"
