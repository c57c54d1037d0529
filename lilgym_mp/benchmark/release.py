"""A checkout of the lilGym release as a benchmark case, run in a subprocess."""

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
from lilgym_mp.benchmark.catalogue import BenchmarkCase
from lilgym_mp.benchmark.players import Play, Timing
from lilgym_mp.benchmark.traces import Workload

PACKAGE = "lilgym"
TIMEOUT_SECONDS = 300.0  # time limit for the release to start, or to play once
OWN_PYTHON = Path(".venv", "bin", "python")  # the checkout's Python, with the release's requirements


class ReleaseError(ValueError):
    """A directory does not contain a lilGym release, or the release does not run."""


def check_release(directory: Path) -> Path:
    """The directory as an absolute path. Raises ReleaseError unless it contains the package."""
    if not directory.is_dir():
        raise ReleaseError(f"no lilGym release in {directory}: there is no such directory")
    if not (directory / PACKAGE).is_dir() and not (directory / f"{PACKAGE}.py").is_file():
        raise ReleaseError(f"no lilGym release in {directory}: name the checkout that contains the package {PACKAGE!r}")
    return directory.resolve()


def release_case(directory: Path, options: Mapping[str, Any]) -> BenchmarkCase:
    """The release's own environment; `options` go to its `gym.make`. Raises ReleaseError as `check_release` does."""
    opener = partial(_player, directory=check_release(directory), options=options)
    return BenchmarkCase("release", "lilGym release", 1, opener)


@contextmanager
def _player(workload: Workload, directory: Path, options: Mapping[str, Any]) -> Iterator[Play]:
    """Raises ReleaseError if the release has no such environment or does not run."""
    python = directory / OWN_PYTHON
    command = [str(python) if python.is_file() else sys.executable, release_player.__file__]
    child = subprocess.Popen(
        command,
        cwd=directory,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,  # so that Ctrl-C does not reach it
    )
    try:
        _request(child, _setup_request(workload, directory, options))

        def play() -> Timing:
            answer = _request(child, {})
            return Timing(answer["steps"], answer["seconds"])

        yield play
    finally:
        _close(child)


def _setup_request(workload: Workload, directory: Path, options: Mapping[str, Any]) -> dict[str, Any]:
    (script,) = workload.scripts(1)
    decode = workload.recorder.decode_action
    return {
        "directory": str(directory),
        "configuration": workload.configuration,
        "options": dict(options),
        "episodes": [[decode(action) for action in episode.actions] for episode in script.episodes],
    }


def _request(child: subprocess.Popen[str], request: Mapping[str, Any]) -> dict[str, Any]:
    """Sends a request to `release_player` and returns its answer. Raises ReleaseError."""
    assert child.stdin is not None
    assert child.stdout is not None
    line = ""
    with suppress(BrokenPipeError):  # the process has exited: its answer will be empty
        child.stdin.write(json.dumps(request) + "\n")
        child.stdin.flush()
        if not select([child.stdout], [], [], TIMEOUT_SECONDS)[0]:
            raise ReleaseError(f"the lilGym release has not answered for {TIMEOUT_SECONDS:g} seconds")
        line = child.stdout.readline()
    answer = json.loads(line) if line else {"error": f"ended with exit code {child.wait()}"}
    if "error" in answer:
        raise ReleaseError(f"the lilGym release cannot be played: {answer['error']}")
    return answer


def _close(child: subprocess.Popen[str]) -> None:
    for stream in (child.stdin, child.stdout):
        assert stream is not None
        with suppress(OSError):
            stream.close()
    try:
        child.wait(2)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
