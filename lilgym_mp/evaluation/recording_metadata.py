"""Date, command, commit, machine and software versions of a recording, in a JSON file next to it.

They are not in the recording itself, so that equal evaluations give equal recordings.
"""

from __future__ import annotations

import json
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Self

from lilgym_mp.envs.machine import usable_cores
from lilgym_mp.evaluation.files import SUFFIX, EpisodesError, checked, write_json

METADATA_SUFFIX = ".metadata.json"
MAX_BYTES = 1 << 20  # bytes
DISTRIBUTIONS = ("lilgym-mp", "numpy", "gymnasium", "pillow", "torch", "stable-baselines3", "sb3-contrib")
MODIFIED_SUFFIX = " with changes"  # marks a commit with uncommitted changes


@dataclass(frozen=True)
class RecordingMetadata:
    """When, by which command, with which code and on which machine a recording was made."""

    date: str  # UTC, as 2026-01-31 23:59
    command: str
    commit: str | None  # commit of the checkout; None for an installed package
    machine: str
    software: dict[str, str]  # versions

    @classmethod
    def now(cls, argv: Sequence[str]) -> Self:
        """Metadata of a recording made now by this process; `argv`: command line without the program's name."""
        date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
        return cls(date, " ".join(["lilgym-mp", *argv]), commit(), machine(), software())

    def write(self, recording: Path) -> None:
        write_json(_file(recording), asdict(self))

    @classmethod
    def read(cls, recording: Path) -> Self | None:
        """The recording's metadata, None if there is no such file. Raises EpisodesError for a damaged one."""
        file = _file(recording)
        try:
            if file.stat().st_size > MAX_BYTES:
                raise EpisodesError(f"{file}: larger than {MAX_BYTES} bytes")
            return checked(cls(**json.loads(file.read_text(encoding="utf-8"))))
        except FileNotFoundError:
            return None
        except EpisodesError:
            raise
        except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
            raise EpisodesError(f"{file}: not valid metadata of a recording: {error}") from None


def _file(recording: Path) -> Path:
    return recording.with_name(recording.name.removesuffix(SUFFIX) + METADATA_SUFFIX)


@cache
def commit() -> str | None:
    """The checkout's commit, with MODIFIED_SUFFIX if it has uncommitted changes; None outside of a checkout."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--exclude=*", "--abbrev=10"]
    try:
        return subprocess.check_output([*command, f"--dirty={MODIFIED_SUFFIX}"], text=True, timeout=20).strip()
    except (OSError, subprocess.SubprocessError):
        return None


@cache
def cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def machine() -> str:
    """The CPU model and how many of its cores this process may use."""
    return f"{cpu_model()}, {usable_cores()} cores"


def software() -> dict[str, str]:
    """Versions of Python, the operating system and the installed packages among DISTRIBUTIONS."""
    found = {"python": platform.python_version(), "system": platform.platform()}
    for name in DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
