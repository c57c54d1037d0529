"""A checked-out lilGym release, played beside this package in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from select import select
from typing import Any

from lilgym_mp.benchmark import release_player
from lilgym_mp.benchmark.catalogue import Subject
from lilgym_mp.benchmark.players import Play, Timed
from lilgym_mp.benchmark.traces import Workload

PACKAGE = "lilgym"
PATIENCE_SECONDS = 300.0  # for the release to start, or to play once
OWN_PYTHON = Path(".venv", "bin", "python")  # of the checkout, where the release's requirements are installed


class ReleaseError(ValueError):
    """A directory that holds no lilGym release, or one that cannot be played."""


def checked_release(directory: Path) -> Path:
    """The directory as an absolute path. Raises ReleaseError unless it holds the package."""
    if not directory.is_dir():
        raise ReleaseError(f"no lilGym release in {directory}: there is no such directory")
    if not (directory / PACKAGE).is_dir() and not (directory / f"{PACKAGE}.py").is_file():
        raise ReleaseError(
            f"no lilGym release in {directory}: name the checkout that has the package {PACKAGE!r} in it"
        )
    return directory.resolve()


def release_subject(directory: Path, options: Mapping[str, Any]) -> Subject:
    """The release's own environment; `options` go to its `make`. Raises ReleaseError as `checked_release` does."""
    opener = partial(_played, directory=checked_release(directory), options=options)
    return Subject("release", "lilGym release", 1, opener)


@contextmanager
def _played(workload: Workload, directory: Path, options: Mapping[str, Any]) -> Iterator[Play]:
    """Raises ReleaseError when the release has no such environment or does not run."""
    python = directory / OWN_PYTHON
    command = [str(python) if python.is_file() else sys.executable, release_player.__file__]
    child = subprocess.Popen(
        command,
        cwd=directory,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,  # Ctrl-C is ours to handle
    )
    try:
        _asked(child, _order(workload, directory, options))

        def play() -> Timed:
            answer = _asked(child, {})
            return Timed(answer["steps"], answer["seconds"])

        yield play
    finally:
        _ended(child)


def _order(workload: Workload, directory: Path, options: Mapping[str, Any]) -> dict[str, Any]:
    (script,) = workload.scripts(1)
    decode = workload.recorder.decode_action
    return {
        "directory": str(directory),
        "configuration": workload.configuration,
        "options": dict(options),
        "episodes": [[decode(action) for action in episode.actions] for episode in script.episodes],
    }


def _asked(child: subprocess.Popen[str], order: Mapping[str, Any]) -> dict[str, Any]:
    assert child.stdin is not None
    assert child.stdout is not None
    line = ""
    with suppress(BrokenPipeError):  # it has ended: then there is no answer either
        child.stdin.write(json.dumps(order) + "\n")
        child.stdin.flush()
        if not select([child.stdout], [], [], PATIENCE_SECONDS)[0]:
            raise ReleaseError(f"the lilGym release has not answered for {PATIENCE_SECONDS:g} seconds")
        line = child.stdout.readline()
    answer = json.loads(line) if line else {"error": f"ended with exit code {child.wait()}"}
    if "error" in answer:
        raise ReleaseError(f"the lilGym release cannot be played: {answer['error']}")
    return answer


def _ended(child: subprocess.Popen[str]) -> None:
    for stream in (child.stdin, child.stdout):
        assert stream is not None
        with suppress(OSError):
            stream.close()
    try:
        child.wait(2)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
