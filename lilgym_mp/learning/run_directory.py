"""A training run on disk: what it is, its words, its latest checkpoint, its progress. Each file is whole or absent.

run.json         environment, recipe, training tasks: written first, never changed
vocabulary.json  the words of the training statements
training_tasks.jsonl  the corpus learnt from, where the recipe recolours
checkpoint.pt    network, optimiser and counts, replaced whole
progress.jsonl   a line an update
evaluations.jsonl  a line an evaluation on dev, where that was asked for
tensorboard/     the same for TensorBoard
"""

from __future__ import annotations

import hashlib
import json
import math
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch

from lilgym_mp.corpus import Vocabulary, VocabularyError
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.files import write_json, write_whole
from lilgym_mp.learning.recipe import Recipe, option

FORMAT = "lilgym_mp-run"
VERSION = 1
LONGEST_STATEMENT = 10_000  # words


class RunError(ValueError):
    """A directory that cannot serve as a training run, or not as the one asked for."""


class Checkpoint(NamedTuple):
    """What learning goes on from."""

    network: dict[str, Any]  # state of an ActorCritic
    optimiser: dict[str, Any]
    steps: int  # actions taken
    updates: int  # epochs of updates, as Stable-Baselines3 counts them
    episodes: int
    seconds: float  # spent training


@dataclass(frozen=True)
class Identity:
    """What makes a run that run: none of it may differ when it is resumed."""

    settings: Settings
    recipe: Recipe
    length: int  # words of a statement that the network reads
    tasks_sha256: str  # of the file that the training tasks come from

    def to_json(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "version": VERSION,
            "environment": self.settings.to_json(),
            "recipe": self.recipe.to_json(),
            "statement_length": self.length,
            "tasks_sha256": self.tasks_sha256,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Identity:
        """What `to_json` gave. Raises ValueError, TypeError, KeyError for anything else."""
        if data["format"] != FORMAT or data["version"] != VERSION:
            raise ValueError(f"must be of format {FORMAT!r}, version {VERSION}")
        return cls(
            Settings.from_json(data["environment"]),
            Recipe.from_json(data["recipe"]),
            _checked_length(data["statement_length"]),
            str(data["tasks_sha256"]),
        )


def _checked_length(length: object) -> int:
    """Raises ValueError for what no statement's length can be, which would be a request for that much memory."""
    if isinstance(length, bool) or not isinstance(length, int) or not 1 <= length <= LONGEST_STATEMENT:
        raise ValueError(f"statement_length must be a whole number of 1 to {LONGEST_STATEMENT} words, not {length!r}")
    return length


def _checked_checkpoint(checkpoint: Checkpoint) -> Checkpoint:
    """Raises ValueError for parts that learning cannot go on from."""
    for name in ("network", "optimiser"):
        if not isinstance(getattr(checkpoint, name), dict):
            raise ValueError(f"{name} must be a dictionary, not {getattr(checkpoint, name)!r:.40}")
    for name, tensor in checkpoint.network.items():
        if not isinstance(tensor, torch.Tensor) or not torch.isfinite(tensor).all():
            raise ValueError(f"{name} of the network must be numbers, all of them finite")
    if not {"state", "param_groups"} <= checkpoint.optimiser.keys():
        raise ValueError("the optimiser must have a state and param_groups")
    for name in ("steps", "updates", "episodes", "seconds"):
        value = getattr(checkpoint, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
            raise ValueError(f"{name} must be a number that is not negative, not {value!r:.40}")
    return checkpoint


class RunDirectory:
    """The files of one training run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.identity_file = path / "run.json"
        self.vocabulary_file = path / "vocabulary.json"
        self.tasks_file = path / "training_tasks.jsonl"
        self.checkpoint_file = path / "checkpoint.pt"
        self.progress_file = path / "progress.jsonl"
        self.evaluations_file = path / "evaluations.jsonl"
        self.tensorboard = path / "tensorboard"

    @property
    def exists(self) -> bool:
        """Whether a run was begun here."""
        return self.identity_file.exists()

    def begin(self, identity: Identity, vocabulary: Vocabulary) -> None:
        """Writes what a new run starts with."""
        write_whole(self.vocabulary_file, vocabulary.save)
        write_json(self.identity_file, identity.to_json())

    def identity(self) -> Identity:
        """Raises RunError when there is no run here, or its description cannot be read."""
        try:
            return Identity.from_json(json.loads(self.identity_file.read_text(encoding="utf-8")))
        except FileNotFoundError:
            raise RunError(f"no training run in {self.path}: it has no {self.identity_file.name}") from None
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as fault:
            raise RunError(f"{self.identity_file}: cannot be used: {fault}") from None

    def vocabulary(self) -> Vocabulary:
        """Raises RunError."""
        try:
            return Vocabulary.load(self.vocabulary_file)
        except VocabularyError as fault:
            raise RunError(str(fault)) from None

    def save(self, checkpoint: Checkpoint) -> None:
        """Puts the checkpoint in the place of the last one."""
        write_whole(self.checkpoint_file, lambda path: torch.save(checkpoint._asdict(), path))

    def load(self) -> Checkpoint:
        """The latest checkpoint; nothing in the file is executed. Raises RunError."""
        try:
            return _checked_checkpoint(Checkpoint(**torch.load(self.checkpoint_file, weights_only=True)))
        except FileNotFoundError:
            raise RunError(f"no checkpoint in {self.path}: the run ended before its first one") from None
        except (OSError, RuntimeError, TypeError, ValueError, KeyError, EOFError, pickle.UnpicklingError) as fault:
            summary = str(fault).strip().splitlines()[0] if str(fault).strip() else type(fault).__name__
            raise RunError(f"{self.checkpoint_file}: damaged, or no checkpoint of ours: {summary}") from None

    def checkpoint_sha256(self) -> str:
        return hashlib.sha256(self.checkpoint_file.read_bytes()).hexdigest()


def refuse_other(saved: Mapping[str, Any], asked: Mapping[str, Any], place: Path) -> None:
    """Raises RunError naming both values of the first setting in which a run differs from what is asked for."""
    for name, value in asked.items():
        if saved[name] != value:
            raise RunError(
                f"the run in {place} has {option(name)} {shown(saved[name])}, but {shown(value)} was asked for;"
                " leave the option out, or choose another directory"
            )


def shown(value: Any) -> str:
    """A setting's value as people write it."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple | list):
        return "x".join(map(str, value))
    return str(value)
