"""A training run on disk, common to all learners. Imports no torch until tensors are read or written.

run.json            the run's identity, which never changes, its options, such as its budget, whether it is finished,
                    and when, where and with which code it was begun
checkpoint.pt       training state, replaced atomically
progress.jsonl      one line per progress report
agent.safetensors   the trained agent, replaced atomically
"""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.evaluation.files import writable_directory, write_atomically, write_json
from lilgym_mp.evaluation.recording_metadata import metadata
from lilgym_mp.scene.arrays import AnyDict, AnyMapping

if TYPE_CHECKING:
    import torch

FORMAT = "lilgym_mp-training-run"
VERSION = 1
RUN_FILE = "run.json"
CHECKPOINT_FILE = "checkpoint.pt"
PROGRESS_FILE = "progress.jsonl"
AGENT_FILE = "agent.safetensors"
EVALUATIONS_FILE = "evaluations.jsonl"  # of PPO: on dev, with --evaluate-every
VALIDATIONS_FILE = "validations.jsonl"  # of PPO: on held-out tasks


class TrainingRunError(ValueError):
    """A run that cannot go on, or a directory that cannot be used as a run, or holds a different one."""


@dataclass
class RunDirectory:
    """The files of one run."""

    path: Path
    identity: AnyDict
    options: AnyDict  # what a resumed run may change, such as its budget, as last requested
    made: AnyDict  # date, command, commit, machine and versions when it was begun
    finished: bool = False  # whether it spent its budget and saved its agent

    @property
    def agent_file(self) -> Path:
        """Path of the model file, whether or not it exists."""
        return self.path / AGENT_FILE

    @property
    def has_checkpoint(self) -> bool:
        """Whether the run can be resumed."""
        return (self.path / CHECKPOINT_FILE).exists()

    @property
    def progress_bytes(self) -> int:
        """The size of progress.jsonl."""
        file = self.path / PROGRESS_FILE
        return file.stat().st_size if file.exists() else 0

    def cut_progress(self, size: int) -> None:
        """Cuts progress.jsonl back to a former size, without the lines after a checkpoint of a killed process."""
        if self.progress_bytes > size:
            os.truncate(self.path / PROGRESS_FILE, size)

    def remember(self, *, finished: bool = False, **options: Any) -> None:
        """Keeps these options for a run resumed without them; those that are None keep their former value."""
        self.finished = finished
        self.options |= {name: value for name, value in options.items() if value is not None}
        content = {"format": FORMAT, "version": VERSION, "identity": self.identity, "options": self.options}
        write_json(self.path / RUN_FILE, {**content, "finished": finished, "made": self.made})

    def save_checkpoint(self, state: AnyMapping) -> None:
        """Replaces the checkpoint. `state`: tensors, numbers, strings and collections of them."""
        import torch

        data = io.BytesIO()  # torch reports a full disk in errors of its own kind
        torch.save(dict(state), data)
        write_atomically(self.path / CHECKPOINT_FILE, lambda unfinished: unfinished.write_bytes(data.getbuffer()))

    @contextmanager
    def checkpoint(self, device: torch.device | str = "cpu") -> Iterator[AnyDict]:
        """The latest checkpoint; never executes the file's contents. Raises TrainingRunError if it is damaged, or the
        block cannot use it."""
        import torch

        path = self.path / CHECKPOINT_FILE
        try:
            with warnings.catch_warnings(action="ignore"):
                state = torch.load(path, map_location=device, weights_only=True)
            yield state
        except Exception as error:  # a damaged file causes errors of any kind
            raise TrainingRunError(f"{path}: damaged, or not a checkpoint of this run: {first_line(error)}") from None

    def record(self, line: AnyMapping, file: str = PROGRESS_FILE) -> None:
        """Appends a line to a file of JSON lines."""
        with (self.path / file).open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(line) + "\n")


def begin_run(path: Path, identity: AnyMapping, *, resume: bool = False) -> RunDirectory:
    """A new run in an empty or new directory, or with `resume` the one already there.

    `identity`: everything a resumed run must share, as JSON. Raises TrainingRunError when the directory is in use or
    holds a different run, OutputError when it is not writable.
    """
    identity = json.loads(json.dumps(identity))
    file = path / RUN_FILE
    if resume:
        run = _read_run(path)
        check_same(path, run.identity, identity)
        return run
    writable_directory(path)
    if file.exists() or (path / AGENT_FILE).exists():
        raise TrainingRunError(f"{path} already holds a run or an agent: --resume the run, or choose another directory")
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])
    run = RunDirectory(path, dict(identity), {}, made={**metadata(()), "command": command})
    run.remember()
    return run


def check_same(path: Path, saved: AnyMapping, requested: AnyMapping) -> None:
    """Raises TrainingRunError naming the first setting requested that the run in the directory has otherwise."""
    for name, kept, value in _differences(saved, requested):
        raise TrainingRunError(
            f"the run in {path} has {name} {shown(kept)}, but {shown(value)} was requested;"
            " leave the option out, or choose another directory"
        )


def _differences(saved: AnyMapping, requested: AnyMapping) -> Iterator[tuple[str, Any, Any]]:
    """Name, saved and requested value of each setting that differs, nested ones included."""
    for name, value in requested.items():
        kept = saved.get(name)
        if isinstance(kept, dict) and isinstance(value, dict):
            yield from _differences(kept, value)
        elif kept != value:
            yield name, kept, value


def _read_run(path: Path) -> RunDirectory:
    file = path / RUN_FILE
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        found = content["format"], content["version"]
        options = content.get("options", {})
        made = content.get("made", {})
        finished = content.get("finished", False)
        run = RunDirectory(path, dict(content["identity"]), options, made, finished)
    except FileNotFoundError:
        raise TrainingRunError(f"no training run in {path}: it has no {RUN_FILE}") from None
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise TrainingRunError(f"{file}: cannot be used: {error}") from None
    if found != (FORMAT, VERSION):
        raise TrainingRunError(f"{file}: must have format {FORMAT!r}, version {VERSION}")
    return run


def first_line(error: Exception) -> str:
    """An error of another library in one line."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def shown(value: Any) -> str:
    """A setting's value in messages."""
    if isinstance(value, bool):
        return "on" if value else "off"
    return "nothing" if value is None else str(value)
