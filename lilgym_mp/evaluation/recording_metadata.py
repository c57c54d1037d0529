"""Date, command, commit, machine and software versions of a recording, in a JSON file next to it.

They are not in the recording itself, so that equal evaluations give equal recordings.
"""

from __future__ import annotations

import json
import platform
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from lilgym_mp.envs.machine import usable_cores
from lilgym_mp.evaluation.files import SUFFIX, EpisodesError, write_json
from lilgym_mp.scene.arrays import AnyDict

METADATA_SUFFIX = ".metadata.json"
DISTRIBUTIONS = ("lilgym-mp", "numpy", "gymnasium", "pillow", "torch", "stable-baselines3", "sb3-contrib")
MODIFIED_SUFFIX = " with changes"  # marks a commit with uncommitted changes


def metadata(argv: Sequence[str]) -> AnyDict:
    """Metadata of what this process makes now; `argv`: command line without the program's name.

    The date is in UTC, the commit None for an installed package.
    """
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
        "command": " ".join(["lilgym-mp", *argv]),
        "commit": commit(),
        "machine": machine(),
        "software": software(),
    }


def write_metadata(recording: Path, argv: Sequence[str]) -> None:
    """Writes beside a recording how and where it was made."""
    write_json(_file(recording), metadata(argv))


def read_metadata(recording: Path) -> AnyDict:
    """The recording's metadata, empty if there is no such file. Raises EpisodesError for a damaged one."""
    file = _file(recording)
    try:
        return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise EpisodesError(f"{file}: not valid metadata of a recording: {error}") from None


def _file(recording: Path) -> Path:
    return recording.with_name(recording.name.removesuffix(SUFFIX) + METADATA_SUFFIX)


@cache
def commit() -> str | None:
    """The checkout's commit, with MODIFIED_SUFFIX if it has uncommitted changes; None outside of a checkout."""
    root = Path(__file__).resolve().parents[2]  # an editable install is a link
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--exclude=*", "--abbrev=10"]
    try:
        return subprocess.check_output([*command, f"--dirty={MODIFIED_SUFFIX}"], text=True, timeout=20).strip()
    except (OSError, subprocess.SubprocessError):
        return None


@cache
def cpu_model() -> str:
    """The processor's name as the system gives it."""
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
